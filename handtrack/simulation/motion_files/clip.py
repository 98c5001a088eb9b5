"""MotionClip: joint positions over time, and how they stand in files: BVH, and AMC with its ASF as the CMU motion capture database gives them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from handtrack.arrays import D3, F, Floats, J
from handtrack.errors import HandtrackError, check_name, index_of
from handtrack.files.text_files import INCH_M, read_text
from handtrack.model.others.bvh import BvhJoint, numbers_of, read_hierarchy

LARGEST = 1 << 29  # bytes of a motion file: an hour


@dataclass(frozen=True)
class MotionClip:
    """What a motion capture file says of where joints are."""

    names: tuple[str, ...]
    """(J,) of the file's joints; a second end of the same joint is `<name>_end`"""
    positions: Floats[F, J, D3]
    """[m], the file's own axes"""
    fps: float
    """frames a second"""
    turns: Floats[F, J, D3, D3] | None = None
    """how each joint is turned in the file's axes, from its zero pose; None where the file does not say it"""

    def renamed(self, names: Mapping[str, str]) -> MotionClip:
        """Return only the joints that `names` lists (new name → the file's), under their new names."""
        columns = [index_of("joint", n, self.names, "the motion file") for n in names.values()]
        return MotionClip(tuple(names), self.positions[:, columns], self.fps)

    def resampled(self, fps: float) -> MotionClip:
        """Return the clip at another frame rate, places interpolated linearly."""
        count = int((len(self.positions) - 1) / self.fps * fps)
        at = np.arange(count) * self.fps / fps
        before = at.astype(int)
        share = (at - before)[:, None, None]
        places = (1 - share) * self.positions[before] + share * self.positions[before + 1]
        return MotionClip(self.names, places, fps)


# ---- BVH: a skeleton, and its joints over time


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
    places, turns = _placed([(one.parent, *_local(one, frames, positions)) for one in joints])
    known = [i for i, one in enumerate(joints) if one.offset.any() or not one.name.endswith("_end")]
    names = tuple(joints[i].name for i in known)
    return MotionClip(names, places[:, known] * unit_m, 1.0 / step, turns[:, known])


def _placed(
    joints: Sequence[tuple[int, Floats[F, D3, D3], Floats[F, D3]]],
) -> tuple[Floats[F, J, D3], Floats[F, J, D3, D3]]:
    """Return where joints are, and their turns, from the parent of each (−1 of a root), its turn and its place in that one; parents first."""
    turns, places = list[Floats](), list[Floats]()
    for parent, turn, place in joints:
        if parent >= 0:
            above = turns[parent]
            turn, place = above @ turn, places[parent] + np.einsum("fij,fj->fi", above, place)
        turns.append(turn)
        places.append(place)
    return np.stack(places, axis=1), np.stack(turns, axis=1)


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


# ---- A skeleton (.asf) with its motion (.amc)


FPS = 120.0
"""of the CMU database; the files do not say"""
_FREEDOMS = ("rx", "ry", "rz")


_Bones = dict[str, dict[str, Any]]
"""by name, what :bonedata says: numbers of `direction`, `length` and `axis` [°], words of `dof`; and the `parent`"""


def read_asf_amc(skeleton: Path, motion: Path, fps: float = FPS) -> MotionClip:
    """Return where the bones end; `root` is the root's own place.

    Lengths are `:units length` to the inch, angles degrees. With C = Rz Ry Rx of a bone's axis and M the frame's turn,
    R = R_parent C M C⁻¹, and a bone ends at its parent's end + R · direction · length. Raises HandtrackError.
    """
    bones, unit = _skeleton(skeleton)
    frames = _frames(motion, bones, skeleton)
    count = len(frames)
    root = np.array([frame["root"] for frame in frames]).reshape(count, 6)
    names = ("root", *(name for name in bones if name != "root"))
    joints = [(-1, _turn(root[:, 3:]), root[:, :3])]
    for name in names[1:]:
        bone, angles = bones[name], np.zeros((count, 3))
        for i, freedom in enumerate(bone["dof"]):
            angles[:, _FREEDOMS.index(freedom)] = [frame[name][i] for frame in frames]
        c = _turn(bone["axis"][None])[0]
        turn = c @ _turn(angles) @ c.T
        end = turn @ (bone["direction"] * bone["length"])
        joints.append((names.index(bone["parent"]), turn, end))
    return MotionClip(names, _placed(joints)[0] * unit, fps)


