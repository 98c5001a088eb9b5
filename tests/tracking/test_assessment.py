"""When a frame is tracked, doubtful or lost, on both sides of each bound, against pixels, points and joints counted by hand."""

from dataclasses import replace
from types import SimpleNamespace

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
from handtrack.model.flesh import model_mask
from handtrack.model.surfaces.metaballs import MetaballSurface
from handtrack.model.surfaces.surface_mesh import sample_surface
from handtrack.simulation.scenes.simulated_views import mask_views
from handtrack.simulation.simulate import simulated_rig
from handtrack.tracking.frame import assessment
from handtrack.tracking.frame.assessment import (
    assess,
    energy_ratio,
    part_outside,
    what_is_open,
)
from handtrack.tracking.frame.frame_terms import frame_terms
from handtrack.tracking.search.policy import why_fingers_may_be_lost, why_hand_may_be_lost

MODEL = load_model()
CAMERAS = simulated_rig(3, (320, 240)).cameras
POSE = MODEL.rest_params()
POSE[1] = -0.09


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


STRETCHED = POSE.copy()
for _joint, _angle in (("mcp_flex", -0.4), ("pip_flex", 0.0), ("dip_flex", 0.0)):
    STRETCHED[MODEL.skeleton.parameter(f"index_{_joint}")] = _angle
FOLDED = POSE.copy()
for _joint in ("mcp_flex", "pip_flex", "dip_flex"):
    FOLDED[MODEL.skeleton.parameter(f"index_{_joint}")] = 1.4
TRACKED, DOUBTFUL, LOST = Status.TRACKED, Status.DOUBTFUL, Status.LOST
ANY_OUTLINE = {"DOUBTFUL_OVERLAP": 0.0, "LOST_OVERLAP": 0.0}


def assessed(observation, params=POSE, energy=10.0, previous=(), **bounds):
    """Return status and reason in words, with some of the assessment's bounds put elsewhere."""
    terms = frame_terms(MODEL, TrackerSettings(), observation, MODEL.bones(params), None)
    usual = {name: getattr(assessment, name) for name in bounds}
    for name, bound in bounds.items():
        setattr(assessment, name, bound)
    try:
        status, reason = assess(terms, MODEL.bones(params), energy, previous)
    finally:
        vars(assessment).update(usual)
    return status, reason.words if reason else ""


def is_suspicious(energy, views, previous):
    return why_fingers_may_be_lost(1, energy, views, previous) != ""


def cameras(count, size):
    """Return up to three; the last one sees a folded finger before the palm."""
    return simulated_rig(3, size).cameras[::-1][:count]


# --- outlines as a whole


def covered(shares):
    """Return what cameras see of a hand of which only the first share of the pixels, from above, is in each one's mask."""
    seen = mask_views(MODEL, POSE, cameras(len(shares), (320, 240)))
    cut = []
    for silhouette, share in zip(seen.silhouettes, shares, strict=True):
        mask = silhouette.mask.copy()
        inside = np.flatnonzero(mask.ravel() > 0)
        mask.ravel()[inside[round(share * len(inside)) :]] = 0.0
        cut.append(replace(silhouette, mask=mask))
    return replace(seen, silhouettes=tuple(cut))


@pytest.mark.parametrize(
    ("shares", "doubtful", "lost", "expected"),
    [
        ((0.8, 0.6, 0.9), 0.58, 0.1, TRACKED),
        ((0.8, 0.6, 0.9), 0.62, 0.1, DOUBTFUL),  # the worst view is enough for a doubt
        ((0.5, 0.6, 0.9), 0.9, 0.58, DOUBTFUL),
        ((0.5, 0.6, 0.9), 0.9, 0.62, LOST),  # the middle one decides whether it is lost
        ((0.3, 0.3, 0.9), 0.9, 0.4, LOST),
        ((0.5, 0.9, 0.9), 0.9, 0.4, DOUBTFUL),
        ((0.3, 0.95, 0.95), 0.9, 0.4, TRACKED),  # hardly a hand, which both others contradict
    ],
)
def test_the_worst_view_doubts_and_the_middle_one_loses(shares, doubtful, lost, expected):
    bounds = {"DOUBTFUL_OVERLAP": doubtful, "LOST_OVERLAP": lost}
    status, _ = assessed(covered(shares), **bounds, DOUBTFUL_PART=0.0)
    assert status == expected


