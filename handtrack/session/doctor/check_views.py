"""The doctor's look at each camera's files and masks."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

import cv2
import numpy as np

from handtrack.arrays import Array, H, W
from handtrack.capture.images.frame_notes import listed
from handtrack.capture.images.frames import FrameSource
from handtrack.capture.images.video import VideoFile
from handtrack.session.doctor.finding import Finding, error, note, ok, warning
from handtrack.session.sources.camera_times import recording_of
from handtrack.session.sources.views import View

if TYPE_CHECKING:
    from handtrack.session.session import Session

_MOST_FILES = 2000  # files looked at per camera; beyond that evenly spaced ones
_MOST_COMPUTED = 60
_FEW = 10
_USUAL_DEPTH_M = (0.1, 10.0)
_EMPTY_SHARE = 0.0005  # of the image: less than that is no hand
_INVERTED_SHARE = 0.5
_CUT_SHARE = 0.5  # of the hand, by the region of interest
_RATE_TOLERANCE = 0.01
_SECOND_PIECE = 0.25  # of the largest: a face, another arm; a finger that is cut off is less


class _MaskLook(NamedTuple):
    frame: int
    share: float
    """of the image that is hand."""
    touches: bool
    """whether the hand reaches the image's border."""
    outside: float
    """share of the hand outside of the region of interest."""
    second: float
    """size of the second largest piece beside the largest."""


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
        yield from _check_source(view, kind, recording_of(source))
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
        kinds = {kind: len(source.frames) for kind, source in _sources(view)}
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


def check_rate(view: View, session: Session) -> Iterator[Finding]:
    """Yield that a camera's video says another frame rate than is reckoned with."""
    source = None if view.images is None else recording_of(view.images)
    rate = source.nominal_fps if isinstance(source, VideoFile) else 0.0
    named, expected = "the session", session.fps
    if view.settings.fps is not None:
        named, expected = "session.toml", view.settings.fps
    if rate > 0 and abs(rate / expected - 1) > _RATE_TOLERANCE:
        yield warning(
            f"camera '{view.name}': the video says {rate:g} fps, {named} {expected:g}. If the video is right, write "
            f'`fps = {rate:.6g}` under [[camera]] name = "{view.name}" in session.toml: its frames are then taken by time, '
            "not by number."
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
        for frame in spread(len(frames), _MOST_FILES):
            source.read(frame)  # finds unreadable files and wrong sizes
    text = f"camera '{view.name}': {len(frames) - len(missing)} {kind} of {width} x {height}"
    if missing:
        yield warning(f"{text}; {len(missing)} frames are missing: {listed(missing)}.")
    else:
        yield ok(f"{text}.")


def _check_depth(view: View) -> Iterator[Finding]:
    frames = spread(view.frame_count, _FEW)
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


def _check_masks(view: View) -> Iterator[Finding]:
    who = f"camera '{view.name}'"
    looks = list(_looks(view))
    if not looks:
        yield error(f"{who}: no mask could be read or computed.")
        return
    empty = [look.frame for look in looks if look.share < _EMPTY_SHARE]
    inverted = [look.frame for look in looks if look.share > _INVERTED_SHARE]
    touching = [look.frame for look in looks if look.touches and look.share <= _INVERTED_SHARE]
    if len(empty) == len(looks):
        yield error(f"{who}: all masks looked at ({len(looks)}) are empty.")
    elif empty:
        yield warning(
            f"{who}: {len(empty)} of {len(looks)} masks are empty, frames {listed(empty)}. An "
            "empty mask means that there is no hand in the image; delete the file if it was not segmented."
        )
    if inverted:
        yield warning(
            f"{who}: in {len(inverted)} of {len(looks)} masks more than half of the image is "
            f"hand, frames {listed(inverted)}. Are they inverted? Expected 0 background, 255 hand."
        )
    if touching:
        yield note(
            f"{who}: in {len(touching)} of {len(looks)} masks the hand reaches the image's "
            f"border, frames {listed(touching)}: the arm is part of the mask, or the hand is cut "
            "off."
        )
    cut = [look.frame for look in looks if look.outside > _CUT_SHARE]
    if cut:
        yield warning(
            f"{who}: in {len(cut)} of {len(looks)} masks most of the hand lies outside of roi = "
            f"{list(view.settings.roi or ())}, frames {listed(cut)}, and is not observed.",
        )
    pieces = [look.frame for look in looks if look.second > _SECOND_PIECE]
    if pieces:
        yield warning(
            f"{who}: {len(pieces)} of {len(looks)} masks have a second piece, more than {_SECOND_PIECE:.0%} as large as the "
            f"first, frames {listed(pieces)}. Is it a face, or another arm? A roi = [x, y, w, h] leaves it out."
        )
    if not (empty or inverted or touching or cut or pieces):
        yield ok(f"{who}: {len(looks)} masks looked at; none empty, inverted or cut off.")


def _looks(view: View) -> Iterator[_MaskLook]:
    most = _MOST_FILES if view.mask_files is not None else _MOST_COMPUTED
    for frame in spread(view.frame_count, most):
        mask = view.mask(frame)
        if mask is not None:
            hand = (mask > 0) & (mask != (view.unknown_at(frame) or 0))
            inside = view.hand_pixels(frame)
            kept = hand if inside is None else hand & (inside > 0)
            outside = 1 - kept.sum() / max(hand.sum(), 1) if hand.any() else 0.0
            yield _MaskLook(
                frame,
                float(hand.mean()),
                _touches_border(hand),
                float(outside),
                _second_piece(kept),
            )


def _second_piece(hand: Array[H, W]) -> float:
    """Return the size of the second largest piece beside the largest; 0 where there is one alone."""
    _, _, stats, _ = cv2.connectedComponentsWithStats(hand.astype(np.uint8))
    sizes = np.sort(stats[1:, cv2.CC_STAT_AREA])[::-1]
    return float(sizes[1] / sizes[0]) if len(sizes) > 1 else 0.0


def _touches_border(mask: Array[H, W]) -> bool:
    return bool(mask[0].any() or mask[-1].any() or mask[:, 0].any() or mask[:, -1].any())


def spread(count: int, most: int) -> list[int]:
    """Return all frames below `count`, or `most` evenly spaced ones."""
    if count <= most:
        return list(range(count))
    return [int(frame) for frame in np.unique(np.linspace(0, count - 1, most).round())]
