"""The doctor's look at the hand: do first pose and ground truth fit the cameras and masks, and does what was tracked?"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence

import cv2
import numpy as np

from handtrack.arrays import D3, D21, Floats, P, S, evenly_spread
from handtrack.capture.images.frames import listed
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.model_file import load_model, model_from_definition, scale_from
from handtrack.observation.observation import Observation
from handtrack.session.doctor.check_views import Finding, error, note, ok, warning
from handtrack.session.first_pose import FirstPose
from handtrack.session.hand_side import misfits_m, side_told
from handtrack.session.layout import POSES_FILE, TRACKS_FOLDER
from handtrack.session.run import TrackingRun, samples
from handtrack.session.session import Session
from handtrack.session.sources.clouds import hand_region
from handtrack.session.sources.keypoint_files import NO_JOINTS
from handtrack.session.sources.views import View
from handtrack.session.tables import read_npz
from handtrack.session.takes import foreign_result, foreign_takes
from handtrack.store.store import Store
from handtrack.tracking.frame.confidence import hand_words, odd_size
from handtrack.tracking.frame.control import Control
from handtrack.tracking.frame.result import FrameResult, Status, model_of
from handtrack.tracking.frame.settings import TrackerSettings
from handtrack.tracking.search.global_search import other_side_log_odds
from handtrack.tracking.size.camera_consistency import CameraInconsistency, camera_inconsistencies

# ---- Whether what was tracked was made from what is there, and whether one camera contradicts the others, by its direction or its lens


_FEWEST_POSED, _SAMPLED = 4, 8  # frames, evenly spread
# log-likelihood, and share of what is left unexplained, that a camera's change must bring; measured on simulated scenes, and on
# recordings of hands of other shape (docs/explanation/trajectory.md). A detector errs alike in all images of one view, which looks like a
# turned camera: 0.14 on desk_two_view
_LEAST_GAIN, _LEAST_SHARE, _LEAST_SHARE_OF_JOINTS = (12.0, 0.05, 0.2)
_SIMILAR = 0.7  # of the gain: another camera that would do as well


def check_tracked_from(session: Session) -> Iterator[Finding]:
    """Yield that what was tracked was made from other input than the session has now."""
    found = foreign_takes(Store(session.folder / TRACKS_FOLDER), session)
    path = session.folder / POSES_FILE
    if not found and path.is_file():
        found = foreign_result(read_npz(path), str(POSES_FILE), session)
    yield from map(warning, found)


def check_tracked_cameras(session: Session) -> Iterator[Finding]:
    """Yield that one camera contradicts the others, where there is a result."""
    path = session.folder / POSES_FILE
    if not path.is_file():
        return
    track = read_npz(path)
    values = {"model.fit_size": "false"}
    run = TrackingRun.open(session, values, use_init=False)
    run = run.with_scale(scale_from(json.loads(track.scale), path))
    run = run.with_parameters(track.parameter_names)
    if run.model.parameter_names != track.parameter_names:
        return
    kept = [frame for frame in track.frames() if frame.frame in session.frame_range]
    text = inconsistency_of_cameras(run, kept)
    yield from [warning(f"{POSES_FILE}: {text}")] if text else []


def inconsistency_of_cameras(run: TrackingRun, results: Sequence[FrameResult]) -> str:
    """Return which camera the others contradict after tracking, in a sentence with figures; empty where none is to be blamed."""
    posed = [result for result in results if result.status != Status.LOST]
    if len(posed) < _FEWEST_POSED or len(run.session.views) < 2:
        return ""
    seen = [(one, params) for params, one in samples(run, posed, _SAMPLED)]
    found = camera_inconsistencies(run.model, run.settings, seen)
    least = _LEAST_SHARE_OF_JOINTS if any(one.keypoints for one, _ in seen) else _LEAST_SHARE
    if not found or found[0].gain < _LEAST_GAIN or found[0].share < least:
        return ""
    return _words(found, hand_words(run.model) if odd_size(run.model) else "")


def _words(found: Sequence[CameraInconsistency], odd: str) -> str:
    worst = found[0]
    others = [
        f"'{d.camera}'"
        for d in found[1:]
        if d.gain > _SIMILAR * worst.gain and d.kind == worst.kind
    ]
    or_others = f" (or {' or '.join(others)})" if others else ""
    share = f"{100 * worst.share:.0f} % of what is left unexplained would go"
    if worst.kind == "direction":
        found_in = f"turned by about {np.rad2deg(worst.turn_rad):.1f}°, {worst.off_px:.0f} px where it looks"
        asked = "Was it moved after the calibration, or are its rotation and translation another's?"
    else:
        found_in = f"with another lens, {worst.off_px:.1f} px different at the hand"
        asked = (
            "Did a coefficient, such as k3, get lost, or does the lens belong to another camera?"
        )
    too = f"; the {odd}" if odd else ""
    return (
        f"camera '{worst.camera}'{or_others} contradicts the others: {found_in}, {share}{too}. {asked} `handtrack calibrate` "
        "makes the calibration anew."
    )


# ---- Whether session.toml names the right side: told where what was tracked fits the other hand decisively better


_SIDE_SAMPLED = 4  # frames, evenly spread
_DECISIVE = 5.0  # log-odds, 150 to 1; docs/contributing/testing.md


def wrong_side_warning(
    session: Session,
    settings: TrackerSettings,
    model: ArticulatedModel,
    tracked: Mapping[int, Floats[S]],
    control: Control = Control(),
) -> str:
    """Return that the hand is the other one, in words; empty where that is not clear.

    A flat hand seen from afar is like the other one's back: nothing is told of it.

    Parameters
    ----------
    tracked
        Joint parameters by frame.
    """
    if model.kind != "hand" or not model.has_keypoints21 or not tracked:
        return ""
    frames = sorted(tracked)
    rows = evenly_spread(len(frames), _SIDE_SAMPLED)
    other_side = "left" if model.side == "right" else "right"
    other = model_from_definition(
        model.definition_text, other_side, model.scale, model.has_forearm, model.name
    )
    alone = settings.with_values({"tracker.hypotheses": 1})

    def posed() -> Iterator[tuple[Observation, Floats[P]]]:
        for frame in (frames[row] for row in rows):
            params = model.solver_params(tracked[frame])
            near = hand_region(model, model.bones(params))
            used = settings.silhouettes.weight > 0, settings.cloud.weight > 0
            yield session.observation(frame, *used, near), params

    odds = other_side_log_odds(model, other, alone, posed(), control)
    if odds < _DECISIVE:
        return ""
    return (
        f"a {other_side} hand fits the observations decisively better than a {model.side} one (log-odds {odds:.1f} in "
        f'{len(rows)} frames). Is side = "{model.side}" right in session.toml? If it is: are two cameras exchanged?'
    )


# ---- The first pose and the ground truth


_WRIST, _MIDDLE_MCP = 0, 9  # rows of the 21 keypoints
PALM_M = (0.05, 0.13)  # wrist to middle knuckle: children to large men, with a margin
_MARGIN_PX = 7  # joints lie inside the hand, but calibration and noise move them
_LEAST_INSIDE = 0.75  # share of keypoints on the mask that is still plausible
_FAR_FROM_CLOUD_M = 0.06  # joints lie up to 3 cm behind the skin that a camera sees
_TRUTH_FRAMES = 12  # looked at, evenly spaced


def check_init(session: Session) -> Iterator[Finding]:
    """Yield findings about init.json."""
    pose = session.init
    if pose is None:
        yield _no_first_pose(session)
        return
    if pose.pixels:
        strange = [name for name in pose.pixels if name not in session.camera_names]
        if strange:
            known = ", ".join(session.camera_names)
            yield error(f"init.json: no camera '{strange[0]}' in this session; known: {known}.")
            return
        views = "one camera" if len(pose.pixels) == 1 else f"{len(pose.pixels)} cameras"
        yield ok(f"init.json: keypoints in the images of {views} at frame {pose.frame}.")
        return
    if pose.xyz is not None:
        yield from check_palm("init.json", pose.xyz)
    points = pose.xyz
    if points is None:
        model = _model(session, pose)
        points = model.joint_positions(model.bones(model.params_from(dict(pose.parameters))))
    points = points[np.isfinite(points).all(axis=1)]
    misses = [text for view in session.views if (text := _misses(view, pose.frame, points))]
    misses += _misses_cloud(session, pose.frame, points)
    for text in misses:
        yield warning(f"init.json, frame {pose.frame}: {text}")
    if not misses:
        known = (
            f"{len(pose.parameters)} parameters" if pose.xyz is None else f"{len(points)} keypoints"
        )
        yield ok(f"init.json: {known} at frame {pose.frame}; they fit the cameras.")


def _no_first_pose(session: Session) -> Finding:
    """Return that there is none, and how one is come by: a body is found by joints only."""
    model = _model(session)
    if model.kind == "body" and not any(view.keypoint_files for view in session.views):
        return warning(
            f"no init.json: tracking needs a first pose. {NO_JOINTS.format(model=model.name)} Or set it in the workbench."
        )
    return note(
        "no init.json: tracking needs a first pose (`--init auto` looks for one, or set it in the workbench)."
    )


def check_model(session: Session) -> Iterator[Finding]:
    """Yield what hand or body is tracked. Raises HandtrackError for a model or a saved size that cannot be used."""
    model = _model(session)
    side = "" if model.kind == "body" else f", {model.side}"
    yield ok(f"the model is {model.name}{side}.")


def _model(session: Session, pose: FirstPose | None = None) -> ArticulatedModel:
    """Return the hand. pose: with its size, where session.toml leaves that open."""
    size = TrackingRun.unfitted(session, session.settings, pose).given_scale
    return load_model(session.hand_model, session.file.hand.side, size, forearm=True)


def _misses_cloud(session: Session, frame: int, points: Floats) -> list[str]:
    """Return that a pose is far from the cloud of its frame."""
    cloud = session.measured_cloud(frame)
    if cloud is None or not len(cloud):
        return []
    from scipy.spatial import KDTree

    away = float(np.median(KDTree(cloud.points).query(points)[0]))
    if away <= _FAR_FROM_CLOUD_M:
        return []
    return [
        f"its joints are {away:.2g} m away from the nearest points of the cloud (median). Is the unit right (world_unit_m, "
        "depth_scale_m), and do cloud, calibration and pose mean the same world?"
    ]


def check_side(session: Session) -> Iterator[Finding]:
    """Yield that init.json's joints are the other hand's; where they do not tell, that the result's hand is."""
    if session.init is not None and session.init.xyz is not None:
        yield from check_side_of("init.json", session.init.xyz, session)
        if side_told(misfits_m(session.init.xyz)):
            return
    path = session.folder / POSES_FILE
    if not path.is_file():
        return
    track = read_npz(path)
    if track.side != session.file.hand.side:
        return
    model = model_of(track, str(path))
    rows = zip(track.frame, track.status, track.parameters, strict=True)
    tracked = {int(f): p for f, s, p in rows if s != Status.LOST and f in session.frame_range}
    doubt = wrong_side_warning(session, session.settings, model, tracked)
    yield from [warning(f"{POSES_FILE}: {doubt}")] if doubt else []


