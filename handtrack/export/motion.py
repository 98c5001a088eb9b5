"""Motion and models for other programs. TRC and C3D, joints as markers [mm]; BVH, a skeleton; URDF, a robot with a link for each freedom, and
how it moves (CSV, MCAP); OpenSim 4, the model (OSIM) and how it moves (MOT).
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from handtrack.arrays import D3, D4, Axes, B, F, Floats, K, N
from handtrack.export.table import ResultsTable
from handtrack.export.tables_and_arrays import beside, number, write_rows
from handtrack.files.atomic import replace_text, replacing
from handtrack.geometry.rotation import euler_angles, quaternion_wxyz
from handtrack.model.articulated import ArticulatedModel
from handtrack.tracking.frame.result import is_length

# ---- TRC: joints as markers [mm], for OpenSim and Pose2Sim


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
    about = {
        "UNITS": ["mm"],
        "RATE": [float(table.fps)],
        "LABELS": [marker_name(n) for n in track.joint_names],
        "DESCRIPTIONS": [table.keypoint_definition] * points.shape[1],
    }
    for name, value in about.items():
        file["parameters"]["POINT"][name]["value"] = value
    file.add_parameter("POINT", "X_SCREEN", ["+X"])  # as all that read it take it: z is up
    file.add_parameter("POINT", "Y_SCREEN", ["+Z"])
    file.add_parameter("MANUFACTURER", "SOFTWARE", ["handtrack"])
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


# ---- What bones weigh


_DENSITY = 1080.0  # kg/m³ of a hand or forearm: Clauser et al. 1969 have 1,080 to 1,110 for limbs
LEAST_MASS_KG = 1e-4
"""of what has no flesh of its own: OpenSim and MuJoCo refuse bodies without mass"""
LEAST_INERTIA = 1e-9
"""kg m²"""


def bone_masses(
    model: ArticulatedModel,
) -> tuple[Floats[B], Floats[B, D3], Floats[B, D3, D3]]:
    """Return each bone's mass [kg], and in its own frame the centre [m] and the inertia about that [kg m²].

    Overlaps of ellipsoids count twice: for looking and inverse kinematics, not for forces.
    """
    ellipsoids, count = model.ellipsoids["fine"], model.skeleton.bone_count
    mass, centre = np.full(count, LEAST_MASS_KG), np.zeros((count, 3))
    inertia = np.tile(LEAST_INERTIA * np.eye(3), (count, 1, 1))
    weights = _DENSITY * 4.0 / 3.0 * np.pi * ellipsoids.radii.prod(axis=1)
    for bone in range(count):
        own = np.flatnonzero(ellipsoids.bone == bone)
        if len(own):
            mass[bone] = max(float(weights[own].sum()), LEAST_MASS_KG)
            centre[bone] = weights[own] @ ellipsoids.centre[own] / mass[bone]
            places = ellipsoids.centre[own] - centre[bone]
            inertia[bone] += _inertia(weights[own], places, ellipsoids.radii[own])
    return mass, centre, inertia


def _inertia(masses: Floats[N], centres: Floats[N, D3], radii: Floats[N, D3]) -> Floats[D3, D3]:
    """Return the inertia (3, 3) of balls in the place of ellipsoids about their common centre [kg m²]."""
    balls = 0.4 * (radii**2).mean(axis=1) + (centres**2).sum(axis=1)
    return masses @ balls * np.eye(3) - (masses[:, None] * centres).T @ centres


# ---- XML as text, with numbers in one form: what URDF and OpenSim files are made of


def element(parent: Element, tag: str, text: str = "", **attributes: str) -> Element:
    """Return a new child of an element."""
    child = ElementTree.SubElement(parent, tag, attributes)
    child.text = text or None
    return child


def numbers(values: Floats[*Axes]) -> str:
    """Return numbers as text, nine digits each; zeros without a sign."""
    return " ".join(f"{x + 0.0:.9g}" for x in np.ravel(np.where(np.abs(values) < 1e-15, 0, values)))


def document(root: Element) -> str:
    """Return an indented document."""
    ElementTree.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ElementTree.tostring(root, "unicode") + "\n"


# ---- URDF: the model as a robot; joint states as CSV beside it


_EFFORT, _VELOCITY = "10", "20"  # URDF wants them: N m, rad/s; more than a hand has


def write_urdf(path: Path, table: ResultsTable) -> list[Path]:
    """Write the robot to `path`, its states to NAME_joint_states.csv: a row a frame, where the base link is in the world [m, wxyz],
    then each joint [rad].
    """
    replace_text(path, urdf_text(table.model))
    track = table.track
    header = ["frame", "time_s", "status", "root_x_m", "root_y_m", "root_z_m"]
    header += ["root_qw", "root_qx", "root_qy", "root_qz", *track.parameter_names[6:]]
    turns = quaternion_wxyz(track.T_world_bone[:, 0, :3, :3])
    rows = (
        [
            int(track.frame[i]),
            number(track.time_s[i]),
            int(track.status[i]),
            *map(number, track.T_world_bone[i, 0, :3, 3]),
            *map(number, turns[i]),
            *map(number, track.parameters[i, 6:]),
        ]
        for i in range(len(track))
    )
    states = beside(path.with_name(f"{path.stem}_joint_states.csv"))
    return [write_rows(states, header, rows)]


def urdf_text(model: ArticulatedModel) -> str:
    """Return a model as URDF. Joints have our parameters' names, the links of bones theirs; each named joint or fingertip is a
    link of its own, on its bone. The base link is the root bone, which is free in the world. Ellipsoids are cylinders to look at,
    and say what a link weighs: simulators refuse links that move and weigh nothing.
    """
    skeleton, names = model.skeleton, model.skeleton.bone_names
    robot = Element("robot", name=f"{model.name}_{model.side}")
    # of a URDF's links MuJoCo else keeps those that collide and move: nothing would be seen, and no fingertip have a name
    keep = {"discardvisual": "false", "fusestatic": "false"}
    element(element(robot, "mujoco"), "compiler", **keep)
    weighed = zip(*bone_masses(model), strict=True)
    for (bone, parent), own in zip(enumerate(skeleton.parent), weighed, strict=True):
        if parent >= 0:
            _urdf_joints(robot, model, bone, names[parent])
        link = _link(robot, model, bone)
        _weigh(link, float(own[0]), *own[1:])
    taken = set(names)
    for joint, bone, point in zip(model.joint_names, model.joint_bone, model.joint_point):
        place = joint if joint not in taken else f"{joint}_point"
        element(robot, "link", name=place)
        _urdf_joint(robot, f"{place}_fixed", "fixed", names[bone], place, point, np.eye(3))
    return document(robot)


def _urdf_joints(robot: Element, model: ArticulatedModel, bone: int, above: str) -> None:
    """Add the joints from the parent bone's link to this one's: a link between two freedoms."""
    skeleton, name = model.skeleton, model.skeleton.bone_names[bone]
    place, turn = skeleton.offset[bone], skeleton.rest_rotation[bone]
    hinges = np.flatnonzero(skeleton.hinge_bone == bone)
    if not len(hinges):
        _urdf_joint(robot, f"{name}_fixed", "fixed", above, name, place, turn)
    for hinge in hinges:
        last = hinge == hinges[-1]
        below = name if last else f"{name}_after_{model.parameter_names[6 + hinge]}"
        own = _urdf_joint(
            robot, model.parameter_names[6 + hinge], "revolute", above, below, place, turn
        )
        element(own, "axis", xyz=numbers(skeleton.hinge_axis[hinge]))
        low, high = model.limits.interval[6 + hinge]
        element(
            own,
            "limit",
            lower=f"{low:.9g}",
            upper=f"{high:.9g}",
            effort=_EFFORT,
            velocity=_VELOCITY,
        )
        if not last:
            between = element(robot, "link", name=below)
            _weigh(between, LEAST_MASS_KG, np.zeros(3), LEAST_INERTIA * np.eye(3))
        above, place, turn = below, np.zeros(3), np.eye(3)


def _urdf_joint(
    robot: Element,
    name: str,
    kind: str,
    above: str,
    below: str,
    place: Floats[D3],
    turn: Floats[D3, D3],
) -> Element:
    joint = element(robot, "joint", name=name, type=kind)
    element(joint, "parent", link=above)
    element(joint, "child", link=below)
    _origin(joint, place, turn)
    return joint


def _origin(parent: Element, place: Floats[D3], turn: Floats[D3, D3] = np.eye(3)) -> None:
    element(parent, "origin", xyz=numbers(place), rpy=numbers(euler_angles(turn, "xyz")))


def _link(robot: Element, model: ArticulatedModel, bone: int) -> Element:
    link = element(robot, "link", name=model.skeleton.bone_names[bone])
    ellipsoids = model.ellipsoids["fine"]
    for k in np.flatnonzero(ellipsoids.bone == bone):
        shape = element(link, "visual")
        long = int(np.argmax(ellipsoids.radii[k]))
        axes = np.roll(
            ellipsoids.rotation[k], 2 - long, axis=1
        )  # the longest axis as z, still right-handed
        across = np.sqrt(ellipsoids.radii[k].prod() / ellipsoids.radii[k, long])
        _origin(shape, ellipsoids.centre[k], axes)
        # as long and thick as to have the ellipsoid's volume: 4/3 π abc = π r² · 4/3 a
        length = 4.0 / 3.0 * ellipsoids.radii[k, long]
        element(
            element(shape, "geometry"), "cylinder", radius=f"{across:.6g}", length=f"{length:.6g}"
        )
    return link


def _weigh(link: Element, mass: float, centre: Floats[D3], inertia: Floats[D3, D3]) -> None:
    """Say what a link weighs [kg], where [m], and its inertia about that point [kg m²]."""
    table = element(link, "inertial")
    _origin(table, centre)
    element(table, "mass", value=f"{mass:.6g}")
    rows, columns = np.triu_indices(3)
    named = {f"i{'xyz'[i]}{'xyz'[j]}": f"{inertia[i, j]:.6g}" for i, j in zip(rows, columns)}
    element(table, "inertia", **named)


# ---- OSIM: bodies, joints with limits, markers, and ellipsoids to look at


ROOT_TURNS = ("root_turn_x", "root_turn_y", "root_turn_z")
"""coordinates in place of the root's rotation vector"""


