"""The doctor's look at what was recorded: files and masks of each camera, the rig, clouds, and whether frames belong together."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from itertools import combinations
from typing import NamedTuple

import cv2
import numpy as np

from handtrack.arrays import Array, N, evenly_spread
from handtrack.capture.images.frames import FrameSource, listed
from handtrack.capture.images.synchrony import ImageMotion, TimeOffset, time_offsets
from handtrack.capture.images.video import VideoFile
from handtrack.geometry.camera import Camera
from handtrack.session.layout import SESSION_FILE, matching_files
from handtrack.session.session import Session
from handtrack.session.sources.camera_times import read_timestamps
from handtrack.session.sources.views import View

SEVERITIES = ("ok", "note", "warning", "error")


class Finding(NamedTuple):
    """What was found, in one plain sentence or two."""

    severity: str
    """ok: as it should be; note: worth knowing; warning: probably wrong; error: tracking cannot
    use it."""
    text: str


ok, note, warning, error = (partial(Finding, severity) for severity in SEVERITIES)


_MOST_FILES = 2000  # files looked at per camera; beyond that evenly spaced ones
_MOST_COMPUTED = 60
_FEW = 10
_USUAL_DEPTH_M = (0.1, 10.0)
_EMPTY_SHARE = 0.0005  # of the image: less than that is no hand
_INVERTED_SHARE = 0.5
_CUT_SHARE = 0.5  # of the hand, by the region of interest
_RATE_TOLERANCE = 0.01
_DRIFT = 0.5  # of a frame, in the whole recording
_SECOND_PIECE = 0.25  # of the largest: a face, another arm; a finger that is cut off is less


def check_view(view: View, session: Session) -> Iterator[Finding]:
    """Yield findings about one camera: files present, missing, unreadable; rates; masks; depth."""
    if view.keypoint_files is not None:
        yield ok(f"camera '{view.name}': joints in {len(view.keypoint_files.files)} files.")
    if not view.sources:
        if view.keypoint_files is None:
            yield note(
                f"camera '{view.name}': no images, masks, depth or joints; it is only drawn."
            )
        return
    for kind, source in _sources(view):
        yield from _check_source(view, kind, source)
    yield from _check_joined(view, session)
    yield from check_rate(view, session)
    if view.depth is not None:
        yield from _check_depth(view)
    if view.has_masks:
        yield from _check_masks(view)
    elif view.depth is None and view.keypoint_files is None:
        yield note(f"camera '{view.name}': images without masks; no silhouettes are observed.")


def check_lengths(session: Session) -> Iterator[Finding]:
    """Yield a finding when cameras end at different frames."""
    counts: dict[str, int] = {}
    for view in session.views:
        kinds = {kind: len(view.session_frames(source.frames)) for kind, source in _sources(view)}
        if len(set(kinds.values())) > 1:
            counts |= {f"camera '{view.name}', {kind}": count for kind, count in kinds.items()}
        elif kinds:
            counts[f"camera '{view.name}'"] = view.frame_count
    if session.cloud_files:
        counts["clouds"] = max(session.cloud_files) + 1
    if len(set(counts.values())) > 1:
        shown = ", ".join(f"{name} {count}" for name, count in counts.items())
        yield warning(
            f"Lengths differ: {shown} frames. Is one recording cut, or started at another time?"
        )


def check_files(session: Session) -> Iterator[Finding]:
    """Yield a finding when two cameras are given the same images."""
    owners: dict[str, str] = {}
    for view in session.views:
        images = view.settings.images
        if images is None:
            continue
        other = owners.setdefault(images, view.name)
        if other != view.name:
            yield warning(
                f"cameras '{other}' and '{view.name}' are given the same images, \"{images}\"."
            )


def _sources(view: View) -> list[tuple[str, FrameSource]]:
    """Return a camera's files by what they are called."""
    sources = (("images", view.images), ("masks", view.mask_files), ("depth images", view.depth))
    return [(kind, source) for kind, source in sources if source is not None]