def check_truth(session: Session) -> Iterator[Finding]:
    """Yield findings about truth.npz."""
    truth = session.truth
    if truth is None:
        yield note("no truth.npz: the tracking's error cannot be measured.")
        return
    outside = [int(frame) for frame in truth.frame if frame not in session.frame_range]
    if outside:
        yield warning(f"truth.npz: the session has no frames {listed(sorted(outside))}.")
    yield from _check_truth_times(session)
    points = truth.keypoints21
    if points is None:
        yield ok(f"truth.npz: {len(truth.joint_names)} joints in {len(truth.frame)} frames.")
        return
    known = np.isfinite(points).all(axis=2)
    fullest = points[int(np.argmax(known.sum(axis=1)))]
    yield from check_palm("truth.npz", fullest)
    yield from check_side_of("truth.npz", fullest, session)
    if not known.all():
        yield note(f"truth.npz: {int((~known).sum())} of {known.size} keypoints are not known.")
    rows = evenly_spread(len(points), _TRUTH_FRAMES)
    wrong = [
        f"frame {frame}: {text}"
        for row in rows
        if (frame := int(truth.frame[row])) in session.frame_range
        for view in session.views
        if (text := _misses(view, frame, points[row]))
    ]
    if wrong:
        yield warning(
            f"truth.npz does not fit in {len(wrong)} of {len(rows) * len(session.views)} views "
            f"looked at; {wrong[0]}"
        )
    else:
        yield ok(f"truth.npz: keypoints in {len(truth.frame)} frames; they fit the cameras.")


