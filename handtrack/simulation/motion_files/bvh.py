"""Read a BVH file: a skeleton, and its joints' positions over time."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from handtrack.arrays import D3, F, Floats, J
from handtrack.errors import HandtrackError
from handtrack.files.bvh_hierarchy import BvhJoint, numbers_of, read_hierarchy
from handtrack.files.text_files import read_text
from handtrack.simulation.motion_files.clip import LARGEST, MotionClip

POSITIONS = ("add", "replace")
_LASTING = 0.02  # share of their length by which bones of captured people change at most
_DIGITS = 1e-4  # by which written numbers are rounded
_CLEARLY = 5.0  # times as much in the other meaning


def read_bvh(path: Path, positions: str | None = None, unit_m: float = 0.01) -> MotionClip:
    """Return the joints' positions.

    End sites that stand off their joint are `<joint>_end`.

    Parameters
    ----------
    positions
        Whether a joint's position channels `add` to its OFFSET, as files with channels of the root
        alone mean it, or `replace` it, as files do that give six channels to every joint; None: as
        the file shows it, for bones keep their lengths.
    unit_m
        Metres in the file's unit.

    Raises
    ------
    HandtrackError
        Naming file and line, and where the file does not show what positions mean.
    """
    if positions is not None and positions not in POSITIONS:
        raise HandtrackError(
            f"read_bvh: positions '{positions}'; expected one of {', '.join(POSITIONS)}."
        )
    lines = read_text(path, "a BVH file", LARGEST).splitlines()
    joints, after = read_hierarchy(lines, path)
    width = sum(len(joint.channels) for joint in joints)
    frames, step = _motion(lines, after, width, path)
    positions = positions or _meaning(joints, frames, path)
    rotation: list[Floats] = []
    place: list[Floats] = []
    for joint in joints:
        turn, move = _local(joint, frames, positions)
        if joint.parent < 0:
            rotation.append(turn)
            place.append(move)
        else:
            above = rotation[joint.parent]
            rotation.append(above @ turn)
            place.append(place[joint.parent] + np.einsum("fij,fj->fi", above, move))
    known = [i for i, one in enumerate(joints) if one.offset.any() or not one.name.endswith("_end")]
    names = tuple(joints[i].name for i in known)
    places, turns = (np.stack([one[i] for i in known], axis=1) for one in (place, rotation))
    return MotionClip(names, places * unit_m, 1.0 / step, turns)


def _meaning(joints: list[BvhJoint], frames: Floats, path: Path) -> str:
    """Return whether positions add or replace: that by which bones keep their lengths. Raises HandtrackError."""
    moved = [
        joint
        for joint in joints
        if joint.parent >= 0 and any(c.endswith("position") for c in joint.channels)
    ]
    if not moved:
        return "add"
    moves = np.stack([_local(joint, frames, "replace")[1] for joint in moved])  # (joints, F, 3)
    offsets = np.array([joint.offset for joint in moved])
    size = max(float(np.linalg.norm(offsets, axis=1).mean()), 1e-12)
    still = moves.std(axis=1).max(axis=1) < _LASTING * size  # the others carry the whole body about
    off = {"replace": np.abs(moves.mean(axis=1) - offsets), "add": np.abs(moves.mean(axis=1))}
    for kind in ("replace", "add"):  # each frame repeats the OFFSETs; or none says anything
        if still.any() and off[kind][still].max() < _LASTING * size:
            return kind
    change = {
        "add": _change(moves[~still] + offsets[~still, None]),
        "replace": _change(moves[~still]),
    }
    best, other = sorted(POSITIONS, key=change.__getitem__)
    if change[best] < _LASTING and change[other] > _CLEARLY * max(change[best], _DIGITS):
        return best
    raise HandtrackError(
        f"{path}: joints have position channels, and the file does not show whether they add to the OFFSETs or replace them (bones "
        f"change by {change['add']:.1%} of their length if they add, by {change['replace']:.1%} if they replace). Say which: "
        "--positions add or --positions replace."
    )


def _change(places: Floats[J, F, D3]) -> float:
    """Return how much bones' lengths change over time, their standard deviations' sum over their means' sum."""
    lengths = np.linalg.norm(places, axis=2)
    return float(lengths.std(axis=1).sum() / max(lengths.mean(axis=1).sum(), 1e-12))


def _motion(lines: list[str], at: int, width: int, path: Path) -> tuple[Floats, float]:
    """Return the frames' numbers (F, width) and the seconds between frames."""
    count, step = -1, 0.0
    for number in range(at + 1, len(lines)):
        words = lines[number].split()
        if words[:1] == ["Frames:"]:
            count = int(numbers_of(words[1:], 1, path, number, lines[number])[0])
        elif words[:2] == ["Frame", "Time:"]:
            step = numbers_of(words[2:], 1, path, number, lines[number])[0]
            first = number + 1
            break
    else:
        raise HandtrackError(f"{path}: no lines 'Frames:' and 'Frame Time:' after MOTION.")
    if not step > 0:
        raise HandtrackError(f"{path}: Frame Time {step:g}; expected seconds above 0.")
    rows = [
        numbers_of(line.split(), width, path, number, line)
        for number, line in enumerate(lines[first:], first)
        if line.strip()
    ]
    if len(rows) != count:
        raise HandtrackError(f"{path}: 'Frames: {count}', but {len(rows)} frames follow.")
    return np.array(rows, dtype=float).reshape(len(rows), width), step


def _local(joint: BvhJoint, frames: Floats, positions: str) -> tuple[Floats, Floats]:
    """Return rotation (F, 3, 3) and place (F, 3) of a joint in its parent."""
    from scipy.spatial.transform import Rotation

    turn = Rotation.identity(len(frames))
    moved = np.zeros((len(frames), 3))
    given = np.zeros(3, bool)
    for c, channel in enumerate(joint.channels):
        axis, values = "xyz".index(channel[0]), frames[:, joint.first + c]
        if channel.endswith("position"):
            moved[:, axis] = values
            given[axis] = True
        else:
            turn = turn * Rotation.from_euler(channel[0], values[:, None], degrees=True)
    kept = np.where(given & (positions == "replace"), 0.0, joint.offset)
    return turn.as_matrix(), kept + moved