def write_osim(path: Path, table: ResultsTable) -> list[Path]:
    """Write the model as large as it was tracked, and a set-up of OpenSim's inverse kinematics for it beside, NAME_ik.xml.

    `--to mot` writes how the model moves, `--to trc` the markers that the set-up reads from NAME.trc.
    """
    replace_text(path, osim_text(table.model))
    setup = beside(path.with_name(f"{path.stem}_ik.xml"))
    replace_text(setup, ik_text(table, path))
    return [setup]


def ik_text(table: ResultsTable, model: Path) -> str:
    """Return the set-up of an InverseKinematicsTool: each marker weighs by its mean variance, the surest of all 1."""
    track = table.track
    tracked = ~table.is_lost
    variance = (
        (table.joint_std[tracked] ** 2).mean(axis=(0, 2))
        if tracked.any()
        else np.ones(len(track.joint_names))
    )
    weight = variance.min() / np.maximum(variance, 1e-12)
    root = Element("OpenSimDocument", Version="40000")
    tool = element(root, "InverseKinematicsTool", name=f"{model.stem}_ik")
    element(tool, "model_file", model.name)
    tasks = element(element(tool, "IKTaskSet", name="tasks"), "objects")
    for name, value in zip(track.joint_names, np.maximum(weight, 1e-6), strict=True):
        task = element(tasks, "IKMarkerTask", name=marker_name(name))
        element(task, "apply", "true")
        element(task, "weight", f"{value:.6g}")
    element(tool, "marker_file", f"{model.stem}.trc")
    element(tool, "time_range", numbers(track.time_s[[0, -1]]))
    element(tool, "output_motion_file", f"{model.stem}_ik.mot")
    return document(root)