def check_times(session: Session) -> Iterator[Finding]:
    """Yield which cameras have no time stamps where others have some."""
    name = session.file.session.timestamps
    if name is None:
        return
    where = f"{session.folder / SESSION_FILE}, [session], timestamps"
    rates = {camera.name: camera.fps or session.fps for camera in session.file.cameras}
    stamped = read_timestamps(matching_files(session.folder, name, where)[0], rates)
    for camera in session.file.cameras:
        if camera.name not in stamped and camera.fps is None:
            yield warning(
                f"camera '{camera.name}' has no times in {name}: its frames are matched by number to those of camera "
                f"'{next(iter(stamped))}'. Add its times, or its `fps` in session.toml."
            )


def _nominal_fps(view: View) -> float:
    return view.images.nominal_fps if isinstance(view.images, VideoFile) else 0.0


def check_rate(view: View, session: Session) -> Iterator[Finding]:
    """Yield that a camera's video says another frame rate than is reckoned with, or than another camera's."""
    rate = _nominal_fps(view)
    named, expected = "the session", session.fps
    if view.settings.fps is not None:
        named, expected = "session.toml", view.settings.fps
    if rate > 0 and abs(rate / expected - 1) > _RATE_TOLERANCE:
        yield warning(
            f"camera '{view.name}': the video says {rate:g} fps, {named} {expected:g}. If the video is right, write "
            f'`fps = {rate:.6g}` under [[camera]] name = "{view.name}" in session.toml: its frames are then taken by time, '
            "not by number."
        )
    elif rate > 0 and view.times is None:
        other = next(v for v in session.views if v.times is None and _nominal_fps(v) > 0)
        drift = abs(rate / _nominal_fps(other) - 1) * view.known_count
        if drift > _DRIFT:
            yield warning(
                f"camera '{view.name}': its video says {rate:.6g} fps, that of '{other.name}' {_nominal_fps(other):.6g}. Frames "
                f"are matched by number; if both rates are right, the last ones are {drift:.2g} frames apart. Then write "
                f"`fps = {rate:.6g}` in the camera's table of session.toml: its frames are taken by time."
            )


def _check_joined(view: View, session: Session) -> Iterator[Finding]:
    """Yield how many frames of a session a camera has whose frames are joined by time."""
    if view.times is None:
        return
    frames = session.frame_range
    count = sum(view.times.own_frame(f) is not None for f in frames if f < view.frame_count)
    text = f"camera '{view.name}': its frames are taken by time; {count} of the session's {len(frames)} have one"
    if count:
        yield note(f"{text}.")
    else:
        yield error(f"{text}. Look at `lag_s` [s], `fps` and the time stamps: they never meet.")


def _check_source(view: View, kind: str, source: FrameSource) -> Iterator[Finding]:
    frames = source.frames
    missing = [frame for frame in frames if not source.has(frame)]
    width, height = view.camera.size
    if source.size is None:
        yield error(f"camera '{view.name}': none of its {kind} can be read.")
        return
    if not isinstance(source, VideoFile):
        there = [frame for frame in frames if source.has(frame)]
        for row in evenly_spread(len(there), _MOST_FILES):
            source.read(there[row])  # finds unreadable files and wrong sizes
    text = f"camera '{view.name}': {len(frames) - len(missing)} {kind} of {width} x {height}"
    if missing:
        yield warning(f"{text}; {len(missing)} frames are missing: {listed(missing)}.")
    else:
        yield ok(f"{text}.")


def _check_depth(view: View) -> Iterator[Finding]:
    frames = _some_frames(view, view.depth, _FEW)
    depths = [depth for frame in frames if (depth := view.depth_m(frame)) is not None]
    measured = np.concatenate([depth[depth > 0] for depth in depths] or [np.zeros(0)])
    if measured.size == 0:
        yield error(
            f"camera '{view.name}': no depth is measured in the frames looked at; all is 0."
        )
        return
    middle = float(np.median(measured))
    if not _USUAL_DEPTH_M[0] < middle < _USUAL_DEPTH_M[1]:
        yield warning(
            f"camera '{view.name}': the median depth is {middle:.3g} m, with depth_scale_m = "
            f"{view.settings.depth_scale_m:g}. Is the scale right?"
        )


