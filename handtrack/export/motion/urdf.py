"""URDF: the model as a robot, a link for each freedom; joint states as CSV beside it."""

from __future__ import annotations

from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from handtrack.arrays import D3, Floats
from handtrack.export.motion.bodies import (
    LEAST_INERTIA,
    LEAST_MASS_KG,
    bone_masses,
    document,
    element,
    numbers,
)
from handtrack.export.table import ResultsTable
from handtrack.export.tables.cells import beside, number, write_rows
from handtrack.files.atomic import replace_text
from handtrack.geometry.rotation import euler_angles, quaternion_wxyz
from handtrack.model.articulated import ArticulatedModel

_EFFORT, _VELOCITY = "10", "20"  # URDF wants them: N m, rad/s; more than a hand has


def write(path: Path, table: ResultsTable) -> list[Path]:
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
            _joints(robot, model, bone, names[parent])
        link = _link(robot, model, bone)
        _weigh(link, float(own[0]), *own[1:])
    taken = set(names)
    for joint, bone, point in zip(model.joint_names, model.joint_bone, model.joint_point):
        place = joint if joint not in taken else f"{joint}_point"
        element(robot, "link", name=place)
        _joint(robot, f"{place}_fixed", "fixed", names[bone], place, point, np.eye(3))
    return document(robot)


def _joints(robot: Element, model: ArticulatedModel, bone: int, above: str) -> None:
    """Add the joints from the parent bone's link to this one's: a link between two freedoms."""
    skeleton, name = model.skeleton, model.skeleton.bone_names[bone]
    place, turn = skeleton.offset[bone], skeleton.rest_rotation[bone]
    hinges = np.flatnonzero(skeleton.hinge_bone == bone)
    if not len(hinges):
        _joint(robot, f"{name}_fixed", "fixed", above, name, place, turn)
    for hinge in hinges:
        last = hinge == hinges[-1]
        below = name if last else f"{name}_after_{model.parameter_names[6 + hinge]}"
        own = _joint(robot, model.parameter_names[6 + hinge], "revolute", above, below, place, turn)
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


def _joint(
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
    element(joint, "origin", xyz=numbers(place), rpy=numbers(euler_angles(turn, "xyz")))
    return joint


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
        element(
            shape,
            "origin",
            xyz=numbers(ellipsoids.centre[k]),
            rpy=numbers(euler_angles(axes, "xyz")),
        )
        # as long and thick as to have the ellipsoid's volume: 4/3 π abc = π r² · 4/3 a
        length = 4.0 / 3.0 * ellipsoids.radii[k, long]
        element(
            element(shape, "geometry"), "cylinder", radius=f"{across:.6g}", length=f"{length:.6g}"
        )
    return link


def _weigh(link: Element, mass: float, centre: Floats[D3], inertia: Floats[D3, D3]) -> None:
    """Say what a link weighs [kg], where [m], and its inertia about that point [kg m²]."""
    table = element(link, "inertial")
    element(table, "origin", xyz=numbers(centre), rpy="0 0 0")
    element(table, "mass", value=f"{mass:.6g}")
    rows, columns = np.triu_indices(3)
    named = {f"i{'xyz'[i]}{'xyz'[j]}": f"{inertia[i, j]:.6g}" for i, j in zip(rows, columns)}
    element(table, "inertia", **named)
