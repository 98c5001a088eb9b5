"""A person's shape: written, read, set by hand, and how bones and surfaces move with it."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from handtrack import HandScale, HandtrackError, load_model
from handtrack.geometry.rotation import rotation_matrix
from handtrack.model.articulated import ShapeCovariance
from handtrack.model.ellipsoids import Ellipsoids
from handtrack.model.metaballs import MetaballSurface
from handtrack.model.model_file import read_scale, scale_from, scale_table, write_scale
from handtrack.model.size import (
    SizeParameters,
    hand_length_mm,
    hand_length_slope,
    shape_numbers,
    with_number,
)
from tests.derivatives import check_gradient, check_jacobian

FITTED = HandScale(
    1.05, {"thumb": 0.97}, {"palm_breadth": 0.4, "thumb_base_along": -1.0}, {"index_tip": (0.1, -2.0, 0.5)},
    "mediapipe21", "a scan", {"length_mm": 1.0, "overall": 0.01, "palm_breadth": 0.2, "palm_thickness": 0.99},
    ShapeCovariance.of(("overall", "palm_breadth"), np.array([[1e-4, -1e-3], [-1e-3, 0.04]])),
)  # fmt: skip


@pytest.mark.parametrize("name", ["me.toml", "me.json"])
def test_the_whole_person_comes_back(tmp_path, name):
    path = tmp_path / name
    write_scale(path, FITTED, {"thumb": "−3.0 %", "overall": "+5.0 %"})
    again = read_scale(path)
    assert scale_table(again) == scale_table(FITTED)
    assert_array_equal(again.covariance.matrix, FITTED.covariance.matrix)
    whole = path.read_text()
    path.write_text(whole[: whole.rindex("covariance") - 1])
    with pytest.raises(HandtrackError):  # cut off, though a table ends there
        read_scale(path)


@pytest.mark.parametrize(
    "covariance",
    [
        {"names": ["overall", "thumb"], "rows": [[1.0], [2.0, 1.0]]},
        {"names": ["overall"], "rows": [[1.0], [0.0, 1.0]]},
        {"names": ["overall", "overall"], "rows": [[1.0], [0.0, 1.0]]},
        {"names": ["overall"], "rows": [[float("nan")]]},
        {"names": ["overall"]},
        3,
    ],
)
def test_a_covariance_that_is_none_is_refused(covariance):
    with pytest.raises(HandtrackError):
        scale_from({"overall": 1.0, "covariance": covariance}, "me.toml")


def test_every_number_can_be_set_alone():
    model = load_model(scale=FITTED)
    before = {row.name: row.value for row in shape_numbers(model)}
    own = [row.sigma for row in shape_numbers(model) if row.unit == "mm"]
    assert own and 0.1 < min(own) and max(own) < 20.0, "people differ by millimetres"
    for name in before:
        scale = with_number(model, name, 2.0)
        after = {row.name: row.value for row in shape_numbers(load_model(scale=scale))}
        assert after[name] == pytest.approx(2.0, rel=0.1), name
        other = [one for one in before if one != name and one != "overall"]
        assert_allclose([after[o] for o in other], [before[o] for o in other], rtol=0.1, atol=1e-6)
        assert scale.offsets_mm == FITTED.offsets_mm
        assert name not in scale.std
        assert name not in scale.covariance.names
    with pytest.raises(HandtrackError):
        with_number(model, "nose", 1.0)


HAND = HandScale(0.93, {"thumb": 1.04, "little": 0.95, "forearm": 1.1})
HAND = replace(HAND, proportions={"palm_breadth": 1.1, "thenar": -0.8, "finger_flesh": 0.7})
BODY = HandScale(1.05, {"thighs": 1.06, "head": 0.97}, {"hip_width": 1.2, "clavicle_height": -0.7})


SEEN = ("left_hip", "right_hip", "left_wrist", "right_wrist")
SIZES = {
    "hand": SizeParameters(load_model(scale=HAND, forearm=True)),
    "left hand": SizeParameters(load_model("hand26", "left", HAND, forearm=True)),
    "body": SizeParameters(load_model("body34", scale=BODY)),
    "body seen": SizeParameters(load_model("body34", scale=BODY), SEEN),
}
"""counted from somebody who is not the mean adult"""


@pytest.fixture(params=SIZES)
def size(request):
    return SIZES[request.param]


def posed(model, rng):
    joint = model.rest + rng.uniform(-0.2, 0.2, len(model.rest))
    return model.transform.solver_params(joint)


def test_deviations_go_there_and_back(size, rng):
    deviations = rng.normal(size=len(size.names))
    assert_allclose(size.deviations(size.scale(deviations)), deviations, atol=1e-12)
    assert_array_equal(size.deviations(HandScale()), 0.0)


def test_a_bodys_offsets_are_mirror_images():
    """One offset of both hips, and of a side that is seen alone; the nose's stays in the middle plane."""
    size = SizeParameters(load_model("body34", scale=BODY), ("left_hip", "right_hip", "left_knee", "nose"))  # fmt: skip
    assert size.offset_count == 9
    deviations = np.zeros(len(size.names))
    deviations[-9:] = 1.0
    model = size.rescaled(deviations)
    bones = model.bones(model.params_from({}))
    beside = bones.to_world(model.joint_bone, model.observed_point) - model.joint_positions(bones)
    left, right, knee, nose = (beside[model.joint_names.index(name)] for name in size.observed)
    assert_allclose(left, right * [-1.0, 1.0, 1.0], atol=1e-12)
    assert abs(left[0]) > 0.01
    assert abs(knee[0]) > 0.01
    assert nose[0] == pytest.approx(0.0, abs=1e-12)
    assert np.linalg.norm(nose) > 0.01
    unit = size.units[-1]
    assert np.sqrt(3.0) * unit == pytest.approx(0.030)  # root mean square


