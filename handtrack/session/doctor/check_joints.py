"""The doctor's look at whether joints seen in several images can be one hand's by the calibration, and a hand's in size."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from handtrack.arrays import D2, D3, Floats, J, N, T, indices
from handtrack.files.text_files import LIKELY_UNITS_M
from handtrack.geometry.camera import Camera
from handtrack.geometry.triangulation import missed_px, triangulated
from handtrack.model.articulated import keypoint_names
from handtrack.session.doctor.check_hand import PALM_M, check_palm, check_side_of
from handtrack.session.doctor.check_outlines import often_mistaken
from handtrack.session.doctor.check_views import Finding, ok, warning
from handtrack.session.session import Session

_INTERVAL = (
    200  # frames with joints, looked at one after the other: which are late shows in motion only
)
_FEWEST = 20  # points of a hand that two cameras see, over all frames
_MOST_OFF = 0.06
"""of the hand's extent in an image; a detector's points lie up to 10 mm apart on a hand of 180 mm, seen from two sides"""
_BETTER = 0.5  # times the miss, with what would fit
_BETTER_OFFSET = 0.75  # times the miss, with frames as they may belong together
_MOST_OFFSET = 3  # frames


_View = tuple[Camera, Floats[T, J, D2]]
"""a camera, and where it saw joints in its image as taken [px]; NaN where unknown"""
_Match = tuple[float, float, Floats[N, D3]]
"""how far joints miss each other, as a share of the hand's extent in the images, the median over points of the worst camera; the same
in pixels; the points of all frames and joints, world [m]"""


def check_joints(session: Session) -> Iterator[Finding]:
    """Yield findings about joints that two or more cameras saw: do they meet, is it a hand's size, are frames late?"""
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
    late = _time_offset(seen, found)
    if late:
        yield warning(late)
    else:
        odd = list(map(warning, _fingers_elsewhere(names, seen)))
        yield from odd or [ok(f"joints of {len(seen)} cameras meet in space to {_words(found)}.")]
    yield from _check_size(session, names, points.reshape(-1, len(names), 3))


_NOTHING_FITS = "Was a camera moved, does a matrix belong to another image size, or do frames of equal number show different moments?"


def _joints_by_view(session: Session) -> tuple[tuple[str, ...], list[_View]]:
    """Return joints' names, and where cameras saw them in the first frames in which two did."""
    files = {view: view.keypoint_files for view in session.views if view.keypoint_files}
    names = tuple(dict.fromkeys(name for one in files.values() for name in one.layout.points))
    rows: list[dict[str, dict[str, Floats[D2]]]] = []
    found = 0
    for frame in range(session.frame_count):
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


def _fingers_elsewhere(names: tuple[str, ...], seen: Sequence[_View]) -> Iterator[str]:
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


def _match(seen: Sequence[_View], rows: Sequence[int] | None = None) -> _Match | None:
    """Return how joints, all or those of some rows, fit together; None where too few are seen by two cameras."""
    extent = np.array([_extent(pixels) for _, pixels in seen])
    if rows is not None:
        seen = [(camera, pixels[:, rows]) for camera, pixels in seen]
    cameras = [camera for camera, _ in seen]
    straight = np.stack([camera.undistort_points(at).reshape(-1, 2) for camera, at in seen])
    points = triangulated(cameras, straight)
    missed = missed_px(cameras, straight, points)
    both = np.isfinite(straight).all(axis=2).sum(axis=0) > 1
    if both.sum() < _FEWEST:
        return None
    missed[:, both & ~np.isfinite(points).all(axis=1)] = np.inf  # parallel
    worst = np.nanmax(
        np.nan_to_num(missed[:, both], nan=-1.0, posinf=1e9) / extent[:, None], axis=0
    )
    px = np.nanmax(np.nan_to_num(missed[:, both], nan=-1.0, posinf=1e9), axis=0)
    return float(np.median(worst)), float(np.median(px)), points


def _extent(pixels: Floats[T, J, D2]) -> float:
    """Return how large the hand is in a camera's images [px], the median over frames; infinite where it is in none."""
    some = pixels[np.isfinite(pixels).any(axis=(1, 2))]
    if not len(some):
        return float("inf")
    return float(np.median((np.nanmax(some, axis=1) - np.nanmin(some, axis=1)).max(axis=1))) + 1e-9


def _what_would_fit(seen: Sequence[_View], found: _Match) -> str:
    """Return the mistake, of those often made, with which joints would meet best, as a question; empty for none."""
    tried = ((match[0], words) for words, match in _mistakes(seen) if match is not None)
    off, words = min(tried, default=(np.inf, ""))
    return words if off < min(_MOST_OFF, _BETTER * found[0]) else ""


def _mistakes(seen: Sequence[_View]) -> Iterator[tuple[str, _Match | None]]:
    for words, cameras in often_mistaken([camera for camera, _ in seen]):
        exchanged = list(zip(cameras, [pixels for _, pixels in seen], strict=True))
        yield f"They would meet {words}", _match(exchanged)
    for i, (camera, pixels) in enumerate(seen):
        mirrored = list(seen)
        mirrored[i] = camera, pixels * (-1, 1) + (camera.size[0] - 1, 0)
        yield (
            f"They would meet if the images of camera '{camera.name}' were mirrored: does its program flip them, as for a "
            "selfie?",
            _match(mirrored),
        )
    yield from _shifts(seen)
    for i, (camera, pixels) in enumerate(seen):
        for factor in (2 / 3, 0.5, 0.75, 4 / 3, 1.5, 2.0):
            scaled = list(seen)
            matrix = camera.matrix * np.array([[factor], [factor], [1.0]])
            scaled[i] = replace(camera, matrix=matrix), pixels
            yield (
                f"They would meet if the matrix of camera '{camera.name}' were {factor:.3g} times what it is: does it belong to "
                "images of another size? (`image_size` in session.toml scales it.)",
                _match(scaled),
            )


def _shifts(seen: Sequence[_View]) -> Iterator[tuple[str, _Match | None]]:
    """Yield by how many frames a camera may be late, in words, and how joints fit together then."""
    for i, (camera, pixels) in enumerate(seen):
        for shift in (*range(-_MOST_OFFSET, 0), *range(1, _MOST_OFFSET + 1)):
            moved = np.full_like(pixels, np.nan)
            if shift > 0:
                moved[:-shift] = pixels[shift:]
            else:
                moved[-shift:] = pixels[:shift]
            shifted = list(seen)
            shifted[i] = camera, moved
            frames = (
                f"{abs(shift)} frame{'s' * (abs(shift) > 1)} {'late' if shift > 0 else 'early'}"
            )
            yield (
                f"They would agree with camera '{camera.name}' {frames}: set `lag_s` in session.toml.",
                _match(shifted),
            )
        if len(seen) == 2:
            return  # the second late is the first early


def _time_offset(seen: Sequence[_View], found: _Match) -> str:
    """Return that frames fit clearly better as another number; empty where they do not."""
    good = ((words, match) for words, match in _shifts(seen) if match is not None)
    words, match = min(good, key=lambda one: one[1][0], default=("", found))
    if not words or match[0] > _BETTER_OFFSET * found[0]:
        return ""
    return f"joints meet in space to {_words(found)}. {words.replace('They would meet', f'They would meet to {_words(match)}')}"


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
