"""When a frame is tracked, doubtful or lost, on both sides of each bound, against pixels, points and joints counted by hand."""

from dataclasses import replace
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from handtrack import (
    HandScale,
    ImageKeypoints,
    Keypoints,
    Observation,
    PointCloud,
    Status,
    Tracker,
    TrackerSettings,
    TrackerState,
    load_model,
)
from handtrack.model.articulated import keypoint_names
from handtrack.model.metaballs import MetaballSurface
from handtrack.simulation.scenes.simulated_views import mask_views
from handtrack.simulation.simulate import simulated_rig
from handtrack.tracking.frame.confidence import (
    assess,
    energy_ratio,
    part_outside,
    what_is_open,
)
from handtrack.tracking.frame.frame_terms import frame_terms
from handtrack.tracking.search.frame_solve import why_fingers_may_be_lost
from handtrack.tracking.search.global_search import why_hand_may_be_lost
from tests.tracking.scenes import joints_seen, on_surface

MODEL = load_model()
CAMERAS = simulated_rig(3, (320, 240)).cameras
POSE = MODEL.rest_params()
POSE[1] = -0.09
KEYPOINTS = MODEL.keypoints21(MODEL.bones(POSE))


def shifted(metres):
    return POSE + metres * np.eye(len(POSE))[0]


TRACKED, DOUBTFUL, LOST = Status.TRACKED, Status.DOUBTFUL, Status.LOST


@pytest.fixture(scope="module")
def seen():
    return mask_views(MODEL, POSE, CAMERAS)


def assessed(observation, params=POSE, energy=10.0, previous=()):
    """Return status and reason."""
    bones = MODEL.bones(params)
    terms = frame_terms(MODEL, TrackerSettings(), observation, bones, None)
    return assess(terms, bones, energy, previous)


def test_a_forearm_longer_than_the_mask_is_no_lost_part(seen):
    """Nobody knows where a sleeve begins."""
    whole = load_model(forearm=True)
    params = np.insert(POSE, 6, [0.0, 0.0])
    terms = frame_terms(whole, TrackerSettings(), seen, whole.bones(params), None)
    assert part_outside(terms, whole.bones(params)) is None


def test_a_hand_out_of_all_views_is_lost(seen):
    nothing = [replace(s, mask=np.zeros_like(s.mask)) for s in seen.silhouettes]
    assert assessed(replace(seen, silhouettes=tuple(nothing)), shifted(2.0))[0] == LOST


@pytest.mark.parametrize(
    ("angles", "rim_px", "expected"),
    [
        ({}, 0, TRACKED),
        ({}, 1, TRACKED),
        ({"thumb_cmc_abd": -0.7, "thumb_cmc_flex": 0.6, "thumb_ip_flex": 0.9}, 0, DOUBTFUL),
        ({"index_mcp_flex": 1.2, "index_pip_flex": 1.2, "index_dip_flex": 0.8}, 0, DOUBTFUL),
    ],
)
def test_a_finger_that_is_elsewhere_is_doubtful_in_a_single_frame(seen, angles, rim_px, expected):
    pose = POSE.copy()
    for name, angle in angles.items():
        pose[MODEL.skeleton.parameter(name)] += angle
    masks = [cv2.dilate(s.mask, np.ones((2 * rim_px + 1,) * 2)) for s in seen.silhouettes]
    wide = [replace(s, mask=m) for s, m in zip(seen.silhouettes, masks, strict=True)]
    assert assessed(replace(seen, silhouettes=tuple(wide)), MODEL.clipped(pose))[0] == expected


@pytest.mark.parametrize(("off_m", "expected"), [(0.0, TRACKED), (1.0, LOST)])
def test_points_in_space_alone_say_whether_a_pose_meets_them(off_m, expected):
    given = Keypoints(keypoint_names(), KEYPOINTS + off_m, 0.005)
    assert assessed(Observation(0, 0.0, (), (given,)))[0] == expected


