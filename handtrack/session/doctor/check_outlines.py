"""The doctor's look at whether the silhouettes of two cameras can be of one thing, by the calibration.

Planes through both cameras' centres that touch a body touch its outline in both pictures: the range of their angles is the same.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations

import cv2
import numpy as np

from handtrack.arrays import D2, Array, Bytes, Floats, N, evenly_spread
from handtrack.capture.images.frames import listed
from handtrack.capture.images.synchrony import plane_angles
from handtrack.geometry.camera import Camera
from handtrack.geometry.triangulation import triangulated
from handtrack.observation.agreement import suspected
from handtrack.session.doctor.check_views import Finding, warning
from handtrack.session.session import Session
from handtrack.session.sources.views import View

_FRAMES = 12
_FEWEST = 3  # comparisons
_MOST_EXCHANGED = 6  # cameras; among more, it is not looked which two may be exchanged
_BORDER_PX = 3  # an outline that near to the image's border is cut off, not touched
_SPECK_PX = 5
_MOST_OFF, _MOST_OFF_PX = 0.01, 5.0  # of the images' width; good recordings are off by 0.1 to 2 px


def check_outlines(session: Session, frames: Sequence[int] | None = None) -> Iterator[Finding]:
    """Yield a finding about pairs of cameras whose silhouettes do not fit together. frames: unless evenly spread ones."""
    views = [view for view in session.views if view.has_masks]
    frames = evenly_spread(session.frame_count, _FRAMES) if frames is None else frames
    other = _showing_other(views, frames)
    for name, there in other.items():
        if there:
            yield warning(
                f"camera '{name}': in {len(there)} of the {len(frames)} frames looked at, its mask shows something that is hand in none of "
                f"the other cameras (frames {listed(there)}). Tracking leaves such masks out. Is a shadow or another object taken for the hand there?"
            )
    seen: list[_View] = []
    for view in views:
        masks = {frame: view.mask(frame) for frame in frames if frame not in other[view.name]}
        outlines = [
            None if (mask := masks.get(f)) is None else _outline(mask, view.unknown_at(f), view)
            for f in frames
        ]
        seen.append((view.camera, outlines))
    pairs = list(combinations(seen, 2))
    apart = [_pixels_apart(a, b) for a, b in pairs]
    off = [
        f"'{a[0].name}' and '{b[0].name}' by {px:.0f} px"
        for (a, b), px in zip(pairs, apart, strict=True)
        if px is not None and _is_off(px, a, b)
    ]
    behind = [f"'{a[0].name}' and '{b[0].name}'" for a, b in pairs if _is_behind(a, b)]
    meant = _what_would_fit(seen) if off or behind or all(px is None for px in apart) else ""
    if behind and not off:
        yield warning(
            f"by this calibration the hand lies behind the cameras: the viewing rays of {'; '.join(behind)} diverge "
            f"in front of them. {meant or 'Are cameras exchanged, or is a direction in calibration.toml the wrong way round?'}"
        )
    elif off:
        yield warning(
            f"silhouettes do not fit together by this calibration: those of cameras {'; '.join(off)} (median of the frames looked "
            "at; a hand's outlines touch the same planes through both cameras). "
            + (
                meant
                or "Was a camera moved, does its matrix belong to another image size, are cameras exchanged, or do frames of "
                "equal number show different moments?"
            )
        )
    elif meant:
        yield warning(f"silhouettes of no two cameras can be compared by this calibration. {meant}")


_Outline = tuple[Floats[N, D2], Array[N]]
"""pixels, none where nothing is seen; whether the image or its region does not cut the hand off at each"""
_View = tuple[Camera, list[_Outline | None]]
"""a camera, and its outlines in some frames; None where there is no mask"""


def _is_off(px: float, first: _View, second: _View) -> bool:
    width = min(first[0].size[0], second[0].size[0])
    return px > max(_MOST_OFF * width, _MOST_OFF_PX)


def _what_would_fit(seen: Sequence[_View]) -> str:
    """Return mistakes that are often made and with which all silhouettes would fit together, as questions; empty for none."""
    found = []
    for words, cameras in often_mistaken([camera for camera, _ in seen]):
        fits = _fit(list(zip(cameras, [outlines for _, outlines in seen], strict=True)))
        found += [f"They would fit {words}"] if fits else []
    return " ".join(found)


def often_mistaken(cameras: Sequence[Camera]) -> Iterator[tuple[str, list[Camera]]]:
    """Yield mistakes that are often made in calibrations, in words after `They would fit`, and the cameras without them."""
    yield (
        "if rotation and translation in calibration.toml led from the camera to the world: are they the inverse of what is "
        "expected (p_camera = R p_world + t)?",
        [inverse(camera) for camera in cameras],
    )
    for i, j in combinations(range(len(cameras)), 2) if len(cameras) <= _MOST_EXCHANGED else ():
        a, b = cameras[i], cameras[j]
        exchanged = list(cameras)
        exchanged[i], exchanged[j] = replace(b, name=a.name), replace(a, name=b.name)
        yield (
            f"if cameras '{a.name}' and '{b.name}' were exchanged: are their files, or their names in calibration.toml?",
            exchanged,
        )


def inverse(camera: Camera) -> Camera:
    """Return a camera whose pose was given the other way round."""
    turn = camera.rotation.T
    return replace(camera, rotation=turn, translation=-turn @ camera.translation)


def _fit(seen: Sequence[_View]) -> bool:
    """Return whether the outlines of all pairs can be compared, touch common planes and lie before the cameras."""
    pairs = list(combinations(seen, 2))
    if any(_is_behind(a, b) for a, b in pairs):
        return False
    apart = ((_pixels_apart(a, b), a, b) for a, b in pairs)
    return bool(pairs) and all(px is not None and not _is_off(px, a, b) for px, a, b in apart)


def _is_behind(first: _View, second: _View) -> bool:
    """Return whether lines of sight to the middles of two cameras' outlines meet behind a camera in most frames: what
    silhouettes of a pair that looks one way tell of its order.
    """
    cameras = first[0], second[0]
    middles = np.array(
        [
            [a[0].mean(axis=0), b[0].mean(axis=0)]
            for a, b in zip(first[1], second[1], strict=True)
            if a is not None and b is not None and len(a[0]) and len(b[0])
        ]
    )
    met = triangulated(cameras, middles.reshape(-1, 2, 2).swapaxes(0, 1))
    met = met[np.isfinite(met).all(axis=1)]
    behind = np.any([camera.to_camera(met)[:, 2] < 0 for camera in cameras], axis=0)
    return len(met) >= _FEWEST and float(behind.mean()) > 0.5


def _pixels_apart(first: _View, second: _View) -> float | None:
    """Return how far two cameras' outlines miss common planes [px], the median over frames; None where too few can tell."""
    cameras = first[0], second[0]
    missed = []
    for a, b in zip(first[1], second[1], strict=True):
        if a is None or b is None:
            continue
        ends = _ends(a, *cameras), _ends(b, *cameras[::-1])
        apart = np.abs(ends[0] - ends[1]) * min(camera.focal_px for camera in cameras)
        if np.isfinite(apart).any():
            missed.append(float(np.nanmax(apart)))
    return float(np.median(missed)) if len(missed) >= _FEWEST else None


