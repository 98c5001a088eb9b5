"""When a frame is tracked, doubtful or lost, and what is said of it."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from handtrack import (
    HandScale,
    ImageKeypoints,
    Keypoints,
    Observation,
    Status,
    Tracker,
    TrackerSettings,
    TrackerState,
    load_model,
)
from handtrack.model.articulated import keypoint_names
from handtrack.simulation.scenes.simulated_views import mask_views
from handtrack.simulation.simulate import simulated_rig
from handtrack.tracking.frame.assessment import (
    assess,
    energy_ratio,
    part_outside,
    what_is_open,
)
from handtrack.tracking.frame.frame_terms import frame_terms
from handtrack.tracking.search.policy import why_hand_may_be_lost

MODEL = load_model()
CAMERAS = simulated_rig(3, (320, 240)).cameras
POSE = MODEL.rest_params()
POSE[1] = -0.09


def assessed(observation, params=POSE, energy=10.0, previous=(), **settings):
    chosen = TrackerSettings().with_values(settings)
    terms = frame_terms(MODEL, chosen, observation, MODEL.bones(params), None)
    status, reason = assess(terms, MODEL.bones(params), energy, previous)
    return status, reason.words if reason else ""


def open_parts(model, joint_covariance, most_mm):
    """Return in words what of the model is open."""
    reason = what_is_open(model, joint_covariance, most_mm)
    return reason.words if reason else ""


def earlier(energy, count=20, status=Status.TRACKED, views=0):
    fits = status == Status.TRACKED
    return [SimpleNamespace(energy=energy, status=status, fits=fits, views=views)] * count


def shifted(metres):
    params = POSE.copy()
    params[0] += metres
    return params


@pytest.fixture(scope="module")
def seen():
    return mask_views(MODEL, POSE, CAMERAS)


def test_a_forearm_longer_than_the_mask_is_no_lost_part(seen):
    """Nobody knows where a sleeve begins."""
    whole = load_model(forearm=True)
    params = np.insert(POSE, 6, [0.0, 0.0])
    terms = frame_terms(whole, TrackerSettings(), seen, whole.bones(params), None)
    assert part_outside(terms, whole.bones(params)) is None


def test_a_hand_out_of_all_views_is_lost(seen):
    nothing = [replace(s, mask=np.zeros_like(s.mask)) for s in seen.silhouettes]
    status, note = assessed(replace(seen, silhouettes=tuple(nothing)), shifted(2.0))
    assert status == Status.LOST
    assert note == "model and silhouette are outside all views"


def test_keypoints_alone_are_doubtful():
    points = MODEL.joint_positions(MODEL.bones(POSE))
    given = Observation(0, 0.0, (), (Keypoints(MODEL.joint_names, points, 0.005),))
    status, note = assessed(given)
    assert status == Status.DOUBTFUL
    assert note == "no observation; only the input keypoints constrain the pose"


def test_energies_are_compared_a_view():
    """Two views cost twice as much as one: that is no lost finger."""
    one_view = earlier(50.0, views=1)
    assert energy_ratio(100.0, 2, one_view) == pytest.approx(1.0)
    assert energy_ratio(100.0, 1, one_view) == pytest.approx(2.0)


def spread_mm(model, **by_joint):
    """Return joint covariances (J, 3, 3): 2 mm in all, and what is given for joints whose names begin so."""
    total = [
        next((v for k, v in by_joint.items() if n.startswith(k)), 2.0) for n in model.joint_names
    ]
    return np.array(total)[:, None, None] ** 2 * 1e-6 * np.eye(3) / 3.0


def test_a_finger_that_a_mask_lacks_is_where_a_detector_sees_it(seen):
    """Joints in the same image say so; not in another one, nor joints that lie elsewhere."""
    bones = MODEL.bones(POSE)
    tip, camera = MODEL.joint_names.index("index_tip"), seen.silhouettes[0].camera
    points = MODEL.joint_positions(bones)
    row, column = camera.project(points[tip]).round().astype(int)[::-1]
    mask = seen.silhouettes[0].mask.copy()
    mask[max(row - 20, 0) : row + 21, max(column - 20, 0) : column + 21] = 0.0
    lacking = replace(seen, silhouettes=(replace(seen.silhouettes[0], mask=mask),))
    status, note = assessed(lacking)
    assert status == Status.DOUBTFUL
    assert "outside the silhouette" in note

    def with_joints(camera, moved=0.0):
        pixels = camera.project(points) + moved
        return replace(lacking, keypoints=(ImageKeypoints(camera, MODEL.joint_names, pixels, 2.0),))

    assert assessed(with_joints(camera)) == (Status.TRACKED, "")
    assert assessed(with_joints(CAMERAS[1].without_distortion()))[0] == Status.DOUBTFUL
    assert assessed(with_joints(camera, 20.0))[0] == Status.DOUBTFUL


@pytest.mark.parametrize(
    ("scale", "said"),
    [
        (HandScale(1.27), "mm from wrist to fingertip, not 100 to 225"),
        (HandScale(0.5), "mm from wrist to fingertip, not 100 to 225"),
        (HandScale(1.0, {"index": 1.2}), ""),  # an odd finger may be a mask's; doctor says so
        (HandScale(1.15, {"index": 1.08, "little": 0.95}), ""),
        (HandScale(0.6), ""),
    ],
)
def test_a_hand_that_cannot_be_is_not_tracked(scale, said):
    """However well it fits: 237 mm were, from a wrong lens."""
    model = load_model(scale=scale)
    seen = mask_views(model, POSE, CAMERAS)
    _, result = Tracker(model).step(TrackerState.beginning_at(POSE), seen)
    assert (result.status == Status.DOUBTFUL) == bool(said)
    assert said in result.note
    assert result.fits, "nothing is gained by looking for another pose"


@pytest.mark.parametrize("name", ["glove9", "ball6"])
def test_a_hand_of_few_joints_is_open_as_a_whole(name):
    model = load_model(name)
    far = spread_mm(model, **dict.fromkeys(model.joint_names, 30.0))
    assert (
        open_parts(model, far, 15.0) == "the observations do not constrain the whole hand: ± 30 mm"
    )


def seen_by(cameras, frame):
    """Return all joints as these cameras see them."""
    points = MODEL.joint_positions(MODEL.bones(POSE))
    views = [ImageKeypoints(c, MODEL.joint_names, c.project(points), 5.0) for c in cameras]
    return Observation(frame, frame / 30.0, (), tuple(views))


def test_a_single_camera_leaves_the_hand_open_and_nothing_else_changes():
    """Doubt about what was not seen is said; it moves no pose, and nothing is looked for."""
    told, silent = (
        Tracker(MODEL, TrackerSettings().with_values({"tracker.doubtful_mm": most}))
        for most in (15.0, 0.0)
    )
    begun = TrackerState.beginning_at(shifted(0.002))
    stepped = [t.step(begun, seen_by(CAMERAS[:1], 0)) for t in (told, silent)]
    doubted, tracked = results = [result for _, result in stepped]
    assert doubted.status == Status.DOUBTFUL
    assert doubted.note.startswith("the observations do not constrain the whole hand: ± ")
    assert tracked.status == Status.TRACKED
    assert doubted.parameters.tobytes() == tracked.parameters.tobytes()
    assert doubted.fits
    assert why_hand_may_be_lost(doubted, results) == ""
    pairs = zip((told, silent), stepped, strict=True)
    after = [t.step(state, seen_by(CAMERAS, 1))[1] for t, (state, _) in pairs]
    assert {r.status for r in after} == {Status.TRACKED}
    assert after[0].parameters.tobytes() == after[1].parameters.tobytes()


def test_frames_that_only_leave_something_open_tell_what_is_usual():
    doubted = SimpleNamespace(energy=100.0, status=Status.DOUBTFUL, fits=True, views=0)
    unknown = [doubted] * 10
    assert energy_ratio(200.0, 3, unknown + earlier(900.0, 20, Status.DOUBTFUL)) == pytest.approx(
        2.0
    )


@pytest.mark.parametrize(
    ("cameras", "off_px", "expected"),
    [(0, 0.0, Status.LOST), (1, 0.0, Status.LOST), (2, 0.0, Status.DOUBTFUL), (2, 30.0, Status.LOST)],
)  # fmt: skip
def test_a_hand_where_two_cameras_see_its_joints_is_not_lost(cameras, off_px, expected):
    """Whatever masks show: these are of a hand half a metre beside."""
    beside = POSE + 0.5 * np.eye(len(POSE))[0]
    bones = MODEL.bones(POSE)
    places = MODEL.joint_positions(bones)[[MODEL.joint_names.index(n) for n in keypoint_names()]]
    joints = tuple(
        ImageKeypoints(c, keypoint_names(), c.project(places) + off_px, 2.0)
        for c in CAMERAS[:cameras]
    )
    seen = replace(mask_views(MODEL, beside, CAMERAS), keypoints=joints)
    assert assessed(seen)[0] == expected