def test_a_grown_model_is_the_model_of_that_size(size, rng):
    deviations = rng.normal(size=len(size.names))
    rescaled, base = size.rescaled(deviations), size.model
    built = load_model(base.name, base.side, size.scale(deviations), forearm=True)
    assert rescaled.scale == built.scale
    assert_allclose(rescaled.skeleton.length, built.skeleton.length, atol=1e-12)
    params = posed(base, rng)
    here, there = rescaled.bones(params), built.bones(params)
    assert_allclose(here.position, there.position, atol=1e-12)
    joints = rescaled.joint_positions(here), built.joint_positions(there)
    assert_allclose(*joints, atol=1e-12)
    for flesh in base.ellipsoids:
        ours, theirs = rescaled.ellipsoids[flesh].posed(here), built.ellipsoids[flesh].posed(there)
        assert_allclose(ours.centre, theirs.centre, atol=1e-12)
        assert_allclose(ours.radii, theirs.radii, atol=1e-12)
    points = here.position + 0.02
    surfaces = [MetaballSurface.of(model) for model in (rescaled, built)]
    distances = [s.distance(b, points) for s, b in zip(surfaces, (here, there), strict=True)]
    assert_allclose(*distances, atol=1e-12)


def test_points_move_by_each_deviation_as_the_fields_say(size, rng):
    """dX = v + G (X − o), for a point that is fixed to a bone, and for the middle and the axes of an ellipsoid."""
    deviations, order = rng.normal(size=len(size.names)), rng.permutation(len(size.names))
    params, local = posed(size.model, rng), rng.normal(size=(len(size.model.groups), 3))
    every, flesh = np.arange(len(local)), size.model.ellipsoids["fine"]
    names, count = [size.names[number] for number in order], len(order)

    def centres(bones):
        return flesh.posed(bones).centre

    def shapes(bones):
        placed = flesh.posed(bones)
        axes = placed.rotation * placed.radii[:, None]
        return axes @ axes.swapaxes(1, 2)

    def check(function, slopes, atol=1e-8):
        def moved(by):
            return function(size.rescaled(deviations + by[np.argsort(order)]).bones(params))

        slopes = slopes.reshape(-1, count)
        check_jacobian(moved, slopes, np.zeros(count), None, names, rtol=0.0, atol=atol)

    bones = size.rescaled(deviations).bones(params)
    fields = size.fields(bones, order)
    arm, off = bones.to_world(every, local) - bones.reference, centres(bones) - bones.reference
    gradient = fields.joints[:, 3:].reshape(-1, 3, 3, count)
    on = gradient[flesh.bone]
    moved = fields.joints[:, :3] + np.einsum("bijk,bj->bik", gradient, arm)
    check(lambda bones: bones.to_world(every, local), moved)
    check(centres, fields.surface[flesh.bone, :3] + np.einsum("eijk,ej->eik", on, off))
    stretched = np.einsum("eijk,ejl->eilk", on, shapes(bones))
    check(shapes, stretched + stretched.swapaxes(1, 2), atol=1e-9)


def test_each_deviation_makes_a_hand_longer_as_its_slope_says(rng):
    hand = SizeParameters(load_model(scale=HAND), ("wrist",))
    there = 0.5 * rng.normal(size=len(hand.names))
    slope = hand_length_slope(hand, hand.scale(there))
    check_gradient(lambda d: hand_length_mm(hand.rescaled(d)), slope, there, hand.names, 1e-4)


def test_an_ellipsoid_aslant_of_its_bone_is_stretched_as_its_surface_is(rng):
    turn = rotation_matrix(np.array([0.3, -0.5, 0.4]))
    one = Ellipsoids(np.array([0]), np.array([[0.01, 0.02, 0.0]]), turn[None], np.array([[0.03, 0.01, 0.02]]))  # fmt: skip
    factors = np.array([[1.2, 0.9, 0.7]])
    found = one.scaled(factors, np.array([[0.0, 0.001, 0.0]]))
    way = rng.normal(size=(50, 3))
    surface = one.centre + (way / np.linalg.norm(way, axis=1, keepdims=True) * one.radii) @ turn.T
    there = (surface * factors + [0.0, 0.001, 0.0] - found.centre) @ found.rotation[0]
    assert_allclose(((there / found.radii) ** 2).sum(axis=1), 1.0, atol=1e-12)
    assert np.linalg.det(found.rotation[0]) == pytest.approx(1.0)
