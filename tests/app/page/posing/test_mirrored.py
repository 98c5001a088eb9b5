"""A mirrored pose is the mirror image: of a body exactly, of a hand the pose that the other side's hand would have."""

import numpy as np

from handtrack import load_model
from handtrack_app.page.panels.copying import mirrored

RIGHT = np.array([1.0, 2.0, 0.5]) / np.linalg.norm([1.0, 2.0, 0.5])
MIDDLE = np.array([0.3, -0.1, 0.2])


def _image(places):
    return MIDDLE + (places - MIDDLE) @ (np.eye(3) - 2 * np.outer(RIGHT, RIGHT))


def _random(model, rng):
    values = model.joint_params(model.clipped(rng.normal(0.0, 0.4, len(model.transform.names))))
    values[:6] = rng.normal(0.0, 0.4, 6)
    found = mirrored(model.parameter_names, values, RIGHT, MIDDLE)
    return values, np.array([found[name] for name in model.parameter_names])


def _joints(model, values):
    return model.joint_positions(model.bones(model.transform.solver_params(values)))


def test_a_body_s_image_has_its_limbs_on_the_other_side(rng):
    model = load_model("body34")
    values, image = _random(model, rng)
    swap = {"left": "right", "right": "left"}
    other = ["_".join(swap.get(part, part) for part in n.split("_")) for n in model.joint_names]
    order = [model.joint_names.index(name) for name in other]
    np.testing.assert_allclose(
        _joints(model, image)[order], _image(_joints(model, values)), atol=1e-12
    )


def test_a_right_hand_s_image_is_a_left_hand_s_pose(rng):
    right, left = load_model(side="right"), load_model(side="left")
    values, image = _random(right, rng)
    np.testing.assert_allclose(_joints(left, image), _image(_joints(right, values)), atol=1e-12)