# --- a part of the model outside its silhouette


def parts_outside(seen, params, least=30, below=0.5):
    """Return whether two neighbouring bones lie outside, by counting pixels: in the second worst view of three and more."""
    flesh, bones, parent = MODEL.flesh["fine"], MODEL.bones(params), MODEL.skeleton.parent
    shares, sizes = [], []
    for bone in np.unique(flesh.bone):
        part = flesh.subset((flesh.bone == bone) | (flesh.bone == parent[bone])).posed(bones)
        inside = []
        for silhouette in seen.silhouettes:
            drawn = model_mask(silhouette.camera, part)
            both = (drawn & (silhouette.mask > 0.5)).sum()
            sizes.append(drawn.sum())
            inside.append(both / drawn.sum() if drawn.sum() >= least else 1.0)
        shares.append(sorted(inside)[1 if len(inside) > 2 else 0])
    return min(shares) < below


@pytest.mark.parametrize(
    ("size", "doubtful"), [((320, 240), True), ((88, 66), True), ((60, 45), False)]
)
def test_a_finger_outside_is_told_from_thirty_pixels_on(size, doubtful):
    """The model's index finger is stretched, the hand's is folded; seen smaller and smaller."""
    seen = mask_views(MODEL, FOLDED, cameras(1, size))
    assert parts_outside(seen, STRETCHED) == doubtful, "the scene is as it is meant"
    if not doubtful:  # there are pixels enough to tell, for one who is less careful
        assert parts_outside(seen, STRETCHED, least=12)
    status, note = assessed(seen, STRETCHED, **ANY_OUTLINE)
    assert (status == DOUBTFUL) == doubtful
    assert ("outside the silhouette in cam2" in note) == doubtful
    if doubtful:  # as much as is said
        inside = 1.0 - 0.01 * float(note.split()[0].rstrip("%"))
        assert parts_outside(seen, STRETCHED, below=inside + 0.05)
        assert not parts_outside(seen, STRETCHED, below=inside - 0.05)


@pytest.mark.parametrize(
    ("wrong", "doubtful"),
    [((1, 0), True), ((1, 0, 0), False), ((1, 1, 0), True), ((0, 0, 0), False)],
)
def test_of_three_views_two_must_say_that_a_finger_is_outside(wrong, doubtful):
    views = cameras(len(wrong), (320, 240))
    folded, stretched = (mask_views(MODEL, pose, views).silhouettes for pose in (FOLDED, STRETCHED))
    chosen = tuple(f if w else s for w, f, s in zip(wrong, folded, stretched, strict=True))
    seen = Observation(0, 0.0, chosen)
    assert parts_outside(seen, STRETCHED) == doubtful
    assert (assessed(seen, STRETCHED, **ANY_OUTLINE)[0] == DOUBTFUL) == doubtful


# --- joints and clouds


def seen_joints(near, count, sigmas_off=4.1, beside=3.9):
    """Return so many joints as one camera sees them: some beside by nearly four sigmas, the others by more."""
    camera, names = cameras(1, (320, 240))[0], MODEL.joint_names[:count]
    pixels = camera.project(MODEL.joint_positions(MODEL.bones(POSE))[:count])
    pixels[:, 0] += 2.0 * np.where(np.arange(count) < near, beside, sigmas_off)
    return ImageKeypoints(camera, names, pixels, 2.0)


@pytest.mark.parametrize(("near", "expected"), [(20, TRACKED), (14, TRACKED), (13, DOUBTFUL), (7, DOUBTFUL), (6, LOST)])  # fmt: skip
def test_joints_are_counted_that_lie_within_four_sigmas(near, expected):
    status, note = assessed(Observation(0, 0.0, (), (seen_joints(near, 20),)))
    assert status == expected
    if expected != TRACKED:
        assert note.startswith(f"{5 * near} % of 20 keypoints lie within 4 sigma")


