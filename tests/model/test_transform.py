"""Couplings as one matrix; limits reduced with it."""

import numpy as np
import pytest

from handtrack.model.model_file import load_model
from handtrack.model.transform import Follows, build_transform


@pytest.mark.parametrize(("coupling", "count"), [("26", 26), ("21", 21), ("18", 18)])
def test_reduced_sets(coupling, count, rng):
    model = load_model(coupling=coupling)
    assert len(model.transform.names) == count
    params = rng.normal(size=count)
    joint = model.joint_params(params)
    np.testing.assert_allclose(model.transform.solver_params(joint), params, atol=1e-12)
    value = dict(zip(model.parameter_names, joint, strict=True))
    if coupling != "26":
        for finger in ("index", "middle", "ring", "little"):
            assert value[f"{finger}_dip_flex"] == pytest.approx(2 / 3 * value[f"{finger}_pip_flex"])
        assert value["thumb_ip_flex"] == pytest.approx(2 / 3 * value["thumb_mcp_flex"])


def test_a_persons_own_spread():
    model = load_model(coupling="18", spread={"little": 2.0})
    params = np.zeros(18)
    params[model.transform.names.index("spread")] = 0.1
    value = dict(zip(model.parameter_names, model.joint_params(params), strict=True))
    assert value["little_mcp_abd"] == pytest.approx(0.2)
    assert value["index_mcp_abd"] == pytest.approx(0.1)


def test_a_leaders_bounds_are_the_intersection():
    """pip in [0, 110°] and dip = 2/3 pip in [0, 60°] leave pip [0, 90°]."""
    transform = build_transform(("pip", "dip"), (Follows("dip", "pip", 2 / 3),))
    reduced = transform.reduce_bounds(np.deg2rad([[0, 110], [0, 60]]))
    np.testing.assert_allclose(np.rad2deg(reduced), [[0, 90]])


def test_reduced_bounds_keep_every_joint_within_its_own(rng):
    model = load_model(coupling="18", forearm=True)
    bounds = model.limits.interval
    reduced = model.transform.reduce_bounds(bounds)
    finite = np.where(np.isfinite(reduced), reduced, 0.0)
    for _ in range(50):
        joint = model.joint_params(rng.uniform(finite[:, 0], finite[:, 1]))
        assert ((joint >= bounds[:, 0] - 1e-12) & (joint <= bounds[:, 1] + 1e-12)).all()
