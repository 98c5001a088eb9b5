"""Motion as other programs read it: TRC and C3D, joints as markers [mm], for OpenSim, Pose2Sim and motion capture; BVH, a skeleton."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from handtrack.arrays import D3, D4, B, F, Floats
from handtrack.export.table import ResultsTable
from handtrack.files.atomic import replace_text, replacing
from handtrack.geometry.rotation import euler_angles
from handtrack.model.articulated import ArticulatedModel

_MM = 1e3


def write_trc(path: Path, table: ResultsTable) -> None:
    """Write every named joint as a marker. Rows are at the recording's rate, frame numbers count from 1 as the format wants;
    points of lost frames are empty, which readers take for missing.
    """
    table = table.without_gaps
    track, rate = table.track, f"{table.fps:.9g}"
    names, count = track.joint_names, len(track)
    lines = [
        f"PathFileType\t4\t(X/Y/Z)\t{path.name}",
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames",
        f"{rate}\t{rate}\t{count}\t{len(names)}\tmm\t{rate}\t{track.frame[0] + 1}\t{count}",
        "Frame#\tTime\t" + "\t\t\t".join(marker_name(name) for name in names) + "\t\t",
        "\t\t" + "\t".join(f"X{k}\tY{k}\tZ{k}" for k in range(1, len(names) + 1)),
        "",
    ]
    for row, lost in enumerate(table.is_lost):
        places = _MM * track.joint_positions[row].ravel()
        cells = [""] * (len(places) + 1) if lost else [f"{x:.5f}" for x in places]
        lines.append("\t".join([str(row + 1), f"{track.time_s[row]:.9g}", *cells]))
    replace_text(path, "\n".join(lines) + "\n")


def marker_name(joint: str) -> str:
    """Return a joint's name without what ends a cell."""
    return "_".join(joint.split()) or "_"


# ---- C3D: joints as markers [mm], for motion capture programs. Written by ezc3d


def write_c3d(path: Path, table: ResultsTable) -> None:
    """Write every named joint as a point. Its residual is the root of the mean variance [mm], −1 in lost frames: C3D's word for a
    point that was not seen.
    """
    import ezc3d  # pyright: ignore[reportMissingImports]

    table = table.without_gaps
    track = table.track
    points = np.ones((4, len(track.joint_names), len(track)))
    points[:3] = _MM * track.joint_positions.transpose(2, 1, 0)
    residuals = _MM * np.sqrt((table.joint_std**2).mean(axis=2)).T[None]
    points[:3, :, table.is_lost] = np.nan  # ezc3d writes those as not seen
    residuals[:, :, table.is_lost] = -1.0
    file = ezc3d.c3d()
    file["parameters"]["POINT"]["UNITS"]["value"] = ["mm"]
    file["parameters"]["POINT"]["RATE"]["value"] = [float(table.fps)]
    file["parameters"]["POINT"]["LABELS"]["value"] = [marker_name(n) for n in track.joint_names]
    file.add_parameter("POINT", "X_SCREEN", ["+X"])  # as all that read it take it: z is up
    file.add_parameter("POINT", "Y_SCREEN", ["+Z"])
    file.add_parameter("MANUFACTURER", "SOFTWARE", ["handtrack"])
    file["parameters"]["POINT"]["DESCRIPTIONS"]["value"] = [
        table.keypoint_definition
    ] * points.shape[1]
    file["header"]["points"]["first_frame"] = int(track.frame[0])  # ezc3d counts from 0, as we do
    file["header"]["points"]["last_frame"] = int(track.frame[-1])
    file["data"]["points"] = points
    file["data"]["meta_points"]["residuals"] = residuals
    with replacing(path) as part:
        file.write(str(part))


# ---- BVH: an animated skeleton, for Blender, Maya, MotionBuilder [cm, °]


_CM = 100.0
_CHANNELS = "Zrotation Xrotation Yrotation"


def write_bvh(path: Path, table: ResultsTable) -> None:
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
    yield f"{tab}\tOFFSET {_offset(offset)}"
    places = "" if parent >= 0 else "Xposition Yposition Zposition "
    yield f"{tab}\tCHANNELS {3 if parent >= 0 else 6} {places}{_CHANNELS}"
    for child in children:
        yield from _joint(model, int(child), f"{tab}\t", names)
    if not len(children):
        along = rest.rotation[bone][:, 1] * skeleton.length[bone]
        yield f"{tab}\tEnd Site"
        yield f"{tab}\t{{"
        yield f"{tab}\t\tOFFSET {_offset(along)}"
        yield f"{tab}\t}}"
    yield f"{tab}}}"


def _depth_first(model: ArticulatedModel, bone: int = 0) -> Iterator[int]:
    """Yield bones in the order in which the hierarchy lists them, and so the rows their angles."""
    yield bone
    for child in np.flatnonzero(model.skeleton.parent == bone):
        yield from _depth_first(model, int(child))


def _offset(point: Floats[D3]) -> str:
    return " ".join(f"{_CM * x:.6f}" for x in point)
