"""Read a skeleton (.asf) with its motion (.amc), as the CMU motion capture database gives them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from handtrack.arrays import Floats
from handtrack.errors import HandtrackError, check_name
from handtrack.files.text_files import INCH_M, read_text
from handtrack.simulation.motion_files.clip import LARGEST, MotionClip

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
    rotation = {"root": _turn(root[:, 3:])}
    end = {"root": root[:, :3]}
    for name, bone in bones.items():
        if name == "root":
            continue
        angles, above = np.zeros((count, 3)), bone["parent"]
        for i, freedom in enumerate(bone["dof"]):
            angles[:, _FREEDOMS.index(freedom)] = [frame[name][i] for frame in frames]
        c = _turn(bone["axis"][None])[0]
        rotation[name] = rotation[above] @ c @ _turn(angles) @ c.T
        end[name] = end[above] + rotation[name] @ (bone["direction"] * bone["length"])
    names = tuple(end)
    return MotionClip(names, np.stack([end[name] for name in names], axis=1) * unit, fps)


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