def _check_truth_times(session: Session) -> Iterator[Finding]:
    truth = session.truth
    if truth is None or truth.time_s is None:
        return
    ours = np.array([session.time_s(int(frame)) for frame in truth.frame])
    off = truth.time_s - ours
    worst = int(np.argmax(np.abs(off - np.median(off))))
    if abs(off[worst] - np.median(off)) > 0.5 / session.fps:
        yield warning(
            "truth.npz: its times run differently from the session's, by "
            f"{off[worst] - np.median(off):+.3g} s at frame {int(truth.frame[worst])}. Is fps = "
            f"{session.fps:g} right?"
        )


def check_palm(what: str, xyz: Floats[D21, D3]) -> Iterator[Finding]:
    """Yield that joints (21, 3) [m] have a palm that no hand has."""
    palm = float(np.linalg.norm(xyz[_MIDDLE_MCP] - xyz[_WRIST]))
    if np.isfinite(palm) and not PALM_M[0] <= palm <= PALM_M[1]:
        yield warning(
            f"{what}: from the wrist to the middle finger's knuckle it is {palm * 1000:.0f} mm; "
            f"expected {PALM_M[0] * 1000:.0f} to {PALM_M[1] * 1000:.0f} mm. Is world_unit_m "
            "right, and are the points in order?"
        )


