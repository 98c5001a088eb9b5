"""BVH: an animated skeleton, for Blender, Maya, MotionBuilder [cm, °]."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from handtrack.arrays import D3, D4, B, F, Floats
from handtrack.export.motion.trc import marker_name
from handtrack.export.table import ResultsTable
from handtrack.files.atomic import replace_text
from handtrack.geometry.rotation import euler_angles
from handtrack.model.articulated import ArticulatedModel

_CM = 100.0
_CHANNELS = "Zrotation Xrotation Yrotation"


def write(path: Path, table: ResultsTable) -> None:
    """Write every bone as a joint at its proximal end, its own length as the end site of a last bone. Zero rotations are the
    model's zero pose (a flat hand), lengths are in centimetres. Lost frames hold the last estimate.
    """
    _written(path, table, {})


def write_humanik(path: Path, table: ResultsTable) -> None:
    """Write the same with HumanIK's names for a hand's bones, which MotionBuilder, Maya and Mixamo's tools know by themselves."""
    _written(path, table, humanik_names(table.model))


def humanik_names(model: ArticulatedModel) -> dict[str, str]:
    """Return HumanIK's names (`RightHandIndex1`, `RightInHandIndex`) of our bones; others keep ours.

    Between wrist and knuckle it knows one bone, ours there are two of which the first moves (metacarpal) or is all there is.
    """
    side = model.side.capitalize()
    parts = {"proximal": "1", "intermediate": "2", "distal": "3"}
    names = {"root": f"{side}Hand", "forearm": f"{side}ForeArm"}
    for finger in ("index", "middle", "ring", "little"):
        word = "Pinky" if finger == "little" else finger.capitalize()
        names[f"{finger}_metacarpal"] = f"{side}InHand{word}"
        names |= {f"{finger}_{part}": f"{side}Hand{word}{number}" for part, number in parts.items()}
    thumb = {"metacarpal": "1", "proximal": "2", "distal": "3"}
    names |= {f"thumb_{part}": f"{side}HandThumb{number}" for part, number in thumb.items()}
    return {bone: names[bone] for bone in model.skeleton.bone_names if bone in names}


def _written(path: Path, table: ResultsTable, names: Mapping[str, str]) -> None:
    table = table.without_gaps
    model = table.model
    order = list(_depth_first(model))
    turns = np.rad2deg(bvh_angles(model, table.track.T_world_bone))
    root = _CM * table.track.T_world_bone[:, 0, :3, 3]
    rows = np.concatenate([root[:, None], turns[:, order]], axis=1).reshape(len(root), -1)
    lines = ["HIERARCHY", *_joint(model, 0, "", names), "MOTION", f"Frames: {len(rows)}"]
    lines.append(f"Frame Time: {1.0 / table.fps:.9f}")
    lines += [" ".join(f"{x:.6f}" for x in row) for row in rows]
    replace_text(path, "\n".join(lines) + "\n")


def bvh_angles(model: ArticulatedModel, T_world_bone: Floats[F, B, D4, D4]) -> Floats[F, B, D3]:
    """Return the angles [rad] of R = Rz Rx Ry by which each bone is turned against its parent, from the zero pose; without jumps
    of a whole turn.
    """
    rest = model.bones(model.params_from({})).rotation
    turned = T_world_bone[..., :3, :3] @ np.swapaxes(rest, 1, 2)
    local, parent = turned.copy(), model.skeleton.parent
    below = np.flatnonzero(parent >= 0)
    local[:, below] = np.swapaxes(turned[:, parent[below]], 2, 3) @ turned[:, below]
    return np.unwrap(euler_angles(local, "ZXY"), axis=0)


def _joint(model: ArticulatedModel, bone: int, tab: str, names: Mapping[str, str]) -> Iterator[str]:
    skeleton, rest = model.skeleton, model.bones(model.params_from({}))
    heads, name = rest.position, skeleton.bone_names[bone]
    parent = skeleton.parent[bone]
    children = np.flatnonzero(skeleton.parent == bone)
    offset = heads[bone] - heads[parent] if parent >= 0 else np.zeros(3)
    yield f"{tab}{'JOINT' if parent >= 0 else 'ROOT'} {marker_name(names.get(name, name))}"
    yield f"{tab}{{"
    yield f"{tab}\tOFFSET {_numbers(offset)}"
    places = "" if parent >= 0 else "Xposition Yposition Zposition "
    yield f"{tab}\tCHANNELS {3 if parent >= 0 else 6} {places}{_CHANNELS}"
    for child in children:
        yield from _joint(model, int(child), f"{tab}\t", names)
    if not len(children):
        along = rest.rotation[bone][:, 1] * skeleton.length[bone]
        yield f"{tab}\tEnd Site"
        yield f"{tab}\t{{"
        yield f"{tab}\t\tOFFSET {_numbers(along)}"
        yield f"{tab}\t}}"
    yield f"{tab}}}"


def _depth_first(model: ArticulatedModel, bone: int = 0) -> Iterator[int]:
    """Yield bones in the order in which the hierarchy lists them, and so the rows their angles."""
    yield bone
    for child in np.flatnonzero(model.skeleton.parent == bone):
        yield from _depth_first(model, int(child))


def _numbers(point: Floats[D3]) -> str:
    return " ".join(f"{_CM * x:.6f}" for x in point)