def test_a_finger_that_a_mask_lacks_is_where_a_detector_sees_it(seen):
    """Joints in the same image say so; not in another one, nor joints that lie elsewhere."""
    camera = seen.silhouettes[0].camera
    tip = KEYPOINTS[keypoint_names().index("index_tip")]
    row, column = camera.project(tip).round().astype(int)[::-1]
    mask = seen.silhouettes[0].mask.copy()
    mask[max(row - 20, 0) : row + 21, max(column - 20, 0) : column + 21] = 0.0
    lacking = replace(seen, silhouettes=(replace(seen.silhouettes[0], mask=mask),))
    other = CAMERAS[1].without_distortion()
    for joints, expected in (
        ((), DOUBTFUL),
        (joints_seen([camera], KEYPOINTS), TRACKED),
        (joints_seen([other], KEYPOINTS), DOUBTFUL),
        (joints_seen([camera], KEYPOINTS, 20.0), DOUBTFUL),
    ):
        assert assessed(replace(lacking, keypoints=joints))[0] == expected


@pytest.mark.parametrize(
    ("scale", "impossible"),
    [
        (HandScale(1.27), True),
        (HandScale(0.5), True),
        (HandScale(1.0, {"index": 1.2}), False),  # an odd finger may be a mask's; doctor says so
        (HandScale(0.6), False),
    ],
)
def test_a_hand_that_cannot_be_is_not_tracked(scale, impossible):
    """However well it fits: 237 mm were, from a wrong lens."""
    model = load_model(scale=scale)
    seen = mask_views(model, POSE, CAMERAS)
    _, result = Tracker(model).step(TrackerState.beginning_at(POSE), seen)
    assert (result.status == DOUBTFUL) == ("100 to 225" in result.note) == impossible
    assert result.fits, "nothing is gained by looking for another pose"


def seen_by(cameras, frame):
    """Return all joints as these cameras see them."""
    return Observation(frame, frame / 30.0, (), joints_seen(cameras, KEYPOINTS, sigma_px=5.0))


def test_a_single_camera_leaves_the_hand_open_and_nothing_else_changes():
    """Doubt about what was not seen is said; it moves no pose, and nothing is looked for."""
    told, silent = (
        Tracker(MODEL, TrackerSettings().with_values({"tracker.doubtful_mm": most}))
        for most in (15.0, 0.0)
    )
    begun = TrackerState.beginning_at(shifted(0.002))
    stepped = [t.step(begun, seen_by(CAMERAS[:1], 0)) for t in (told, silent)]
    doubted, tracked = results = [result for _, result in stepped]
    assert doubted.status == DOUBTFUL
    assert "the whole hand: ± " in doubted.note
    assert tracked.status == TRACKED
    assert doubted.parameters.tobytes() == tracked.parameters.tobytes()
    assert doubted.fits
    assert why_hand_may_be_lost(doubted, results) == ""
    pairs = zip((told, silent), stepped, strict=True)
    after = [t.step(state, seen_by(CAMERAS, 1))[1] for t, (state, _) in pairs]
    assert {r.status for r in after} == {TRACKED}
    assert after[0].parameters.tobytes() == after[1].parameters.tobytes()


@pytest.mark.parametrize(
    ("cameras", "off_px", "expected"),
    [(0, 0.0, LOST), (1, 0.0, LOST), (2, 0.0, DOUBTFUL), (2, 30.0, LOST)],
)  # fmt: skip
def test_a_hand_where_two_cameras_see_its_joints_is_not_lost(cameras, off_px, expected):
    """Whatever masks show: these are of a hand half a metre beside."""
    joints = joints_seen(CAMERAS[:cameras], KEYPOINTS, off_px)
    seen = replace(mask_views(MODEL, shifted(0.5), CAMERAS), keypoints=joints)
    assert assessed(seen)[0] == expected


# --- outlines as a whole


@pytest.mark.parametrize(
    ("shares", "expected"),
    [
        ((0.8, 0.7, 0.9), None),
        ((0.8, 0.6, 0.9), DOUBTFUL),  # the worst view is enough for a doubt
        ((0.4, 0.5, 0.9), DOUBTFUL),
        ((0.4, 0.4, 0.9), LOST),  # the middle one decides whether it is lost
        ((0.3, 0.95, 0.95), None),  # hardly a hand, which both others contradict
    ],
)
def test_the_worst_view_doubts_and_the_middle_one_loses(seen, shares, expected):
    """Of the hand only the first share of the pixels, from above, is in each one's mask."""
    cut = []
    for silhouette, share in zip(seen.silhouettes, shares, strict=True):
        mask = silhouette.mask.copy()
        inside = np.flatnonzero(mask > 0)
        mask.ravel()[inside[round(share * len(inside)) :]] = 0.0
        cut.append(replace(silhouette, mask=mask))
    status, reason = assessed(replace(seen, silhouettes=tuple(cut)))
    assert (status if reason and reason.kind == "overlap" else None) == expected


