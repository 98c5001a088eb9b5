"""The doctor's look at whether what several cameras saw can be of one thing, by the calibration: silhouettes, and joints.

Planes through both cameras' centres that touch a body touch its outline in both pictures: the range of their angles is the same.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations

import cv2
import numpy as np

from handtrack.arrays import D2, D3, Array, Floats, J, N, T, evenly_spread, indices
from handtrack.capture.images.frames import listed
from handtrack.capture.images.synchrony import plane_angles
from handtrack.files.text_files import LIKELY_UNITS_M
from handtrack.geometry.camera import Camera
from handtrack.geometry.triangulation import missed_px, triangulated
from handtrack.model.articulated import keypoint_names
from handtrack.observation.agreement import suspected
from handtrack.session.doctor.check_hand import PALM_M, check_palm, check_side_of
from handtrack.session.doctor.check_views import Finding, ok, warning
from handtrack.session.session import Session
from handtrack.session.sources.views import View

_OUTLINE_FRAMES = 12
_FEWEST_OUTLINES = 3  # comparisons
_MOST_EXCHANGED = 6  # cameras; among more, it is not looked which two may be exchanged
_BORDER_PX = 3  # an outline that near to the image's border is cut off, not touched
_SPECK_PX = 5
_OUTLINES_OFF = 0.01  # of the images' width; good recordings are off by 0.1 to 2 px
_OUTLINES_OFF_PX = 5.0


def check_outlines(session: Session, frames: Sequence[int] | None = None) -> Iterator[Finding]:
    """Yield a finding about pairs of cameras whose silhouettes do not fit together. frames: unless evenly spread ones."""
    views = [view for view in session.views if view.has_masks]
    frames = evenly_spread(session.frame_count, _OUTLINE_FRAMES) if frames is None else frames
    other = _showing_other(views, frames)
    for name, there in other.items():
        if there:
            yield warning(
                f"camera '{name}': in {len(there)} of the {len(frames)} frames looked at, its mask shows something that is hand in none of "
                f"the other cameras (frames {listed(there)}). Tracking leaves such masks out. Is a shadow or another object taken for the hand there?"
            )
    seen = [
        (view.camera, [_outline(view, f, f in other[view.name]) for f in frames]) for view in views
    ]
    compared = [
        (f"'{a[0].name}' and '{b[0].name}'", *_compared(a, b)) for a, b in combinations(seen, 2)
    ]
    off = [f"{names} by {px:.0f} px" for names, px, is_off, _ in compared if is_off]
    behind = [names for names, _, _, is_behind in compared if is_behind]
    nobody_can_tell = all(px is None for _, px, _, _ in compared)
    meant = _outlines_would_fit(seen) if off or behind or nobody_can_tell else ""
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
                or "Do masks show more or less than the hand, was a camera moved, does its matrix belong to another image size, are "
                "cameras exchanged, or do frames of equal number show different moments?"
            )
        )
    elif meant:
        yield warning(f"silhouettes of no two cameras can be compared by this calibration. {meant}")


_Outline = tuple[Floats[N, D2], Array[N]]
"""pixels, none where nothing is seen; whether the image or its region does not cut the hand off at each"""
_Outlined = tuple[Camera, list[_Outline]]
"""a camera, and its outlines in some frames"""


def _compared(first: _Outlined, second: _Outlined) -> tuple[float | None, bool, bool]:
    """Return how far two cameras' outlines miss common planes [px], the median over frames, None where too few can tell; whether
    that is too far; and whether the hand lies behind the cameras.
    """
    px = _pixels_apart(first, second)
    width = min(first[0].size[0], second[0].size[0])
    is_off = px is not None and px > max(_OUTLINES_OFF * width, _OUTLINES_OFF_PX)
    return px, is_off, _is_behind(first, second)


def _outlines_would_fit(seen: Sequence[_Outlined]) -> str:
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


def _fit(seen: Sequence[_Outlined]) -> bool:
    """Return whether the outlines of all pairs can be compared, touch common planes and lie before the cameras."""
    compared = (_compared(a, b) for a, b in combinations(seen, 2))
    fits = (px is not None and not (is_off or is_behind) for px, is_off, is_behind in compared)
    return len(seen) > 1 and all(fits)


def _is_behind(first: _Outlined, second: _Outlined) -> bool:
    """Return whether lines of sight to the middles of two cameras' outlines meet behind a camera in most frames: what
    silhouettes of a pair that looks one way tell of its order.
    """
    cameras = first[0], second[0]
    middles = np.array(
        [
            [a[0].mean(axis=0), b[0].mean(axis=0)]
            for a, b in zip(first[1], second[1], strict=True)
            if len(a[0]) and len(b[0])
        ]
    )
    met = triangulated(cameras, middles.reshape(-1, 2, 2).swapaxes(0, 1))
    met = met[np.isfinite(met).all(axis=1)]
    behind = np.any([camera.to_camera(met)[:, 2] < 0 for camera in cameras], axis=0)
    return len(met) >= _FEWEST_OUTLINES and float(behind.mean()) > 0.5


def _pixels_apart(first: _Outlined, second: _Outlined) -> float | None:
    cameras = first[0], second[0]
    missed = []
    for a, b in zip(first[1], second[1], strict=True):
        ends = _ends(a, *cameras), _ends(b, *cameras[::-1])
        apart = np.abs(ends[0] - ends[1]) * min(camera.focal_px for camera in cameras)
        if np.isfinite(apart).any():
            missed.append(float(np.nanmax(apart)))
    return float(np.median(missed)) if len(missed) >= _FEWEST_OUTLINES else None


def _showing_other(views: Sequence[View], frames: Sequence[int]) -> dict[str, list[int]]:
    """Return in which frames a camera's mask shows something else than those of the others, by camera."""
    found: dict[str, list[int]] = {view.name: [] for view in views}
    for frame in frames:
        seen = tuple(s for view in views if (s := view.silhouette(frame)) is not None)
        if len(odd := suspected(seen)) == 1:
            found[odd[0].camera.name].append(frame)
    return found


