"""What is seen becomes less: masks end, or an object comes before the hand. The hand goes on from the pose it has."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from handtrack import (
    Keypoints,
    Observation,
    PointCloud,
    Session,
    Status,
    Tracker,
    TrackerSettings,
    TrackingRun,
    load_model,
)
from handtrack.model.articulated import keypoint_names
from handtrack.simulation.scenes.simulated_views import mask_views
from handtrack.simulation.simulate import simulated_rig
from handtrack.terms.clouds import hidden
from handtrack.tracking.frame.frame_terms import frame_terms
from handtrack.tracking.frame.terms.cloud_terms import see_cloud
from handtrack.tracking.search.keypoint_start import fit_keypoints
from handtrack.tracking.sequence import track_frames
from tests.tracking.scenes import followed, inside_stated, on_surface

MODEL = load_model()
EYE = np.array([0.0, 0.0, -0.5])
FRAMES, MOVED_M = 6, 0.004
CURL = [MODEL.parameter_names.index(f"{f}_pip_flex") for f in ("index", "middle")]
NOTHING = np.zeros((0, 3))
FINGERS = [n for n, name in enumerate(MODEL.joint_names) if name.split("_")[0] in ("index", "middle") and "mcp" not in name]  # fmt: skip


@cache
def pose(frame):
    """Return the hand as it moves aside, two fingers bending while they are hidden (P,)."""
    params = MODEL.rest_params()
    params[:3] = [MOVED_M * frame, -0.09, 0.0]
    params[CURL] += 0.03 * frame
    return params


@cache
def measured(frame):
    """Return the points of the hand that a camera at EYE sees (N, 3)."""
    rng = np.random.default_rng(frame)
    points, _ = on_surface(MODEL, pose(frame), 6000, rng, EYE)
    return points + rng.normal(scale=1e-3, size=points.shape)


def plate(middle, breadth, height=None):
    """Return points (N, 3) on a plate across the line of sight."""
    sides = (np.arange(-s / 2, s / 2, 0.0025) for s in (breadth, height or breadth))
    x, y = (one.ravel() for one in np.meshgrid(*sides))
    return middle + np.column_stack([x, y, np.zeros(len(x))])


def seen(frame, others=NOTHING):
    """Return what the camera sees of the hand and of other points (N, 3), the nearer hiding the further."""
    hand = measured(frame)
    if len(others):
        others, hand = others[~hidden(others, hand, EYE)], hand[~hidden(hand, others, EYE)]
    cloud = PointCloud(np.concatenate([hand, others]))
    return Observation(frame, frame / 25.0, cloud=cloud, cloud_views=(EYE[None],))


def tracked(observations):
    return followed(Tracker(MODEL), observations, pose(0))


def errors_m(result):
    return result.joint_positions - MODEL.joint_positions(MODEL.bones(pose(result.frame)))


@cache
def object_before(frame):
    """Return a plate that hides the ends of two fingers, 55 mm before them."""
    middle = MODEL.joint_positions(MODEL.bones(pose(frame)))[FINGERS].mean(axis=0)
    return plate(middle + 0.11 * (EYE - middle), 0.06)


@pytest.fixture(scope="module")
def behind():
    return tracked([seen(0)] + [seen(f, object_before(f)) for f in range(1, FRAMES)])


def test_an_object_before_the_hand_pulls_no_finger(behind):
    """Fingers that it hides stay about where they were, by what is stated of them, which grows; all others are measured."""
    others = [n for n in range(len(MODEL.joint_names)) if n not in FINGERS]
    for result in behind[1:]:
        off = errors_m(result)
        assert np.linalg.norm(off[others], axis=1).mean() < 0.004
        assert np.linalg.norm(off[FINGERS], axis=1).max() < 0.02
    assert inside_stated(result, MODEL, pose(result.frame))[FINGERS].mean() >= 0.9
    begun, own = (
        np.trace(one.joint_covariance[FINGERS], axis1=1, axis2=2).mean()
        for one in (behind[0], result)
    )
    assert own > 4.0 * begun


def test_what_an_object_before_the_hand_hides_is_not_missing_and_what_is_behind_it_hides_nothing():
    def asked(others):
        found = see_cloud(seen(1, others), MODEL, MODEL.bones(pose(1)), TrackerSettings())
        return len(found.emptiness.bone)

    middle = measured(1).mean(axis=0)
    free = asked(NOTHING)
    assert asked(object_before(1)) < 0.95 * free
    assert asked(plate(middle - 0.07 * (EYE - middle), 0.06)) == free


def test_a_hand_goes_on_where_masks_end_that_cut_its_cloud():
    """From then on the cloud has a wall close behind it and a thing as large as a hand aside, many times its points."""
    wall = plate(measured(0).mean(axis=0) + [0.0, 0.0, 0.06], 0.4)
    thing = plate(measured(0).mean(axis=0) + [0.24, 0.0, 0.0], 0.09, 0.18)
    rest = np.concatenate([wall, thing])
    found = tracked([seen(f, rest if f > 1 else NOTHING) for f in range(FRAMES)])
    for result in found:
        assert result.status != Status.LOST
        assert np.linalg.norm(errors_m(result), axis=1).mean() < 0.008


def test_a_real_hand_goes_on_where_its_joints_end(data_dir):
    """Three infrared pairs of a room; the joints of a detector end as the hand moves fastest, and another place was found for it."""
    folder = data_dir / "sessions" / "d405_real_stereo"
    values = {"model.fit_size": "false", "model.forearm": "true", "tracker.estimate": "forward"}
    run = TrackingRun.open(Session.open(folder), values)
    with np.load(folder / "reference_dlt.npz") as file:
        joints = dict(zip(file["frame"].tolist(), file["keypoints21"], strict=True))
    first, ends, frames = 59, 60, range(59, 62)
    start = fit_keypoints(run.model, Keypoints(keypoint_names(), joints[first], 0.005))

    def observe(frame, bones=None):
        found = run.observation(frame, bones)
        return found if frame < ends else replace(found, keypoints=())

    for result in track_frames(run.tracker, observe, first, start, frames):
        assert result.status != Status.LOST
        off = np.linalg.norm(result.keypoints21 - joints[result.frame], axis=1)
        assert np.nanmean(off) < 0.04


def test_a_mask_that_shows_a_shadow_is_left_out_where_the_others_fit():
    truth = pose(0)
    masks = list(mask_views(MODEL, truth, simulated_rig(5, (320, 240)).cameras).silhouettes)
    shadow = np.zeros_like(masks[2].mask)
    shadow[5:30, 5:40] = 1.0
    masks[2] = replace(masks[2], mask=shadow)

    def looked_at(params):
        seen = Observation(0, 0.0, silhouettes=tuple(masks))
        terms = frame_terms(MODEL, TrackerSettings(), seen, MODEL.bones(params), None)
        return [one.camera.name for one in terms.prepared]

    elsewhere = truth + np.eye(len(truth))[0] * 0.3
    names = [one.camera.name for one in masks]
    assert looked_at(truth) == [*names[:2], *names[3:]]
    assert looked_at(elsewhere) == names, "a hand that is lost in all of them tells nothing of one"