def osim_text(model: ArticulatedModel) -> str:
    """Return a model as an OpenSim document. Coordinates have our parameters' names, [m, rad], markers our joints'.

    Masses are those of the ellipsoids (overlaps count twice): for looking and inverse kinematics, not for forces.
    """
    root = Element("OpenSimDocument", Version="40000")
    top = element(root, "Model", name=f"{model.name}_{model.side}")
    element(top, "Ground", name="ground")
    element(top, "gravity", "0 -9.80665 0")
    element(top, "length_units", "meters")
    element(top, "force_units", "N")
    bodies = element(element(top, "BodySet", name="bodyset"), "objects")
    joints = element(element(top, "JointSet", name="jointset"), "objects")
    for bone, (mass, centre, inertia) in enumerate(zip(*bone_masses(model), strict=True)):
        body = _body(bodies, model, bone)
        element(body, "mass", f"{mass:.6g}")
        element(body, "mass_center", numbers(centre))
        element(body, "inertia", numbers(np.concatenate([np.diag(inertia), np.zeros(3)])))
        _osim_joint(joints, model, bone)
    markers = element(element(top, "MarkerSet", name="markerset"), "objects")
    for name, bone, point in zip(model.joint_names, model.joint_bone, model.joint_point):
        marker = element(markers, "Marker", name=marker_name(name))
        element(marker, "socket_parent_frame", f"/bodyset/{model.skeleton.bone_names[bone]}")
        element(marker, "location", numbers(point))
    return document(root)


