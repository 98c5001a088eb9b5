"""Anybody's motion file as joint positions in metres: its form by its content, its unit and its upright axis by a person's size."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from handtrack.arrays import D3, F, Floats, J
from handtrack.capture.joints.subject import BODY, HAND
from handtrack.errors import HandtrackError
from handtrack.files.text_files import LIKELY_UNITS_M, check_file, first_bytes
from handtrack.session.formats.imported_truth import read_markers
from handtrack.simulation.motion_files.asf_amc import FPS, read_asf_amc
from handtrack.simulation.motion_files.bvh import read_bvh
from handtrack.simulation.motion_files.clip import LARGEST, MotionClip

ACCEPTED = "BVH, AMC with its ASF, TRC, C3D, or a CSV with the columns frame and <joint>_x, _y, _z"
_SIMILAR = 1.55  # ratio to an adult's length: less than √2.54, half of what is between centimetres and inches
_AXES = ("x", "y", "z")


def read_motion(
    path: Path, skeleton: Path | None, fps: float | None, positions: str | None
) -> tuple[MotionClip, float | None, str]:
    """Return what a file says of where joints are, in its unit; metres in one unit, where it says
    that; and which form it has, in words.

    Parameters
    ----------
    skeleton
        The .asf of an .amc; without it, the only one beside it.
    fps
        Frames a second, where the file says none.
    positions
        Of a BVH, see `read_bvh`.

    Raises
    ------
    HandtrackError
    """
    check_file(path, "a motion", LARGEST)
    suffix, start = path.suffix.lower(), first_bytes(path)
    if start.lstrip()[:9].upper() == b"HIERARCHY":
        clip = read_bvh(path, positions, 1.0)
        return replace(clip, fps=fps or clip.fps), None, "BVH"
    if suffix == ".amc":
        told = (
            "AMC"
            if fps
            else "AMC (its rate, which it does not say, is that of the CMU database; --fps)"
        )
        return read_asf_amc(skeleton or _skeleton_of(path), path, fps or FPS), 1.0, told
    if suffix == ".asf":
        raise HandtrackError(
            f"{path} is a skeleton alone; give the motion, an .amc file, and this with --skeleton."
        )
    markers = read_markers(path)
    rate = fps or _rate(markers.times_s)
    if rate is None:
        raise HandtrackError(
            f"{path}: it does not say how many frames a second there are; give it with --fps."
        )
    return MotionClip(markers.names, markers.values, rate), markers.unit_m, "points in space"


def in_metres(
    clip: MotionClip, names: Mapping[str, str], kind: str, unit_m: float | None, where: str
) -> tuple[MotionClip, float, list[str]]:
    """Return a model's joints [m] in the file's axes, the metres in its unit, and what was assumed
    of that, in sentences.

    Parameters
    ----------
    clip
        In the file's unit.
    names
        The model's joints → the file's.
    kind
        Body or hand.
    unit_m
        What the file or the user says.

    Raises
    ------
    HandtrackError
        Where the unit cannot be told by a person's size.
    """
    clip = clip.renamed(names)
    subject = BODY if kind == "body" else HAND
    length = _length(clip, subject.chains)
    if unit_m is not None:
        notes = []
        if length is not None and not subject.fits(length * unit_m):
            notes.append(
                f"note: with {unit_m:g} m a unit the {kind} is {100 * length * unit_m:.3g} cm long; expected {subject.range_words}."
            )
        return MotionClip(clip.names, clip.positions * unit_m, clip.fps), unit_m, notes
    if length is None:
        raise HandtrackError(
            f"{where}: how many metres is one unit? The joints that would tell it are missing; say it with --unit-m, such as 0.01."
        )
    off = {
        word: abs(np.log(length * unit / subject.usual_m)) for word, unit in LIKELY_UNITS_M.items()
    }
    word = min(off, key=off.__getitem__)
    if off[word] > np.log(_SIMILAR):
        raise HandtrackError(
            f"{where}: its {kind} is {length:.4g} long, which is nobody in {', '.join(LIKELY_UNITS_M)}. Say how many metres one unit is with "
            f"--unit-m ({subject.usual_m / length:.3g} would make an adult). If joints are far apart, --positions may be wrong."
        )
    unit = LIKELY_UNITS_M[word]
    said = f"unit: {word}; the {kind} is {100 * length * unit:.0f} cm from {'ankle to shoulder' if kind == 'body' else 'wrist to tip'}."
    return MotionClip(clip.names, clip.positions * unit, clip.fps), unit, [said]


def upright_axis(clip: MotionClip) -> tuple[int, float] | None:
    """Return the axis along which a body's shoulders are above its hips most, and the sign; None where that is not seen.

    Somebody who lies all the time tells a wrong one.
    """
    pairs = [(f"{side}_shoulder", f"{side}_hip") for side in ("left", "right")]
    known = [(a, b) for a, b in pairs if a in clip.names and b in clip.names]
    if not known:
        return None
    up = np.mean([_of(clip, a) - _of(clip, b) for a, b in known], axis=0)
    mean = np.nanmean(up, axis=0)
    axis = int(np.argmax(np.abs(mean)))
    return axis, float(np.sign(mean[axis]))


def axis_words(axis: tuple[int, float]) -> str:
    """Return an upright axis in words, such as `+z`."""
    return f"{'+' if axis[1] > 0 else '−'}{_AXES[axis[0]]}"


def turned_upright(positions: Floats[F, J, D3], axis: tuple[int, float]) -> Floats[F, J, D3]:
    """Return positions turned so that the axis is +y, by a quarter or half turn."""
    turn = np.zeros((3, 3))
    turn[0, (axis[0] + 1) % 3] = 1.0
    turn[1, axis[0]] = axis[1]
    turn[2] = np.cross(turn[0], turn[1])
    return np.asarray(np.einsum("ij,fkj->fki", turn, positions), dtype=float)


def _of(clip: MotionClip, name: str) -> Floats[F, D3]:
    return clip.positions[:, clip.names.index(name)]


def _length(clip: MotionClip, chains: tuple[tuple[str, ...], ...]) -> float | None:
    """Return the median length of chains along their joints; parts of a chain count where all is not there."""
    found = []
    for chain in chains:
        if all(name in clip.names for name in chain):
            points = np.stack([_of(clip, name) for name in chain])
            found.append(np.linalg.norm(np.diff(points, axis=0), axis=2).sum(axis=0))
    lengths = np.concatenate(found) if found else np.zeros(0)
    lengths = lengths[np.isfinite(lengths)]
    return float(np.median(lengths)) if len(lengths) else None


def _skeleton_of(path: Path) -> Path:
    beside = sorted(p for p in path.parent.iterdir() if p.suffix.lower() == ".asf")
    same = [p for p in beside if path.stem.startswith(p.stem)]
    if len(same) == 1 or len(beside) == 1:
        return (same or beside)[0]
    raise HandtrackError(
        f"{path}: an AMC file needs its skeleton, and {'several lie' if beside else 'none lies'} beside it; give it with --skeleton "
        "FILE.asf."
    )


def _rate(times_s: Floats[F] | None) -> float | None:
    if times_s is None or len(times_s) < 2:
        return None
    step = float(np.median(np.diff(times_s)))
    return 1.0 / step if step > 0 else None