def _some_frames(view: View, source: FrameSource | None, most: int) -> list[int]:
    """Return at most so many frames of the session that a source has, evenly spread."""
    own = [(frame, view.own_frame(frame)) for frame in range(view.frame_count)]
    there = [f for f, at in own if source is not None and at is not None and source.has(at)]
    return [there[row] for row in evenly_spread(len(there), most)]


def _check_masks(view: View) -> Iterator[Finding]:
    who = f"camera '{view.name}'"
    statistics = np.array(list(_statistics(view))).reshape(-1, 5)
    if not len(statistics):
        yield error(f"{who}: no mask could be read or computed.")
        return
    frames, (shares, touches, outside, second) = statistics[:, 0].astype(int), statistics[:, 1:].T

    def of(marked: Array[N]) -> list[int]:
        return frames[marked].tolist()

    empty, inverted = of(shares < _EMPTY_SHARE), of(shares > _INVERTED_SHARE)
    touching = of((touches > 0) & (shares <= _INVERTED_SHARE))
    cut, pieces = of(outside > _CUT_SHARE), of(second > _SECOND_PIECE)
    if len(empty) == len(statistics):
        yield error(f"{who}: all masks looked at ({len(statistics)}) are empty.")
    elif empty:
        yield warning(
            f"{who}: {len(empty)} of {len(statistics)} masks are empty, frames {listed(empty)}. An "
            "empty mask means that there is no hand in the image; delete the file if it was not segmented."
        )
    if inverted:
        yield warning(
            f"{who}: in {len(inverted)} of {len(statistics)} masks more than half of the image is "
            f"hand, frames {listed(inverted)}. Are they inverted? Expected 0 background, 255 hand."
        )
    if touching:
        yield note(
            f"{who}: in {len(touching)} of {len(statistics)} masks the hand reaches the image's "
            f"border, frames {listed(touching)}: the arm is part of the mask, or the hand is cut "
            "off."
        )
    if cut:
        yield warning(
            f"{who}: in {len(cut)} of {len(statistics)} masks most of the hand lies outside of roi = "
            f"{list(view.settings.roi or ())}, frames {listed(cut)}, and is not observed.",
        )
    if pieces:
        yield warning(
            f"{who}: {len(pieces)} of {len(statistics)} masks have a second piece, more than {_SECOND_PIECE:.0%} as large as the "
            f"first, frames {listed(pieces)}. Is it a face, or another arm? A roi = [x, y, w, h] leaves it out."
        )
    if not (empty or inverted or touching or cut or pieces):
        yield ok(f"{who}: {len(statistics)} masks looked at; none empty, inverted or cut off.")


def _statistics(view: View) -> Iterator[tuple[float, ...]]:
    """Yield masks' frames, shares of the image that are hand, whether this reaches the border, its share outside of the region of
    interest, and the size of the second largest piece beside the largest.
    """
    most = _MOST_FILES if view.mask_files is not None else _MOST_COMPUTED
    for frame in _some_frames(view, view.mask_files or view.images or view.depth, most):
        mask = view.mask(frame)
        if mask is not None:
            hand = (mask > 0) & (mask != (view.unknown_at(frame) or 0))
            inside = view.hand_pixels(frame)
            kept = hand if inside is None else hand & (inside > 0)
            outside = 1 - kept.sum() / max(hand.sum(), 1) if hand.any() else 0.0
            border = hand[[0, -1]].any() or hand[:, [0, -1]].any()
            _, _, stats, _ = cv2.connectedComponentsWithStats(kept.astype(np.uint8))
            second, first = np.sort([0, 0, *stats[1:, cv2.CC_STAT_AREA]])[-2:]
            yield frame, hand.mean(), border, outside, second / max(first, 1)


# ---- The doctor's look at the rig: distances, units, lenses


_SAME_PLACE_M = 0.005
_ROUNDING = 1e-6  # a pose written with six digits and more
_FAR_APART_M = 20.0
_UNBALANCED = 0.03  # of a corner's distance from the middle
_USUAL_FIELD = (0.2, 5.0)  # image width / focal length: 11° to 136°


def check_cameras(session: Session) -> Iterator[Finding]:
    """Yield findings about the cameras' mutual distances and each one's lens."""
    yield from _check_distances(session)
    for camera in session.rig:
        yield from check_lens(camera)