def _body(bodies: Element, model: ArticulatedModel, bone: int) -> Element:
    name, ellipsoids = model.skeleton.bone_names[bone], model.ellipsoids["fine"]
    body = element(bodies, "Body", name=name)
    own = np.flatnonzero(ellipsoids.bone == bone)
    parts = element(body, "components")
    for k in own:
        frame = element(parts, "PhysicalOffsetFrame", name=f"{name}_flesh_{k}")
        shape = element(element(frame, "attached_geometry"), "Ellipsoid", name=f"{name}_shape_{k}")
        element(shape, "socket_frame", "..")
        element(element(shape, "Appearance"), "color", "0.85 0.7 0.6")
        element(shape, "radii", numbers(ellipsoids.radii[k]))
        _placed(frame, "..", ellipsoids.centre[k], ellipsoids.rotation[k])
    return body


def _placed(frame: Element, above: str, place: Floats[D3], turn: Floats[D3, D3]) -> None:
    element(frame, "socket_parent", above)
    element(frame, "translation", numbers(place))
    element(frame, "orientation", numbers(euler_angles(turn, "XYZ")))


def _osim_joint(joints: Element, model: ArticulatedModel, bone: int) -> None:
    skeleton = model.skeleton
    names, parent = skeleton.bone_names, int(skeleton.parent[bone])
    hinges = np.flatnonzero(skeleton.hinge_bone == bone)
    moves = bone == 0 or len(hinges) > 0
    above = "ground" if parent < 0 else names[parent]
    joint = element(joints, "CustomJoint" if moves else "WeldJoint", name=f"{names[bone]}_joint")
    element(joint, "socket_parent_frame", f"{above}_before_{names[bone]}")
    element(joint, "socket_child_frame", f"/bodyset/{names[bone]}")
    coordinates = element(joint, "coordinates") if moves else joint
    frames = element(joint, "frames")
    frame = element(frames, "PhysicalOffsetFrame", name=f"{above}_before_{names[bone]}")
    base = "/ground" if parent < 0 else f"/bodyset/{above}"
    _placed(frame, base, skeleton.offset[bone], skeleton.rest_rotation[bone])
    if not moves:
        return
    if bone == 0:
        turning, moving = [*ROOT_TURNS], [*model.parameter_names[:3]]
        axes, limits = np.eye(3), np.repeat([[-2 * np.pi, 2 * np.pi], [-10.0, 10.0]], 3, axis=0)
    else:
        turning, moving = [model.parameter_names[6 + h] for h in hinges], []
        axes, limits = skeleton.hinge_axis[hinges], model.limits.interval[6 + hinges]
    for name, interval in zip(turning + moving, limits, strict=True):
        coordinate = element(coordinates, "Coordinate", name=name)
        element(coordinate, "default_value", "0")
        element(coordinate, "range", numbers(interval))
        element(coordinate, "clamped", "false")
    transform = element(joint, "SpatialTransform")
    for kind, names, along in (
        ("rotation", turning, _three_axes(axes)),
        ("translation", moving, np.eye(3)),
    ):
        for k, name in enumerate([*names, "", "", ""][:3]):
            _axis(transform, f"{kind}{k + 1}", name, along[k])


