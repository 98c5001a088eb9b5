"""The model for other programs, in XML: as a robot (URDF), a link for each freedom, and for OpenSim 4 (OSIM); and how it moves (CSV, MOT)."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from handtrack.arrays import D3, Axes, B, Floats, K, N
from handtrack.export.motion.motion_files import marker_name
from handtrack.export.table import ResultsTable
from handtrack.export.tables.tables_and_arrays import beside, number, write_rows
from handtrack.files.atomic import replace_text
from handtrack.geometry.rotation import euler_angles, quaternion_wxyz
from handtrack.model.articulated import ArticulatedModel
from handtrack.tracking.frame.result import is_length

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
