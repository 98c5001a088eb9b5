"""A pose that is pulled at: a joint lies on the ray, the rest is held by masks or changes least; and pins in a track."""

from dataclasses import replace

import numpy as np

from handtrack import Keypoints, Observation, Tracker, TrackerSettings, load_model
from handtrack.observation.pins import ImagePins, Pin
from handtrack.simulation.scenes.simulated_views import mask_views
from handtrack.simulation.simulate import simulated_rig
from handtrack.tracking.pulling import pulled
from handtrack.tracking.sequence import refine_recording, track_frames
from tests.tracking.scenes import bent

HAND = load_model("hand26")
CAMERAS = [camera.without_distortion() for camera in simulated_rig(2, (320, 240)).cameras]
SETTINGS = TrackerSettings()
TIP = HAND.joint_names.index("index_tip")


STOOD = HAND.rest_params()
STOOD[1] = -0.09


def _joints(params):
    return HAND.joint_positions(HAND.bones(params))


def _pins(target, cameras=CAMERAS):
    return tuple(
        ImagePins(c, (Pin(c.name, tuple(map(float, c.project(target))), "index_tip"),))
        for c in cameras
    )


def test_pins_in_two_images_hold_a_point_and_the_other_fingers_change_little():
    target = _joints(STOOD)[TIP] + (0.0, -0.02, -0.02)
    found = pulled(HAND, SETTINGS, Observation(0, 0.0, pins=_pins(target)), STOOD, by_images=False)
    moved = np.linalg.norm(_joints(found) - _joints(STOOD), axis=1)
    assert np.linalg.norm(_joints(found)[TIP] - target) < 1e-3
    others = [n for n, name in enumerate(HAND.joint_names) if not name.startswith("index")]
    assert moved[others].max() < 0.25 * moved[TIP]


def test_a_pin_in_one_image_leaves_the_depth_as_it_was():
    target = _joints(STOOD)[TIP] + 0.02 * CAMERAS[0].rotation[0]
    one = Observation(0, 0.0, pins=_pins(target, cameras=CAMERAS[:1]))
    found = pulled(HAND, SETTINGS, one, STOOD, by_images=False)
    depth = [CAMERAS[0].to_camera(_joints(p))[TIP, 2] for p in (STOOD, found)]
    off = CAMERAS[0].project(_joints(found)[TIP]) - CAMERAS[0].project(target)
    assert np.linalg.norm(off) < 0.3
    assert abs(depth[1] - depth[0]) < 0.006


def test_masks_hold_the_rest_against_a_pin_and_give_way_at_the_joint():
    target = _joints(STOOD)[TIP] + (0.0, -0.01, -0.01)
    with_pins = replace(mask_views(HAND, STOOD, CAMERAS), pins=_pins(target))
    found = pulled(HAND, SETTINGS, with_pins, STOOD)
    for camera in CAMERAS:
        assert np.linalg.norm(camera.project(_joints(found)[TIP]) - camera.project(target)) < 1.0
    wrist = HAND.joint_names.index("wrist")
    assert np.linalg.norm(_joints(found)[wrist] - _joints(STOOD)[wrist]) < 0.004


FRAMES = 17


def test_pins_of_one_frame_set_its_neighbours_right_and_it_is_still_refined():
    """Nobody sees the index finger, which is bent and taken for straight; in one frame its tip is pinned."""
    at, tracker, straight = FRAMES // 2, Tracker(HAND), HAND.rest_params()
    points = _joints(bent(HAND, straight, "index", 45))
    named = [n for n, name in enumerate(HAND.joint_names) if not name.startswith("index")]
    given = Keypoints(tuple(HAND.joint_names[n] for n in named), points[named], 0.002)

    def seen(frame, _bones=None):
        return Observation(frame, frame / 30, keypoints=(given,))

    def pinned(frame, _bones=None):
        return replace(seen(frame), pins=_pins(points[TIP]) if frame == at else ())

    live = list(track_frames(tracker, seen, 0, straight, range(FRAMES)))
    before = [np.linalg.norm(r.joint_positions[TIP] - points[TIP]) for r in live]
    assert min(before) > 0.02
    pose = pulled(
        HAND, SETTINGS, pinned(at), HAND.transform.solver_params(live[at].parameters), False
    )
    found = refine_recording(tracker, pinned, live, pinned={at: pose})
    off = {r.frame: np.linalg.norm(r.joint_positions[TIP] - points[TIP]) for r in found}
    assert at in off, "no keyframe: its pins are what counts"
    assert off[at] < 0.002
    assert max(off[at - 2], off[at + 2]) < 0.5 * min(before)