def _axis(transform: Element, name: str, coordinate: str, axis: Floats[D3]) -> None:
    own = element(transform, "TransformAxis", name=name)
    element(own, "coordinates", coordinate)
    element(own, "axis", numbers(axis))
    if coordinate:
        element(element(own, "LinearFunction", name="function"), "coefficients", "1 0")
    else:
        element(element(own, "Constant", name="function"), "value", "0")


def _three_axes(axes: Floats[K, D3]) -> Floats[D3, D3]:
    """Return three independent unit axes that begin with those given: OpenSim wants three, also of a hinge."""
    found = list(axes)
    while len(found) < 3:
        basis = np.linalg.svd(np.array(found))[2]  # its last rows are square to all that there are
        found.append(basis[len(found)])
    return np.array(found)


# ---- MOT: the coordinates of the OpenSim model that `write_osim` writes, frame by frame [m, °]


def write_mot(path: Path, table: ResultsTable) -> None:
    """Write all joint parameters by their names; the root's turn as three angles about x, y, z, each carried along by those
    before it, in place of the rotation vector. Lost frames hold the last estimate.
    """
    table = table.without_gaps
    track = table.track
    values = track.parameters.copy()
    turns = euler_angles(track.T_world_bone[:, 0, :3, :3], "XYZ")
    values[:, 3:6] = np.unwrap(turns, axis=0)  # without jumps of a whole turn
    names = [*track.parameter_names[:3], *ROOT_TURNS, *track.parameter_names[6:]]
    shown = np.where([is_length(name) for name in names], values, np.rad2deg(values))
    lines = [
        "Coordinates",
        "version=1",
        f"nRows={len(track)}",
        f"nColumns={len(names) + 1}",
        "inDegrees=yes",
        "",
        f"Joint angles of '{table.model.name}' by handtrack; lengths in metres, angles in degrees.",
        "endheader",
        "\t".join(["time", *names]),
    ]
    lines += [
        "\t".join([f"{time_s:.9g}", *(f"{x:.8f}" for x in row)])
        for time_s, row in zip(track.time_s, shown, strict=True)
    ]
    replace_text(path, "\n".join(lines) + "\n")


# ---- MCAP: joint states, the robot's description and where its root is, as ROS 2 messages


def _schema(fields: str, *messages: str) -> str:
    """Return a message's fields, and the messages that they hold, as ROS 2 writes them."""
    return f"{'=' * 80}\nMSG: ".join((fields, *messages))