def _turn(angles_deg: Floats) -> Floats:
    """Return Rz Ry Rx (F, 3, 3) of angles (F, 3)."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_euler("xyz", angles_deg, degrees=True).as_matrix()


def _skeleton(path: Path) -> tuple[_Bones, float]:
    """Return the bones, parents first, and the metres in a unit."""
    bones: _Bones = {"root": {"dof": ()}}
    order: list[str] = ["root"]
    unit, section = INCH_M, ""
    bone: dict[str, Any] = {}
    for number, line in enumerate(read_text(path, "a skeleton (.asf)").splitlines(), 1):
        words = line.split()
        if not words or words[0].startswith("#"):
            continue
        try:
            if words[0].startswith(":"):
                section = words[0]
            elif section == ":units" and words[0] == "length":
                unit = INCH_M / float(words[1])
            elif section == ":units" and words[0] == "angle" and words[1] != "deg":
                raise ValueError("angles in degrees are expected")
            elif section == ":bonedata" and words[0] == "begin":
                bone = {"direction": np.zeros(3), "length": 0.0, "axis": np.zeros(3), "dof": ()}
            elif section == ":bonedata" and words[0] == "name":
                bones[words[1]] = bone
            elif section == ":bonedata" and words[0] in bone:
                bone[words[0]] = _bone_value(*words)
            elif section == ":hierarchy" and words[0] not in ("begin", "end"):
                for child in words[1:]:
                    bones[child]["parent"] = words[0]
                    order.append(child)
        except (ValueError, IndexError, KeyError) as error:
            raise HandtrackError(
                f"{path}, line {number}: cannot be understood: '{line.strip()[:60]}' ({error})."
            ) from None
    orphans = [n for n, bone in bones.items() if n != "root" and bone.get("parent") not in bones]
    if orphans or len(bones) < 2:
        raise HandtrackError(
            f"{path}: no bones, or bones without a place in :hierarchy: {', '.join(orphans) or 'all'}."
        )
    return {name: bones[name] for name in order}, unit


def _bone_value(key: str, *words: str) -> Any:
    """Return what a line of :bonedata says. Raises ValueError, IndexError."""
    if key == "dof":
        if not set(words) <= {*_FREEDOMS}:
            raise ValueError("freedoms rx, ry, rz are expected")
        return words
    if key == "axis" and words[3] != "XYZ":
        raise ValueError("an axis in the order XYZ is expected")
    numbers = np.array([float(word) for word in words[:3]])
    return numbers[0] if key == "length" else numbers


def _frames(path: Path, bones: _Bones, skeleton: Path) -> list[dict[str, list[float]]]:
    """Return each frame's numbers by bone."""
    frames: list[dict[str, list[float]]] = []
    for number, line in enumerate(read_text(path, "a motion (.amc)", LARGEST).splitlines(), 1):
        words = line.split()
        if not words or words[0][0] in "#:":
            continue
        if len(words) == 1 and words[0].isdecimal():
            frames.append({})
            continue
        name = words[0]
        check_name("bone", name, bones, f"{path}, line {number}")
        expected = 6 if name == "root" else len(bones[name]["dof"])
        try:
            values = [float(word) for word in words[1:]]
        except ValueError:
            values = []
        if len(values) != expected or not frames:
            raise HandtrackError(
                f"{path}, line {number}: expected a frame's number, then a bone with its numbers ({expected} of "
                f"'{name}' by {skeleton.name}); found '{line.strip()[:60]}'."
            )
        frames[-1][name] = values
    moving = {name for name, bone in bones.items() if bone["dof"]} | {"root"}
    for i, frame in enumerate(frames):
        if missing := sorted(moving - set(frame)):
            raise HandtrackError(f"{path}: frame {i + 1} lacks the bone '{missing[0]}'.")
    if not frames:
        raise HandtrackError(f"{path}: no frame was found.")
    return frames
