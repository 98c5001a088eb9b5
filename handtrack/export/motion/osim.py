"""OSIM: the model itself for OpenSim 4: bodies, joints with limits, markers, and ellipsoids to look at; MOT: how it moves."""

from __future__ import annotations

from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from handtrack.arrays import D3, Floats, K
from handtrack.export.motion.bodies import bone_masses, document, element, numbers
from handtrack.export.motion.trc import marker_name
from handtrack.export.table import ResultsTable
from handtrack.export.tables.cells import beside
from handtrack.files.atomic import replace_text
from handtrack.geometry.rotation import euler_angles
from handtrack.model.articulated import ArticulatedModel
from handtrack.tracking.frame.result import is_length

ROOT_TURNS = ("root_turn_x", "root_turn_y", "root_turn_z")
"""coordinates in place of the root's rotation vector"""


def write(path: Path, table: ResultsTable) -> list[Path]:
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
        _joint(joints, model, bone)
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
        element(frame, "socket_parent", "..")
        element(frame, "translation", numbers(ellipsoids.centre[k]))
        element(frame, "orientation", numbers(euler_angles(ellipsoids.rotation[k], "XYZ")))
    return body


def _joint(joints: Element, model: ArticulatedModel, bone: int) -> None:
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
    element(frame, "socket_parent", "/ground" if parent < 0 else f"/bodyset/{above}")
    element(frame, "translation", numbers(skeleton.offset[bone]))
    element(frame, "orientation", numbers(euler_angles(skeleton.rest_rotation[bone], "XYZ")))
    if not moves:
        return
    if bone == 0:
        turning, moving = list(ROOT_TURNS), list(model.parameter_names[:3])
        axes = np.eye(3)
        limits = np.concatenate(
            [np.tile((-2 * np.pi, 2 * np.pi), (3, 1)), np.tile((-10.0, 10.0), (3, 1))]
        )
    else:
        turning, moving = [model.parameter_names[6 + h] for h in hinges], []
        axes, limits = skeleton.hinge_axis[hinges], model.limits.interval[6 + hinges]
    for name, (low, high) in zip(turning + moving, limits, strict=True):
        coordinate = element(coordinates, "Coordinate", name=name)
        element(coordinate, "default_value", "0")
        element(coordinate, "range", numbers(np.array([low, high])))
        element(coordinate, "clamped", "false")
    transform = element(joint, "SpatialTransform")
    turning, axes = turning + [""] * (3 - len(turning)), _three_axes(axes)
    for k in range(3):
        _axis(transform, f"rotation{k + 1}", turning[k], axes[k])
    for k in range(3):
        _axis(transform, f"translation{k + 1}", moving[k] if moving else "", np.eye(3)[k])


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


# ---- MOT: the coordinates of the OpenSim model that osim.py writes, frame by frame [m, °]


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