_HEADER = (
    "std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n",
    "builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n",
)
_XYZ = "float64 x\nfloat64 y\nfloat64 z\n"
_QUATERNION = f"geometry_msgs/Quaternion\n{_XYZ}float64 w\n"
_STATE = _schema(
    "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n",
    *_HEADER,
)
_POSE = _schema(
    "std_msgs/Header header\ngeometry_msgs/Pose pose\n",
    *_HEADER,
    "geometry_msgs/Pose\ngeometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n",
    f"geometry_msgs/Point\n{_XYZ}",
    _QUATERNION,
)
_TEXT = "string data\n"
_TRANSFORMS = _schema(
    "geometry_msgs/TransformStamped[] transforms\n",
    "geometry_msgs/TransformStamped\nstd_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform\n",
    *_HEADER,
    "geometry_msgs/Transform\ngeometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation\n",
    f"geometry_msgs/Vector3\n{_XYZ}",
    _QUATERNION,
)
_LATCHED = (
    "- history: 1\n  depth: 1\n  reliability: 1\n  durability: 1\n  deadline: {sec: 2147483647, nsec: 4294967295}\n"
    "  lifespan: {sec: 2147483647, nsec: 4294967295}\n  liveliness: 1\n"
    "  liveliness_lease_duration: {sec: 2147483647, nsec: 4294967295}\n  avoid_ros_namespace_conventions: false\n"
)
"""rosbag2's word for a topic whose last message late listeners get, too (transient local)"""
_NS = 1_000_000_000


def write_mcap(path: Path, table: ResultsTable) -> None:
    """Write `/joint_states` (sensor_msgs/JointState, the joints of `--to urdf`) and `/root_pose` (geometry_msgs/PoseStamped, of its
    base link in the frame `world`) for every frame, at its time since the recording's start, and the latter as `/tf`, too, by which
    viewers place the robot that `/robot_description` holds (the URDF's text, once). Lost frames have no messages.
    """
    from mcap.writer import Writer  # pyright: ignore[reportMissingImports]

    track = table.track
    names = track.parameter_names[6:]
    turns = quaternion_wxyz(track.T_world_bone[:, 0, :3, :3])
    with replacing(path) as part, part.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2", library="handtrack")
        description, state, pose, tf = (
            writer.register_channel(
                topic,
                "cdr",
                writer.register_schema(name, "ros2msg", text.encode()),
                {"offered_qos_profiles": _LATCHED} if topic == "/robot_description" else {},
            )
            for topic, name, text in (
                ("/robot_description", "std_msgs/msg/String", _TEXT),
                ("/joint_states", "sensor_msgs/msg/JointState", _STATE),
                ("/root_pose", "geometry_msgs/msg/PoseStamped", _POSE),
                ("/tf", "tf2_msgs/msg/TFMessage", _TRANSFORMS),
            )
        )
        begun = round(track.time_s[0] * _NS)
        writer.add_message(description, begun, _cdr(urdf_text(table.model)), begun)
        base = table.model.skeleton.bone_names[0]
        for i in np.flatnonzero(~table.is_lost):
            stamp = round(track.time_s[i] * _NS)
            header = _header(stamp, "world")
            placed = ("d", *track.T_world_bone[i, 0, :3, 3], *np.roll(turns[i], -1))
            for channel, message in (
                (state, _joint_state(stamp, names, track.parameters[i, 6:])),
                (pose, _cdr(*header, placed)),
                (tf, _cdr(("I", 1), *header, base, placed)),
            ):
                writer.add_message(channel, stamp, message, stamp, sequence=int(track.frame[i]))
        writer.finish()


def _cdr(*parts: str | tuple[Any, ...]) -> bytes:
    """Return texts, and numbers after their kind, as CDR, little-endian (OMG DDS-XTypes, plain CDR): each number stands at a multiple
    of its own size.
    """
    body = bytearray()
    for part in parts:
        data = part.encode() + b"\0" if isinstance(part, str) else b""
        kind, *values = ("I", len(data)) if isinstance(part, str) else part
        body += bytes(-len(body) % struct.calcsize(kind))
        body += struct.pack(f"<{len(values)}{kind}", *values) + data
    return b"\0\1\0\0" + bytes(body)


def _header(stamp: int, frame: str) -> tuple[Any, ...]:
    return ("i", stamp // _NS), ("I", stamp % _NS), frame


def _joint_state(stamp: int, names: tuple[str, ...], position: Floats[N]) -> bytes:
    turns = [("d", *position)] if len(position) else []
    counts = ("I", len(names)), ("I", len(position)), ("I", 0)
    return _cdr(*_header(stamp, ""), counts[0], *names, counts[1], *turns, counts[2], counts[2])