def _check_distances(session: Session) -> Iterator[Finding]:
    unit = session.file.session.world_unit_m
    pairs = list(combinations(session.rig, 2))
    if not pairs:
        return
    apart = np.array([np.linalg.norm(a.centre - b.centre) for a, b in pairs])
    span = (
        f"cameras are {apart.min():.3g} to {apart.max():.3g} m apart"
        if len(pairs) > 1
        else f"the cameras are {apart[0]:.3g} m apart"
    )
    if apart.max() > _FAR_APART_M:
        yield warning(
            f"{span}, with world_unit_m = {unit:g}. Is calibration.toml in millimetres? Then "
            "world_unit_m = 0.001."
        )
    elif copied := [
        f"{a.name!r} and {b.name!r}"
        for a, b in pairs
        if np.abs(a.centre - b.centre).max() < _ROUNDING
        and np.abs(a.rotation - b.rotation).max() < _ROUNDING
    ]:
        yield warning(
            f"cameras {copied[0]} have one pose. Was it copied? (The colour and the infrared "
            "camera of one housing differ by 0.01 mm or more.)"
        )
    elif apart.max() < _SAME_PLACE_M:
        yield warning(f"{span}, with world_unit_m = {unit:g}. Is the unit wrong?")
    else:
        yield ok(f"{span}.")


def check_lens(camera: Camera) -> Iterator[Finding]:
    """Yield findings about one camera's matrix and lens."""
    width, height = camera.size
    field = width / camera.matrix[0, 0]
    if not _USUAL_FIELD[0] < field < _USUAL_FIELD[1]:
        yield warning(
            f"camera '{camera.name}': a focal length of {camera.matrix[0, 0]:.4g} px is unusual "
            f"for an image {width} px wide. Does the matrix belong to another image size?"
        )
    cx, cy = camera.matrix[:2, 2]
    if not (0.2 * width < cx < 0.8 * width and 0.2 * height < cy < 0.8 * height):
        yield warning(
            f"camera '{camera.name}': the principal point ({cx:.0f}, {cy:.0f}) is far from the "
            f"middle of {width} x {height}. Is the image cropped or scaled, or are cx and cy "
            "exchanged?"
        )
    yield from _check_series(camera)
    corners = np.array(
        [[0, 0], [width - 1, 0], [0, height - 1], [width - 1, height - 1]], dtype=float
    )
    if np.isnan(camera.undistort_points(corners)).any():
        yield note(
            f"camera '{camera.name}': the distortion folds back before the image's corners; what "
            "lies there is not used. Too many coefficients for the calibration's images? "
            "Calibrate with fewer."
        )


def _check_series(camera: Camera) -> Iterator[Finding]:
    """Yield that a lens's series 1 + k1 r² + k2 r⁴ (+ k3 r⁶) looks cut off: its last term bends most, with nothing against it.

    Where k3 was fitted, k2 and k3 are large and of opposite signs; a file without room for k3 keeps k2 as it was.
    """
    k = np.zeros(5)
    given = np.asarray(camera.distortions, dtype=float)[:5]
    k[: len(given)] = given
    corner = np.array(camera.size) / 2 / np.diag(camera.matrix)[:2]
    r2 = float(corner @ corner)
    if k[4] == 0 and abs(k[1]) * r2 * r2 > max(abs(k[0]) * r2, _UNBALANCED):
        yield warning(
            f"camera '{camera.name}': the coefficient k2 = {k[1]:.3g} moves the corners by "
            f"{abs(k[1]) * r2 * r2:.0%}, and no k3 balances it. Was k3 lost in a conversion (some formats hold only four coefficients)? "
            "Compare with the calibration's own file."
        )


# ---- The doctor's look at point clouds: whether there are any, and what the filters leave of them


_OF_PAIRS, _OF_OTHERS = 4, 12  # frames looked at: matching a pair takes its time
_LEAST_POINTS = 300  # below that, a hand's pose cannot be told from its cloud


