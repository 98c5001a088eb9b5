"""The hand that lengths from the truth make, by finger and by bone; the whole table: `handtrack bench hand_size`."""

from __future__ import annotations

import numpy as np
import pytest

from handtrack.bench.clouds.hand_size import lengthened, true_factors, true_scale
from handtrack.model.articulated import FINGERS, HandScale
from handtrack.model.model_file import load_model
from handtrack.model.pose_library import named_pose


def keypoints_of(model, poses=("open", "rest", "fist")):
    solver = [model.transform.solver_params(named_pose(model, name)) for name in poses]
    return np.stack([model.keypoints21(model.bones(params)) for params in solver])


def test_a_size_comes_back_from_its_own_joints():
    scale = HandScale(1.05, {"thumb": 0.93, "index": 1.04, "little": 0.97})
    found = true_scale(load_model(), keypoints_of(load_model(scale=scale)))
    assert found.overall == pytest.approx(1.05)
    for finger in FINGERS:
        assert found.parts[finger] == pytest.approx(scale.parts.get(finger, 1.0))


def test_bones_are_as_long_as_asked_for(rng):
    mean = load_model()
    names = [name for name in mean.skeleton.bone_names if name != "root"]
    factors = {name: float(rng.uniform(0.8, 1.2)) for name in names}
    for finger in FINGERS[1:]:  # knuckle and wrist in one line: only then the distance tells both
        factors[f"{finger}_metacarpal"] = factors[f"{finger}_carpal"]
    longer = lengthened(mean, factors)
    found = true_factors(mean, keypoints_of(longer))
    assert found == {name: pytest.approx(factors[name]) for name in found}
    assert set(found) == set(names)


def test_stretched_flesh_stays_on_its_bone():
    """A finger twice as long has ellipsoids twice as long at twice the distance, and no thicker."""
    mean = load_model()
    longer = lengthened(mean, {"index_proximal": 2.0})
    bone = mean.skeleton.bone("index_proximal")
    before, after = mean.flesh["metaballs"], longer.flesh["metaballs"]
    kept = before.bone == bone
    assert kept.any()
    np.testing.assert_allclose(after.centre[kept, 1], 2 * before.centre[kept, 1])
    np.testing.assert_allclose(after.radii[kept, 1], 2 * before.radii[kept, 1])
    np.testing.assert_allclose(after.radii[kept][:, [0, 2]], before.radii[kept][:, [0, 2]])
    np.testing.assert_array_equal(after.radii[~kept], before.radii[~kept])