# --- a part of the model outside its silhouette


def index_bent(mcp, others):
    pose = POSE.copy()
    for joint, angle in (("mcp", mcp), ("pip", others), ("dip", others)):
        pose[MODEL.skeleton.parameter(f"index_{joint}_flex")] = angle
    return pose


STRETCHED, FOLDED = index_bent(-0.4, 0.0), index_bent(1.4, 1.4)


def outside(silhouettes):
    """Return what of the hand with the index finger stretched lies outside."""
    seen, bones = Observation(0, 0.0, tuple(silhouettes)), MODEL.bones(STRETCHED)
    return part_outside(frame_terms(MODEL, TrackerSettings(), seen, bones, None), bones)


def cameras(count, size):
    """Return up to three; the last one sees a folded finger before the palm."""
    return simulated_rig(3, size).cameras[::-1][:count]


@pytest.mark.parametrize(
    ("size", "doubtful"), [((320, 240), True), ((88, 66), True), ((60, 45), False)]
)
def test_a_finger_outside_is_told_from_thirty_pixels_on(size, doubtful):
    """The model's index finger is stretched, the hand's is folded; seen smaller and smaller."""
    (silhouette,) = mask_views(MODEL, FOLDED, cameras(1, size)).silhouettes
    found = outside([silhouette])
    assert (found is not None) == doubtful
    assert not doubtful or (found.camera == "cam2" and found.number > 0.5)


@pytest.mark.parametrize(
    ("wrong", "doubtful"),
    [((1, 0), True), ((1, 0, 0), False), ((1, 1, 0), True), ((0, 0, 0), False)],
)
def test_of_three_views_two_must_say_that_a_finger_is_outside(wrong, doubtful):
    views = cameras(len(wrong), (320, 240))
    both = [mask_views(MODEL, pose, views).silhouettes for pose in (STRETCHED, FOLDED)]
    assert (outside(both[w][n] for n, w in enumerate(wrong)) is not None) == doubtful


# --- joints and clouds


def seen_joints(near, count):
    """Return so many joints as one camera sees them: some beside by nearly four sigmas, the others by more."""
    camera, names = CAMERAS[2], MODEL.joint_names[:count]
    pixels = camera.project(MODEL.joint_positions(MODEL.bones(POSE))[:count])
    pixels[:, 0] += 2.0 * np.where(np.arange(count) < near, 3.9, 4.1)
    return ImageKeypoints(camera, names, pixels, 2.0)


@pytest.mark.parametrize(("near", "expected"), [(20, TRACKED), (14, TRACKED), (13, DOUBTFUL), (7, DOUBTFUL), (6, LOST)])  # fmt: skip
def test_joints_are_counted_that_lie_within_four_sigmas(near, expected):
    status, reason = assessed(Observation(0, 0.0, (), (seen_joints(near, 20),)))
    assert status == expected
    told = None if expected == TRACKED else (near / 20, 20)
    assert (reason and (reason.number, reason.other)) == told


def test_joints_in_space_count_by_the_same_sigmas():
    """Ten seen in an image, all near; ten given in space: of 3.9 σ off each in three directions none is near."""
    places = MODEL.joint_positions(MODEL.bones(POSE))[:10]
    for offset, expected in (([0.0, 0.0, 0.0195], TRACKED), ([0.0195, 0.0195, 0.0195], DOUBTFUL)):
        given = Keypoints(MODEL.joint_names[:10], places + offset, 0.005)
        observation = Observation(0, 0.0, (), (seen_joints(10, 10), given))
        assert assessed(observation)[0] == expected


@pytest.mark.parametrize(("share", "expected"), [(0.72, TRACKED), (0.68, DOUBTFUL), (0.37, DOUBTFUL), (0.33, LOST)])  # fmt: skip
def test_points_are_counted_that_lie_within_six_millimetres(share, expected):
    points, normals = on_surface(MODEL, POSE, 3000, np.random.default_rng(1))

    def away(metres):
        """Return points so far off; between fingers another one is nearer: those are left out."""
        moved = points + metres * normals
        found = MetaballSurface.of(MODEL).distance(MODEL.bones(POSE), moved)
        return moved[np.abs(found - metres) < 2e-4]

    count = round(1000 * share)
    cloud = PointCloud(np.concatenate([away(0.0055)[:count], away(0.0065)[: 1000 - count]]))
    assert len(cloud.points) == 1000
    status, reason = assessed(Observation(0, 0.0, cloud=cloud))
    assert status == expected
    told = None if expected == TRACKED else pytest.approx(share, abs=0.005)
    assert (reason and reason.number) == told


