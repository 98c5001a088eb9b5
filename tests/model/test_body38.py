"""The definition body38: body34, and wrists that bend the way their names say; what else takes a body takes it too."""

import numpy as np
import pytest

from handtrack.model.model_file import load_model


@pytest.fixture(scope="module")
def body():
    return load_model("body38")


def placed(model, joint, **degrees):
    angles = {name: np.deg2rad(value) for name, value in degrees.items()}
    points = model.joint_positions(model.bones(model.params_from(angles)))
    return points[model.joint_names.index(joint)]


@pytest.mark.parametrize("side", ["left", "right"])
def test_signs_of_wrists(body, side):
    """Palms face the thighs: flexion brings the knuckles to the body's middle, abduction to the thumb, which points ahead."""
    inwards = -1.0 if side == "left" else 1.0
    still = placed(body, f"{side}_hand")
    flexed = placed(body, f"{side}_hand", **{f"{side}_wrist_flex": 60}) - still
    towards_thumb = placed(body, f"{side}_hand", **{f"{side}_wrist_abd": 20}) - still
    assert flexed[0] * inwards > 0.05 and abs(flexed[2]) < 1e-9
    assert towards_thumb[2] > 0.02 and abs(towards_thumb[0]) < 1e-9
    for knuckle, ahead in (("index", 1), ("pinky", -1)):
        assert (placed(body, f"{side}_{knuckle}") - still)[2] * ahead > 0.02
    # a flexed hand still turns to the thumb: flexion first, abduction about the axis that it carried along
    both = placed(body, f"{side}_hand", **{f"{side}_wrist_flex": 60, f"{side}_wrist_abd": 20})
    assert both[2] - still[2] == pytest.approx(towards_thumb[2], abs=1e-9)


def test_left_and_right_wrists_are_mirror_images(body):
    left = {"left_wrist_flex": 50.0, "left_wrist_abd": -25.0, "left_elbow_flex": 70.0}
    right = {name.replace("left", "right"): value for name, value in left.items()}
    for joint in ("hand", "index", "pinky"):
        mirrored = placed(body, f"left_{joint}", **left) * (-1.0, 1.0, 1.0)
        np.testing.assert_allclose(placed(body, f"right_{joint}", **right), mirrored, atol=1e-12)