def check_clouds(session: Session) -> Iterator[Finding]:
    """Yield findings about a few clouds of a session: points measured and left by the filters."""
    if not session.has_clouds:
        return
    measured, left, poor = [], [], []
    settings = session.file.clouds
    few = settings is not None and settings.stereo
    frames = list(session.cloud_files) or session.frame_range
    for row in evenly_spread(len(frames), _OF_PAIRS if few else _OF_OTHERS):
        frame = frames[row]
        cloud, _ = session.cloud(frame)
        whole = session.measured_cloud(frame)
        if cloud is None or whole is None:
            continue
        measured.append(len(whole))
        left.append(len(cloud))
        if len(cloud) < _LEAST_POINTS:
            poor.append(frame)
    if not measured:
        yield error("clouds: none of the frames looked at has a cloud.")
        return
    text = (
        f"clouds: {np.median(measured):.0f} points measured, {np.median(left):.0f} left by the "
        f"filters (median of {len(measured)} frames)"
    )
    if poor:
        yield warning(
            f"{text}; fewer than {_LEAST_POINTS} are left in frames {listed(poor)}. Look at the "
            "settings in [clouds]: near_m, far_m, component, outlier_neighbours."
        )
    else:
        yield ok(f"{text}.")


# ---- The doctor's look at whether frames of equal number show the same moment in every camera


_INTERVAL = 60  # consecutive frames; two stretches are looked at, and must agree
_FEWEST = 40  # frames of a session that can tell


def check_synchrony(session: Session) -> Iterator[Finding]:
    """Yield a finding about each camera whose frames come late or early against the others', and about what cannot be told."""
    seen = [(v, source) for v in session.views if (source := v.mask_files or v.images) is not None]
    if len(seen) < 2 or session.frame_count < _FEWEST:
        return
    offsets = time_offsets([_motions(view, source, session.frame_count) for view, source in seen])
    found = {view.name: offsets.get(i) for i, (view, _) in enumerate(seen)}
    told = {name: offset for name, offset in found.items() if offset and offset.agrees}
    late = sorted((n for n in told if told[n].is_sure), key=lambda n: -abs(told[n].frames))
    for name in late:
        yield warning(_time_offset(session, name, told[name]))
    untold = [name for name in found if name not in told]
    if untold:
        yield note(
            f"the synchronisation of {_listed(untold)} cannot be checked: the motion there matches no "
            "other camera's at any time offset searched."
        )
    if told and not late:
        most = max(abs(offset.frames) for offset in told.values())
        std = max(offset.std for offset in told.values())
        yield ok(
            f"{_listed(list(told))} run together, by what moves: at most {most:.1f} frames apart, ± {std:.1f}."
        )


def _time_offset(session: Session, name: str, offset: TimeOffset) -> str:
    """Return that a camera is late or early, and what to do."""
    which = f"camera '{name}' comes"
    way = "late" if offset.frames > 0 else "early"
    numbers = f"(what moves agrees by {offset.correlation:.2f} then, by {offset.as_numbered:.2f} as numbered)"
    if offset.at_edge:
        return (
            f"Do frames of equal number show the same moment? {which} at least {abs(offset.frames):.0f} frames {way} against the "
            f"others {numbers}; no more was searched. Cut the recordings so that they start together, and look again."
        )
    before = session.view(name).settings.lag_s or 0.0
    lag_s = before + offset.frames / session.fps
    return (
        f"Do frames of equal number show the same moment? {which} {abs(offset.frames):.1f} ± {offset.std:.1f} frames {way} against the "
        f'others {numbers}. Write `lag_s = {lag_s:.4g}` under [[camera]] name = "{name}" in session.toml, and look again; or cut the '
        "recordings so that they start together."
    )


def _listed(names: list[str]) -> str:
    return f"{'cameras' if len(names) > 1 else 'camera'} {', '.join(map(repr, names))}"


def _motions(view: View, source: FrameSource, count: int) -> tuple[ImageMotion, ImageMotion]:
    """Return what moved in two stretches of a recording."""
    long = min(_INTERVAL, count // 2)
    starts = (
        (0, count - long)
        if count <= 2 * _INTERVAL
        else (count // 3 - long // 2, 2 * count // 3 - long // 2)
    )
    first, second = (
        ImageMotion(view.camera, (view.read(source, frame) for frame in range(start, start + long)))
        for start in starts
    )
    return first, second