# --- beside the frames before


def is_suspicious(energy, previous):
    return why_fingers_may_be_lost(1, energy, 1, previous) != ""


def frames(*energies, status=TRACKED, views=0):
    fits = status == TRACKED
    return [SimpleNamespace(energy=e, status=status, fits=fits, views=views) for e in energies]


@pytest.mark.parametrize(
    ("energy", "views", "previous", "expected"),
    [
        (90.0, 1, frames(30.0, 30.0), 1.0),  # two frames tell nothing
        (90.0, 1, frames(30.0, 30.0, 30.0), 3.0),
        # five tracked frames are enough to go by: those in doubt do not count
        (90.0, 1, [*frames(*[90.0] * 9, status=DOUBTFUL), *frames(*[30.0] * 5)], 3.0),
        # the lower quartile of the last thirty frames: one of the first eight is too old
        (90.0, 1, [*frames(*[30.0] * 8), *frames(*[45.0] * 23)], 2.0),
        # 15 a view, however little was usual
        (90.0, 3, frames(*[5.0] * 9), 2.0),
        (90.0, 3, frames(*[5.0] * 9, status=LOST), 1.0),
        # two views cost twice as much as one: that is no lost finger
        (100.0, 2, frames(*[50.0] * 9, views=1), 1.0),
    ],
)
def test_what_is_usual(energy, views, previous, expected):
    assert energy_ratio(energy, views, previous) == pytest.approx(expected)


def test_suspicion_begins_at_1_4_times_the_usual_and_doubt_at_twice(seen):
    usual = frames(*[100.0] * 9)
    assert [is_suspicious(energy, usual) for energy in (139.0, 141.0)] == [False, True]
    one = replace(seen, silhouettes=seen.silhouettes[2:])
    assert assessed(one, energy=199.0, previous=usual)[0] == TRACKED
    assert assessed(one, energy=201.0, previous=usual)[0] == DOUBTFUL
    calm = frames(100.0, 100.0)
    assert [is_suspicious(1.0, calm[:n]) for n in (0, 2)] == [True, True]
    assert not is_suspicious(1.0, [*calm, *calm[:1]])
    # of a row that fits badly some are searched, ever fewer
    rows = [is_suspicious(150.0, [*usual, *frames(*[150.0] * n)]) for n in range(9)]
    assert np.flatnonzero(rows).tolist() == [0, 1, 3, 7]
    calmed = [*usual, *frames(150.0, 150.0, 100.0)]
    assert is_suspicious(150.0, calmed)


# --- what is left open


COUNT = len(MODEL.joint_names)
FAR = np.sqrt((15.2**2 * COUNT - (COUNT - 3)) / 3)
BASES = {"index_mcp": 1, "middle_mcp": 1, "thumb_cmc": 1}


@pytest.mark.parametrize(
    ("mm_by_part", "said"),
    [
        ({"": 14.9}, ""),
        ({"": 15.1}, "the whole hand: ± 15 mm"),
        ({"middle_mcp": 1, "middle": FAR}, f"constrain the middle finger: ± {FAR:.0f} mm"),
        ({**BASES, "index": 50, "middle": 50, "thumb": 50}, "constrain the thumb, index and middle finger: ± 50 mm"),
        ({"wrist": 90, "thumb_cmc": 90}, "the whole hand"),
    ],
)  # fmt: skip
def test_what_is_open_is_the_root_mean_square_of_joints_and_names_its_parts(mm_by_part, said):
    """1 mm in all joints, and more in those whose names begin so."""
    total = [next((v for k, v in mm_by_part.items() if n.startswith(k)), 1) for n in MODEL.joint_names]  # fmt: skip
    spread = (1e-3 * np.array(total))[:, None, None] ** 2 * np.diag([0.2, 0.3, 0.5])
    reason = what_is_open(MODEL, spread, 15.0)
    assert bool(reason) == bool(said) and said in (reason.words if reason else "")