def test_joints_in_space_count_by_the_same_sigmas():
    """Ten seen in an image, all near; ten given in space: of 3.9 σ off each in three directions none is near."""
    places = MODEL.joint_positions(MODEL.bones(POSE))[:10]
    for offset, expected in (([0.0, 0.0, 0.0195], TRACKED), ([0.0195, 0.0195, 0.0195], DOUBTFUL)):
        given = Keypoints(MODEL.joint_names[:10], places + offset, 0.005)
        observation = Observation(0, 0.0, (), (seen_joints(10, 10), given))
        assert assessed(observation)[0] == expected


@pytest.mark.parametrize(("share", "expected"), [(0.72, TRACKED), (0.68, DOUBTFUL), (0.37, DOUBTFUL), (0.33, LOST)])  # fmt: skip
def test_points_are_counted_that_lie_within_six_millimetres(share, expected):
    surface, bones, rng = MetaballSurface.of(MODEL), MODEL.bones(POSE), np.random.default_rng(1)
    points, normals = sample_surface(surface, bones, 3000, rng)
    near, far = points + 0.0055 * normals, points + 0.0065 * normals
    # between fingers another one is nearer: those points are left out
    near = near[np.abs(surface.distance(bones, near) - 0.0055) < 2e-4]
    far = far[np.abs(surface.distance(bones, far) - 0.0065) < 2e-4]
    count = round(1000 * share)
    cloud = PointCloud(np.concatenate([near[:count], far[: 1000 - count]]))
    assert len(cloud.points) == 1000
    status, note = assessed(Observation(0, 0.0, cloud=cloud))
    assert status == expected
    said = f"{100 * share:.0f} % of the cloud's points lie within 6 mm of the model"
    assert note == ("" if expected == TRACKED else said)


def test_the_worse_of_outline_and_cloud_is_told():
    rng = np.random.default_rng(1)
    points, normals = sample_surface(MetaballSurface.of(MODEL), MODEL.bones(POSE), 1200, rng)
    seen = mask_views(MODEL, POSE, cameras(1, (320, 240)))
    far = replace(seen, cloud=PointCloud(points + 0.012 * normals))
    status, note = assessed(far, LOST_CLOUD=0.0)
    assert status == DOUBTFUL and "of the cloud's points" in note
    gone = MODEL.rest_params() + [0.2, *[0.0] * 25]
    assert "overlap by 0 %" in assessed(replace(far, cloud=None), gone)[1]
    half = replace(covered((0.5,)), cloud=PointCloud(points))
    status, note = assessed(half)
    assert status == DOUBTFUL and "overlap by 50 %" in note


# --- beside the frames before


def frames(*energies, status=TRACKED, views=0, fits=False):
    fits = fits or status == TRACKED
    return [SimpleNamespace(energy=e, status=status, fits=fits, views=views) for e in energies]


