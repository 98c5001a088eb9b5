"""Chains: which hinges move which links, and what a chain may not be."""

import numpy as np

from handtrack.model.model_file import load_model
from handtrack.sampling.chains import chains_of, prepare


def test_what_a_coupling_takes_is_not_a_fingers_own():
    linked = chains_of(load_model("hand26", coupling="18"))[1]
    # all four fingers spread together
    assert linked.parameters == ("index_mcp_flex", "index_pip_flex")
    ready = prepare(load_model("hand26", coupling="18"), linked)
    assert ready.leader.tolist() == [0, -1, 2, 2]
    np.testing.assert_allclose(ready.ratio[3], 2 / 3)


def test_links_keep_their_length_in_every_pose(rng):
    model = load_model("body34")
    for chain in chains_of(model):
        ready = prepare(model, chain)
        joints = [model.joint_names.index(name) for name in chain.joints]
        for _ in range(5):
            params = model.clipped(model.rest_params() + 0.7 * rng.normal(size=34))
            points = model.joint_positions(model.bones(params))[joints]
            lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
            np.testing.assert_allclose(lengths, np.linalg.norm(ready.reach, axis=1), rtol=1e-12)
