"""Read a skeleton (.asf) with its motion (.amc), as the CMU motion capture database gives them."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from handtrack.arrays import Floats
from handtrack.errors import HandtrackError, check_name
from handtrack.files.text_files import INCH_M, read_text
from handtrack.simulation.motion_files.clip import LARGEST, MotionClip

FPS = 120.0
"""of the CMU database; the files do not say"""


@dataclass
class _Bone:
    name: str
    direction: Floats = field(default_factory=lambda: np.zeros(3))
    length: float = 0.0
    axis_deg: Floats = field(default_factory=lambda: np.zeros(3))
    freedoms: tuple[str, ...] = ()
    parent: str = ""


def read_asf_amc(skeleton: Path, motion: Path, fps: float = FPS) -> MotionClip:
    """Return where the bones end; `root` is the root's own place.

    Lengths are `:units length` to the inch, angles degrees. With C = Rz Ry Rx of a bone's axis and M the frame's turn,
    R = R_parent C M C⁻¹, and a bone ends at its parent's end + R · direction · length. Raises HandtrackError.
    """
    bones, unit = _skeleton(skeleton)
    frames = _frames(motion, bones, skeleton)
    count = len(frames)
    root = np.array([frame["root"] for frame in frames]).reshape(count, 6)
    rotation = {"root": _turn(root[:, 3:])}
    end = {"root": root[:, :3]}
    for bone in bones.values():
        if bone.name == "root":
            continue
        angles = np.zeros((count, 3))
        for i, freedom in enumerate(bone.freedoms):
            at = ("rx", "ry", "rz").index(freedom)
            angles[:, at] = [frame[bone.name][i] for frame in frames]
        c = _turn(bone.axis_deg[None])[0]
        turn = rotation[bone.parent] @ c @ _turn(angles) @ c.T
        rotation[bone.name] = turn
        end[bone.name] = end[bone.parent] + turn @ (bone.direction * bone.length)
    names = tuple(end)
    return MotionClip(names, np.stack([end[name] for name in names], axis=1) * unit, fps)


def _turn(angles_deg: Floats) -> Floats:
    """Return Rz Ry Rx (F, 3, 3) of angles (F, 3)."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_euler("xyz", angles_deg, degrees=True).as_matrix()


def _skeleton(path: Path) -> tuple[dict[str, _Bone], float]:
    """Return the bones, parents first, and the metres in a unit."""
    bones = {"root": _Bone("root")}
    order: list[str] = ["root"]
    unit, section = INCH_M, ""
    current: _Bone | None = None
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
            elif section == ":bonedata":
                current = _bone_line(words, current, bones)
            elif section == ":hierarchy" and words[0] not in ("begin", "end"):
                for child in words[1:]:
                    bones[child].parent = bones[words[0]].name
                    order.append(child)
        except (ValueError, IndexError, KeyError) as error:
            raise HandtrackError(
                f"{path}, line {number}: cannot be understood: '{line.strip()[:60]}' ({error})."
            ) from None
    orphans = [name for name in bones if name not in order]
    if orphans or len(bones) < 2:
        raise HandtrackError(
            f"{path}: no bones, or bones without a place in :hierarchy: {', '.join(orphans) or 'all'}."
        )
    return {name: bones[name] for name in order}, unit


def _bone_line(words: list[str], current: _Bone | None, bones: dict[str, _Bone]) -> _Bone | None:
    """Take in a line of :bonedata; return the bone that the next line speaks of."""
    key = words[0]
    if key == "begin":
        return _Bone("")
    if key == "end" or current is None:
        return None
    if key == "name":
        current.name = words[1]
        bones[current.name] = current
    elif key == "direction":
        current.direction = np.array([float(word) for word in words[1:4]])
    elif key == "length":
        current.length = float(words[1])
    elif key == "axis":
        if words[4] != "XYZ":
            raise ValueError("an axis in the order XYZ is expected")
        current.axis_deg = np.array([float(word) for word in words[1:4]])
    elif key == "dof":
        if not set(words[1:]) <= {"rx", "ry", "rz"}:
            raise ValueError("freedoms rx, ry, rz are expected")
        current.freedoms = tuple(words[1:])
    return current


def _frames(path: Path, bones: dict[str, _Bone], skeleton: Path) -> list[dict[str, list[float]]]:
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
        expected = 6 if name == "root" else len(bones[name].freedoms)
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
    moving = {name for name, bone in bones.items() if bone.freedoms} | {"root"}
    for i, frame in enumerate(frames):
        if missing := sorted(moving - set(frame)):
            raise HandtrackError(f"{path}: frame {i + 1} lacks the bone '{missing[0]}'.")
    if not frames:
        raise HandtrackError(f"{path}: no frame was found.")
    return frames