@pytest.mark.parametrize(
    ("energy", "views", "previous", "expected"),
    [
        (90.0, 1, frames(30.0, 30.0), 1.0),  # two frames tell nothing
        (90.0, 1, frames(30.0, 30.0, 30.0), 3.0),
        (90.0, 1, frames(30.0, 30.0, 30.0, 30.0, 30.0), 3.0),
        # the lower quartile: of five the second
        (90.0, 1, frames(20.0, 30.0, 40.0, 50.0, 60.0), 3.0),
        # five tracked frames are enough to go by, four are not: then those in doubt count too
        (90.0, 1, [*frames(*[90.0] * 9, status=DOUBTFUL), *frames(*[30.0] * 5)], 3.0),
        (90.0, 1, [*frames(*[90.0] * 29, status=DOUBTFUL)[:26], *frames(*[30.0] * 4)], 1.0),
        # the last thirty frames: a quarter of the way between the eighth and the ninth of them; then one is too old
        (90.0, 1, [*frames(*[30.0] * 8), *frames(*[45.0] * 22)], 90.0 / 33.75),
        (90.0, 1, [*frames(*[30.0] * 8), *frames(*[45.0] * 23)], 2.0),
        # 15 a view, however little was usual
        (90.0, 1, frames(*[5.0] * 9), 6.0),
        (90.0, 3, frames(*[5.0] * 9), 2.0),
        (90.0, 0, frames(*[5.0] * 9), 6.0),
        (90.0, 3, frames(*[5.0] * 9, status=LOST), 1.0),
        # two views cost twice as much as one: that is no lost finger
        (100.0, 2, frames(*[50.0] * 9, views=1), 1.0),
        (100.0, 1, frames(*[50.0] * 9, views=1), 2.0),
        # frames that only leave something open tell what is usual, too
        (
            200.0,
            3,
            [
                *frames(*[100.0] * 10, status=DOUBTFUL, fits=True),
                *frames(*[900.0] * 20, status=DOUBTFUL),
            ],
            2.0,
        ),
    ],
)
def test_what_is_usual(energy, views, previous, expected):
    assert energy_ratio(energy, views, previous) == pytest.approx(expected)


def test_suspicion_begins_at_1_4_times_the_usual_and_doubt_at_twice():
    usual = frames(*[100.0] * 9)
    assert [is_suspicious(energy, 1, usual) for energy in (139.0, 141.0)] == [False, True]
    seen = mask_views(MODEL, POSE, cameras(1, (320, 240)))
    assert assessed(seen, energy=199.0, previous=usual)[0] == TRACKED
    assert assessed(seen, energy=201.0, previous=usual)[0] == DOUBTFUL
    calm = frames(100.0, 100.0)
    assert [is_suspicious(1.0, 1, calm[:n]) for n in (0, 2)] == [True, True]
    assert not is_suspicious(1.0, 1, [*calm, *calm[:1]])
    # of a row that fits badly some are searched, ever fewer
    rows = [is_suspicious(150.0, 1, [*usual, *frames(*[150.0] * n)]) for n in range(9)]
    assert np.flatnonzero(rows).tolist() == [0, 1, 3, 7]
    calmed = [*usual, *frames(150.0, 150.0, 100.0)]
    assert is_suspicious(150.0, 1, calmed)


# --- what is left open


def spread(**metres_by_part):
    """Return (J, 3, 3): 1 mm in all, and more for joints whose names begin so."""
    total = [next((v for k, v in metres_by_part.items() if n.startswith(k)), 1e-3) for n in MODEL.joint_names]  # fmt: skip
    return np.array(total)[:, None, None] ** 2 * np.diag([0.2, 0.3, 0.5])


def open_parts(*what):
    """Return in words what of the model is open."""
    reason = what_is_open(*what)
    return reason.words if reason else ""


def test_what_is_open_is_the_root_mean_square_of_joints_and_names_its_parts():
    every = dict.fromkeys(MODEL.joint_names, 0.0149)
    assert open_parts(MODEL, spread(**every), 15.0) == ""
    every = dict.fromkeys(MODEL.joint_names, 0.0151)
    assert open_parts(MODEL, spread(**every), 15.0).endswith("the whole hand: ± 15 mm")
    count = len(MODEL.joint_names)
    far = np.sqrt((15.2**2 * count - (count - 3)) / 3)
    said = open_parts(MODEL, spread(middle_mcp=1e-3, middle=1e-3 * far), 15.0)
    assert said == f"the observations do not constrain the middle finger: ± {far:.0f} mm"
    said = open_parts(
        MODEL, spread(index_mcp=1e-3, middle_mcp=1e-3, thumb_cmc=1e-3, index=0.05, middle=0.05, thumb=0.05), 15.0
    )  # fmt: skip
    assert said == "the observations do not constrain the thumb, index and middle finger: ± 50 mm"
    palm = spread(wrist=0.09, thumb_cmc=0.09)
    assert "the whole hand" in open_parts(MODEL, palm, 15.0)