def _outline(view: View, frame: int, left_out: bool) -> _Outline:
    mask = None if left_out else view.mask(frame)
    if mask is None:
        return np.zeros((0, 2)), np.zeros(0, bool)
    x, y, width, height = view.settings.roi or (0, 0, *view.camera.size)
    found, _ = cv2.findContours(
        ((mask >= 128) & (mask != (view.unknown_at(frame) or 0))).astype(np.uint8),
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


# ---- Whether joints seen in several images can be one hand's by the calibration, and a hand's in size


_INTERVAL = (
    200  # frames with joints, looked at one after the other: which are late shows in motion only
)
_FEWEST = 20  # points of a hand that two cameras see, over all frames
_MOST_OFF = 0.06
"""of the hand's extent in an image; a detector's points lie up to 10 mm apart on a hand of 180 mm, seen from two sides"""
_BETTER = 0.5  # times the miss, with what would fit
_BETTER_OFFSET = 0.75  # times the miss, with frames as they may belong together
_MOST_OFFSET = 3  # frames
_SHARED = 0.5  # of the points that a camera shares with others, so that a shift can be compared


_Seen = tuple[Camera, Floats[T, J, D2]]
"""a camera, and where it saw joints in its image as taken [px]; NaN where unknown"""
_Match = tuple[float, float, Floats[N, D3]]
"""how far joints miss each other, as a share of the hand's extent in the images, the median over points of the worst camera; the same
in pixels; the points of all frames and joints, world [m]"""
_Tried = tuple[str, _Match | None]
"""something that may be otherwise than it was said, in words, and how joints fit together then"""


def check_joints(session: Session, briefly: bool = False) -> Iterator[Finding]:
    """Yield findings about joints that two or more cameras saw: do they meet, is it a hand's size, are frames late?

    briefly: only what would make tracking vain.
    """
    names, seen = _joints_by_view(session)
    if len(seen) < 2 or (found := _match(seen)) is None:
        return
    off, _, points = found
    if off > _MOST_OFF:
        yield warning(
            f"joints seen by cameras {', '.join(repr(camera.name) for camera, _ in seen)} do not meet in space by this calibration: they "
            f"miss each other by {_words(found)}. {_what_would_fit(seen, found) or _NOTHING_FITS}"
        )
        return
    if not briefly:
        late = _time_offset(seen, found)
        odd = [late] if late else list(_fingers_elsewhere(names, seen))
        meet = ok(f"joints of {len(seen)} cameras meet in space to {_words(found)}.")
        yield from map(warning, odd) if odd else [meet]
    yield from _check_size(session, names, points.reshape(-1, len(names), 3))


_NOTHING_FITS = "Was a camera moved, does a matrix belong to another image size, or do frames of equal number show different moments?"


def _joints_by_view(session: Session) -> tuple[tuple[str, ...], list[_Seen]]:
    """Return joints' names, and where cameras saw them in the first frames in which two did."""
    files = {view: view.keypoint_files for view in session.views if view.keypoint_files}
    names = tuple(dict.fromkeys(name for one in files.values() for name in one.layout.points))
    rows: list[dict[str, dict[str, Floats[D2]]]] = []
    found = 0
    for frame in session.known_frames:
        row = {}
        for view, one in files.items():
            own = view.own_frame(frame)
            row[view.name] = {} if own is None else one.as_taken(own)
        rows.append(row)
        found += sum(map(bool, row.values())) > 1
        if found >= _INTERVAL:
            break
    seen = []
    for view in files:
        pixels = np.full((len(rows), len(names), 2), np.nan)
        for at, row in enumerate(rows):
            for name, pixel in row[view.name].items():
                pixels[at, names.index(name)] = pixel
        if np.isfinite(pixels).any():
            seen.append((view.camera, pixels))
    return names, seen


def _fingers_elsewhere(names: tuple[str, ...], seen: Sequence[_Seen]) -> Iterator[str]:
    """Yield that one camera sees the joints of a finger elsewhere than all others do, which agree without it."""
    hand = keypoint_names()
    if len(seen) < 3 or not set(hand) <= set(names):
        return
    for first in range(1, len(hand), 4):
        rows = indices(names, hand[first : first + 4])
        rest = [(one, _match([o for o in seen if o is not one], rows)) for one in seen]
        known = sorted(((m, *one) for one, m in rest if m), key=lambda found: found[0][0])
        if len(known) < 2 or known[0][0][0] > _MOST_OFF:
            continue
        others, camera, pixels = known[0]
        least = known[1][0][0]  # without any other camera
        if least <= _MOST_OFF and others[0] > _BETTER * least:
            continue
        straight = camera.undistort_points(pixels[:, rows]).reshape(1, -1, 2)
        missed = missed_px([camera], straight, others[2])
        px = float(np.median(missed[np.isfinite(missed)])) if np.isfinite(missed).any() else 0.0
        if px > _MOST_OFF * _extent(pixels):
            yield (
                f"camera '{camera.name}' sees the joints of the {hand[first].split('_')[0]} {px:.0f} px (median) beside where all other cameras "
                f"see them, which agree to {_words(others)}. Tracking mostly lets them go; is another hand or an object mistaken for the finger in "
                "its images?"
            )


def _match(seen: Sequence[_Seen], rows: Sequence[int] | None = None) -> _Match | None:
    """Return how joints, all or those of some rows, fit together; None where too few are seen by two cameras."""
    extent = np.array([_extent(pixels) for _, pixels in seen])
    if rows is not None:
        seen = [(camera, pixels[:, rows]) for camera, pixels in seen]
    cameras = [camera for camera, _ in seen]
    pixels = np.stack([at.reshape(-1, 2) for _, at in seen])
    both = np.isfinite(pixels).all(axis=2).sum(axis=0) > 1
    if both.sum() < _FEWEST:
        return None
    straight = np.stack(
        [camera.undistort_points(at[both]) for camera, at in zip(cameras, pixels, strict=True)]
    )
    met = triangulated(cameras, straight)
    missed = missed_px(cameras, straight, met)
    missed[:, ~np.isfinite(met).all(axis=1)] = np.inf  # parallel
    missed = np.nan_to_num(missed, nan=-1.0, posinf=1e9)
    worst, px = (missed / extent[:, None]).max(axis=0), missed.max(axis=0)
    points = np.full((len(both), 3), np.nan)
    points[both] = met
    return float(np.median(worst)), float(np.median(px)), points


def _extent(pixels: Floats[T, J, D2]) -> float:
    """Return how large the hand is in a camera's images [px], the median over frames; infinite where it is in none."""
    some = pixels[np.isfinite(pixels).any(axis=(1, 2))]
    if not len(some):
        return float("inf")
    return float(np.median((np.nanmax(some, axis=1) - np.nanmin(some, axis=1)).max(axis=1))) + 1e-9


def _what_would_fit(seen: Sequence[_Seen], found: _Match) -> str:
    """Return the mistake, of those often made, with which joints would meet best, as a question; empty for none."""
    return _best(_mistakes(seen), min(_MOST_OFF, _BETTER * found[0]))


def _best(tried: Iterator[_Tried], most: float) -> str:
    """Return with what joints meet best, in words; empty where they miss each other by as much as that with everything."""
    off, words = min(((m[0], words) for words, m in tried if m is not None), default=(most, ""))
    return words if off < most else ""


def _mistakes(seen: Sequence[_Seen]) -> Iterator[_Tried]:
    for words, cameras in often_mistaken([camera for camera, _ in seen]):
        exchanged = list(zip(cameras, [pixels for _, pixels in seen], strict=True))
        yield f"They would meet {words}", _match(exchanged)
    for i, (camera, pixels) in enumerate(seen):
        mirrored = camera, pixels * (-1, 1) + (camera.size[0] - 1, 0)
        yield (
            f"They would meet if the images of camera '{camera.name}' were mirrored: does its program flip them, as for a "
            "selfie?",
            _match([*seen[:i], mirrored, *seen[i + 1 :]]),
        )
    yield from _shifts(seen)
    for i, (camera, pixels) in enumerate(seen):
        for factor in (2 / 3, 0.5, 0.75, 4 / 3, 1.5, 2.0):
            matrix = camera.matrix * np.array([[factor], [factor], [1.0]])
            scaled = replace(camera, matrix=matrix), pixels
            yield (
                f"They would meet if the matrix of camera '{camera.name}' were {factor:.3g} times what it is: does it belong to "
                "images of another size? (`image_size` in session.toml scales it.)",
                _match([*seen[:i], scaled, *seen[i + 1 :]]),
            )


def _shifts(seen: Sequence[_Seen]) -> Iterator[_Tried]:
    """Yield by how many frames a camera may be late, in words, and how joints fit together then.

    A shift after which the camera shares hardly a frame with the others says nothing: those then fit together without it, as where
    joints were marked in every tenth frame.
    """
    known = [np.isfinite(pixels).all(axis=2) for _, pixels in seen]
    for i, (camera, pixels) in enumerate(seen):
        others = np.any([*known[:i], *known[i + 1 :]], axis=0)
        shared = np.count_nonzero(known[i] & others)
        for shift in (*range(-_MOST_OFFSET, 0), *range(1, _MOST_OFFSET + 1)):
            moved = np.full_like(pixels, np.nan)
            if shift > 0:
                moved[:-shift] = pixels[shift:]
            else:
                moved[-shift:] = pixels[:shift]
            if np.count_nonzero(np.isfinite(moved).all(axis=2) & others) < _SHARED * shared:
                continue
            frames = (
                f"{abs(shift)} frame{'s' * (abs(shift) > 1)} {'late' if shift > 0 else 'early'}"
            )
            yield (
                f"They would agree with camera '{camera.name}' {frames}: set `lag_s` in session.toml.",
                _match([*seen[:i], (camera, moved), *seen[i + 1 :]]),
            )
        if len(seen) == 2:
            return  # the second late is the first early


def _time_offset(seen: Sequence[_Seen], found: _Match) -> str:
    """Return that frames fit clearly better as another number; empty where they do not."""
    words = _best(_shifts(seen), _BETTER_OFFSET * found[0])
    return words and f"joints meet in space to {_words(found)}. {words}"


def joint_lines(session: Session) -> list[Floats[N, D3]]:
    """Return the hand's fingers as lines from the wrist, world [m], in a frame whose joints most cameras see; none without."""
    names, seen = _joints_by_view(session)
    hand = keypoint_names()
    if len(seen) < 2 or not set(hand) <= set(names) or (found := _match(seen)) is None:
        return []
    xyz = found[2].reshape(-1, len(names), 3)[:, indices(names, hand)]
    best = xyz[int(np.argmax(np.isfinite(xyz).all(axis=2).sum(axis=1)))]
    rows = [best[[0, *range(k, k + 4)]] for k in range(1, 21, 4)]
    return [row[np.isfinite(row).all(axis=1)] for row in rows if np.isfinite(row).all(axis=1).any()]


def _check_size(
    session: Session, names: tuple[str, ...], xyz: Floats[T, J, D3]
) -> Iterator[Finding]:
    """Yield that the hand is none in size or is the other one."""
    hand = keypoint_names()
    if not set(hand) <= set(names):
        return
    xyz = xyz[:, indices(names, hand)]
    palms = np.linalg.norm(xyz[:, 9] - xyz[:, 0], axis=1)
    if not np.isfinite(palms).any():
        return
    palm, unit = float(np.nanmedian(palms)), session.file.session.world_unit_m
    if not PALM_M[0] <= palm <= PALM_M[1]:
        fitting = [
            f"With world_unit_m = {other:g} ({word}) it were {1e3 * palm * other / unit:.0f} mm."
            for word, other in LIKELY_UNITS_M.items()
            if PALM_M[0] <= palm * other / unit <= PALM_M[1]
        ]
        yield from (
            warning(f"{finding.text} {' '.join(fitting)}".strip())
            for finding in check_palm("joints in space", xyz[int(np.nanargmin(abs(palms - palm)))])
        )
        return
    whole = np.isfinite(xyz).all(axis=2).sum(axis=1)
    yield from check_side_of("joints in space", xyz[int(np.argmax(whole))], session)


def _words(match: _Match) -> str:
    px = "more than the image" if match[1] > 1e5 else f"{match[1]:.1f} px"
    return f"{px} (median)"