def check_side_of(what: str, xyz: Floats[D21, D3], session: Session) -> Iterator[Finding]:
    """Yield that joints (21, 3) are those of the other hand: fingers bend to one side only, and the thumb is on one."""
    given, off = session.file.hand.side, misfits_m(xyz)
    other = side_told(off)
    if other in ("", given) or _model(session).kind != "hand":
        return
    yield warning(
        f"{what}: its joints are a {other} hand's: they fit one to {1e3 * off[other]:.1f} mm, a {given} one to "
        f'{1e3 * off[given]:.1f} mm. Is side = "{given}" right in session.toml? If it is, the points are mirrored: '
        "look at the order of cameras, and at the signs of axes."
    )


def odd_side(first: FirstPose | None, session: Session) -> list[str]:
    """Return in words that a first pose's joints are those of the other hand; nothing where it has none."""
    if first is None or first.xyz is None:
        return []
    return [finding.text for finding in check_side_of("first pose", first.xyz, session)]


def _misses(view: View, frame: int, xyz: Floats) -> str:
    """Return what is wrong with points in a view, empty when nothing is."""
    known = xyz[np.isfinite(xyz).all(axis=1)]
    if not len(known):
        return ""
    depth = view.camera.to_camera(known)[:, 2]
    if (depth <= 0).any():
        return (
            f"{int((depth <= 0).sum())} of {len(known)} keypoints lie behind camera '{view.name}'."
        )
    if not view.sources:
        return ""
    pixels = view.camera.project(known)
    width, height = view.camera.size
    with np.errstate(invalid="ignore"):
        shown = ((pixels >= -0.5) & (pixels < (width - 0.5, height - 0.5))).all(axis=1)
    if shown.mean() < 0.5:
        outside = int((~shown).sum())
        return f"{outside} of {len(known)} keypoints lie outside the image of camera '{view.name}'."
    mask = view.mask(frame) if view.has_masks else None
    if mask is None or not mask.any():
        return ""
    near = cv2.dilate(mask, np.ones((2 * _MARGIN_PX + 1,) * 2, np.uint8)) > 0
    columns, rows = pixels[shown].round().astype(int).clip(0, (width - 1, height - 1)).T
    share = float(near[rows, columns].mean())
    if share < _LEAST_INSIDE:
        return (
            f"only {share:.0%} of the keypoints lie on the mask of camera '{view.name}'. Do "
            "calibration, side, unit and frame numbers belong together?"
        )
    return ""