def _showing_other(views: Sequence[View], frames: Sequence[int]) -> dict[str, list[int]]:
    """Return in which frames a camera's mask shows something else than those of the others, by camera."""
    found: dict[str, list[int]] = {view.name: [] for view in views}
    for frame in frames:
        seen = tuple(s for view in views if (s := view.silhouette(frame)) is not None)
        if len(odd := suspected(seen)) == 1:
            found[odd[0].camera.name].append(frame)
    return found


def _outline(mask: Bytes, unknown: int | None, view: View) -> _Outline:
    x, y, width, height = view.settings.roi or (0, 0, *view.camera.size)
    found, _ = cv2.findContours(
        ((mask >= 128) & (mask != (unknown or 0))).astype(np.uint8),
        cv2.RETR_EXTERNAL,
        cv2.CHAIN_APPROX_NONE,
    )
    outlines = [outline for outline in found if max(cv2.boundingRect(outline)[2:]) > _SPECK_PX]
    pixels = np.concatenate([o[:, 0].astype(float) for o in outlines] or [np.zeros((0, 2))])
    least = np.array([x, y]) + _BORDER_PX
    whole = ((pixels >= least) & (pixels < least + (width, height) - 2 * _BORDER_PX)).all(axis=1)
    return pixels, np.asarray(whole)


def _ends(outline: _Outline, camera: Camera, other: Camera) -> Floats:
    """Return (2,) the least and the largest angle of an outline's pixels [rad]; NaN where the image or its region cuts them off."""
    pixels, is_whole = outline
    angles = plane_angles(camera, other, pixels) if len(pixels) else np.zeros(0)
    if not np.isfinite(angles).any():
        return np.full(2, np.nan)
    touching = [np.nanargmin(angles), np.nanargmax(angles)]
    return np.where(is_whole[touching], angles[touching], np.nan)
