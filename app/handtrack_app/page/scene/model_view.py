"""The model: ellipsoids as one batched mesh, bones, joints, the merged surface; and the truth."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import viser

from handtrack.arrays import D2, D3, D4, B, Bytes, Floats, Ints, N, T, V
from handtrack.geometry.rotation import quaternion_wxyz
from handtrack_app.page.page import Display, put
from handtrack_app.protocol.palette import GHOSTS, TRUTH, colour_of, colours_of, linear
from handtrack_app.protocol.snapshots import (
    HAND_REACH_M,
    GuessesSnapshot,
    PoseSnapshot,
    SessionSnapshot,
)

_BONE_RADIUS = 0.0028  # [m]
_JOINT_RADIUS = 0.0045
_THICKER = 0.75  # power of the model's size with which bones grow thicker
_OVER_IMAGE, _AROUND_BONES, _AMONG_POINTS = 0.3, 0.45, 0.6  # most opacity of the flesh
_CHAINS = [[0, *range(first, first + 4)] for first in range(1, 21, 4)]
KEYPOINT_LINKS = np.array([pair for chain in _CHAINS for pair in pairwise(chain)])


@dataclass(frozen=True)
class HandView:
    """Handles of one hand in the scene."""

    ellipsoids: viser.BatchedMeshHandle
    bones: viser.BatchedMeshHandle
    joints: viser.BatchedMeshHandle
    truth_lines: viser.LineSegmentsHandle
    truth_points: viser.BatchedMeshHandle
    bone_length: Floats[B]
    parts: tuple[viser.MeshHandle, ...] = ()
    """of a body, drawn instead of ellipsoids"""
    part_bone: tuple[int, ...] = ()

    @property
    def nodes(self) -> tuple[viser.BatchedMeshHandle | viser.MeshHandle, ...]:
        """What is drawn of the hand itself."""
        return self.ellipsoids, self.bones, self.joints, *self.parts


def add_hand(server: viser.ViserServer, session: SessionSnapshot) -> HandView:
    """Add a hand's nodes, hidden until the first pose comes."""
    scene = server.scene
    small = ball(12, 16)
    bones = len(session.bone_names)
    colours = colours_of(session.bone_names, np.arange(bones))
    thick = (session.reach_m / HAND_REACH_M) ** _THICKER
    across = np.full(bones, thick * _BONE_RADIUS)
    scene.add_frame("/hand", show_axes=False)

    def batch(
        node: str, mesh: Solid, scales: Floats, colour: Bytes | tuple[int, int, int], **more: Any
    ) -> viser.BatchedMeshHandle:
        more |= {"batched_colors": colour, "visible": False}
        return add_batch(scene, f"/hand/{node}", mesh, scales, **more)

    ellipsoids = batch(
        "flesh", ball(20, 32), session.radii, colours_of(session.bone_names, session.ellipsoid_bone)
    )
    rods = batch("bones", rod(16), np.stack([across, session.bone_length, across], 1), colours)
    joints = batch(
        "joints", small, np.full(2 * bones, thick * _JOINT_RADIUS), np.tile(colours, (2, 1))
    )
    lines = scene.add_line_segments(
        "/hand/truth", np.zeros((len(KEYPOINT_LINKS), 2, 3), np.float32), TRUTH, thickness=2.5,
        thickness_units="screen", visible=False,
    )  # fmt: skip
    points = batch("truth_points", small, np.full(21, 0.0028), TRUTH, cast_shadow=False)
    parts = tuple(
        scene.add_mesh_simple(
            f"/hand/part{i}", part.vertices.astype(np.float32), part.faces.astype(np.uint32),
            color=colour_of(session.bone_names[part.bone]), visible=False,
        )
        for i, part in enumerate(session.parts)
    )  # fmt: skip
    part_bone = tuple(part.bone for part in session.parts)
    return HandView(ellipsoids, rods, joints, lines, points, session.bone_length, parts, part_bone)


def update_hand(view: HandView, pose: PoseSnapshot, display: Display) -> None:
    """Move what is shown of the hand to a pose. Only poses are sent, never meshes; what is hidden follows when it is shown."""
    ellipsoids = display.ellipsoids or display.surface  # which it stands for while that is made
    if ellipsoids and not view.parts:
        view.ellipsoids.batched_positions = pose.centre.astype(np.float32)
        view.ellipsoids.batched_wxyzs = quaternion_wxyz(pose.rotation).astype(np.float32)
    turns = quaternion_wxyz(pose.bone_rotation)
    if view.bones.visible:
        ends = pose.bone_position + pose.bone_rotation[:, :, 1] * view.bone_length[:, None]
        both = np.concatenate([pose.bone_position, ends]).astype(np.float32)
        view.bones.batched_positions = pose.bone_position.astype(np.float32)
        view.bones.batched_wxyzs = turns.astype(np.float32)
        view.joints.batched_positions = both
    for part, bone in zip(view.parts, view.part_bone, strict=True):
        if ellipsoids:
            part.position, part.wxyz = pose.bone_position[bone], turns[bone]


def update_truth(view: HandView, pose: PoseSnapshot, display: Display) -> None:
    """Show the true keypoints of the pose's frame, where there are 21 of them."""
    truth = pose.truth
    known = np.zeros(21, bool)
    if truth is not None and len(truth) == 21:
        known[:] = np.isfinite(truth).all(axis=1)
    shown = display.truth and bool(known.any())
    if shown and truth is not None:
        somewhere = truth[known][0]  # where what is not known is drawn, too: nobody sees it there
        whole = known[KEYPOINT_LINKS].all(axis=1).reshape(-1, 1, 1)
        lines = np.where(whole, truth[KEYPOINT_LINKS], somewhere)
        view.truth_lines.points = lines.astype(np.float32)
        points = np.where(known[:, None], truth, somewhere)
        view.truth_points.batched_positions = points.astype(np.float32)
    view.truth_lines.visible = view.truth_points.visible = shown


def show_hand(view: HandView, display: Display, instead: bool) -> None:
    """Apply the display options to the hand. instead: the surface stands where the ellipsoids would."""
    shown = display.ellipsoids or (display.surface and not instead)
    view.ellipsoids.visible = shown and not view.parts
    for part in view.parts:
        put(part, visible=shown)
    view.bones.visible = view.joints.visible = display.skeleton


def ellipsoid_opacity(display: Display, inside: bool, over_image: bool) -> float | None:
    """Return how opaque flesh is: over a camera's image, and around what is inside it, it lets it be seen."""
    most = _OVER_IMAGE if over_image else 1.0
    if display.skeleton:
        most = min(most, _AROUND_BONES)
    if inside:
        most = min(most, _AMONG_POINTS)
    opacity = min(display.opacity, most)
    return None if opacity > 0.99 else opacity


def remove_hand(view: HandView) -> None:
    """Take the hand out of the scene."""
    for node in (*view.nodes, view.truth_lines, view.truth_points):
        node.remove()


# ---- Small closed meshes that the scene is made of: solids turned around +y


Solid = tuple[Floats[V, D3], Ints[T, D3]]
"""vertices and faces of a closed mesh, counter-clockwise as seen from outside"""


def turned(profile: Floats[N, D2], sides: int) -> Solid:
    """Return the solid whose outline is (distance from the axis, y), from below to above; its ends are on the axis."""
    around = 2 * np.pi * np.arange(sides) / sides
    circle = np.stack([np.cos(around), np.ones(sides), -np.sin(around)], axis=1)
    here, there = np.arange(sides), np.roll(np.arange(sides), -1)
    low = np.stack([here, there, there + sides], axis=1)
    high = np.stack([here, there + sides, here + sides], axis=1)
    rings = sides * np.arange(len(profile) - 1)[:, None, None]
    faces = np.concatenate([rings[1:] + low, rings[:-1] + high]).reshape(-1, 3)
    vertices = (profile[:, None, [0, 1, 0]] * circle).reshape(-1, 3)[sides - 1 : 1 - sides]
    return vertices, np.clip(faces - sides + 1, 0, len(vertices) - 1)  # an end is one corner


def ball(rings: int, sides: int) -> Solid:
    """Return a sphere of radius 1."""
    angle = np.linspace(-np.pi / 2, np.pi / 2, rings + 1)
    return turned(np.stack([np.cos(angle), np.sin(angle)], axis=1), sides)


def rod(sides: int) -> Solid:
    """Return a cylinder of radius 1 from y = 0 to 1. Its caps have corners of their own, so that its rim is sharp."""
    return turned(np.array([[0, 0], [1, 0], [1, 0], [1, 1], [1, 1], [0, 1]], float), sides)


def capsule(radius: float, cap: float, rings: int, sides: int) -> Solid:
    """Return a rod from y = 0 to 1 that ends in half spheroids, which are `cap` high."""
    angle = np.linspace(0, np.pi / 2, rings + 1)
    low = np.stack([radius * np.sin(angle), cap * (1 - np.cos(angle))], axis=1)
    return turned(np.vstack([low, low[::-1] * [1, -1] + [0, 1]]), sides)


def add_batch(
    scene: viser.SceneApi, name: str, mesh: Solid, scales: Floats, **drawn: Any
) -> viser.BatchedMeshHandle:
    """Add as many of a mesh as there are scales; where they stand is told later. drawn: as `add_batched_meshes_simple` has it."""
    turns, places = unturned(len(scales)), np.zeros((len(scales), 3))
    drawn |= {"batched_scales": scales.astype(np.float32), "lod": "off"}
    return scene.add_batched_meshes_simple(name, *mesh, turns, places, **drawn)


def unturned(count: int) -> Floats[N, D4]:
    """Return quaternions that turn nothing."""
    return np.tile([1.0, 0.0, 0.0, 0.0], (count, 1)).astype(np.float32)


# ---- Where a hand is, of a pose as it is drawn


def hand_balls(session: SessionSnapshot, pose: PoseSnapshot) -> tuple[Floats[N, D3], Floats[N]]:
    """Return centres and radii [m] of balls around a hand, without its forearm; of all of a body."""
    bones = [session.bone_names[bone] for bone in session.ellipsoid_bone]
    chosen = np.array([bone != "forearm" for bone in bones])
    return pose.centre[chosen], session.radii.max(axis=1)[chosen]


# ---- Light on the hand, and a faint ground below it


_BELOW = 0.16  # [m] the ground lies this far below the hand's middle
_LINE, _SECTION = (44, 48, 54), (62, 68, 76)


def add_surroundings(
    server: viser.ViserServer, hand: Floats[D3], up: Floats[D3], reach_m: float
) -> None:
    """Add lights, in place of viser's, and the ground for a hand [m] in a world whose upward axis is `up`.

    reach_m: how far it extends around its middle; a body stands on the ground.
    """
    larger = reach_m / HAND_REACH_M
    scene = server.scene
    side = np.cross(up, (1.0, 0.0, 0.0) if abs(up[0]) < 0.8 else (0.0, 1.0, 0.0))
    side /= np.linalg.norm(side)
    frame = np.stack([side, np.cross(up, side), up], axis=1)
    scene.world_axes.visible = False
    scene.configure_default_lights(enabled=False)
    scene.configure_environment_map("studio", environment_intensity=0.15)
    scene.add_light_hemisphere(
        "/light/sky", sky_color=(255, 255, 255), ground_color=(120, 120, 130), intensity=0.6
    )
    for name, way, strength in (("key", (0.4, -0.5, 1.0), 1.4), ("fill", (-0.8, 0.6, 0.3), 0.5)):
        scene.add_light_directional(
            f"/light/{name}", intensity=strength, position=tuple(frame @ np.array(way))
        )
    scene.add_grid(
        "/ground", 3.0 * larger, 3.0 * larger, plane="xy", cell_size=0.05 * larger, section_size=0.25 * larger, cell_color=_LINE,
        section_color=_SECTION, cell_thickness=0.6, section_thickness=0.8, fade_distance=2.5 * larger,
        fade_strength=1.5, shadow_opacity=0.0, wxyz=quaternion_wxyz(frame), position=hand - larger * _BELOW * up,
    )  # fmt: skip


# ---- Other poses than the one shown, as translucent skeletons


_THICK, _OPACITY = 0.06, 0.4  # of a bone's length, at most; and how opaque
_MOST_M = 0.0026
_HAND_BONE_M = 0.045  # of a hand, which may have a forearm, the median


class Ghosts:
    """The bones of all of them as one batched mesh, which is seen at the frame that they are of."""

    def __init__(self, server: viser.ViserServer, take: Callable[[int], None]) -> None:
        """Add the mesh, hidden; `take(rank)` is called when one is clicked."""
        self.guesses: GuessesSnapshot | None = None
        self.bones = add_batch(
            server.scene, "/ghosts", capsule(0.5, 0.25, 4, 8), np.full((1, 3), 1e-4),
            batched_colors=np.zeros((1, 3), np.uint8), opacity=_OPACITY, cast_shadow=False, visible=False,
        )  # fmt: skip

        @self.bones.on_click
        def _(event: viser.SceneNodePointerEvent[viser.BatchedMeshHandle]) -> None:
            known, index = self.guesses, event.instance_index
            if known is not None and index is not None and 0 <= index < len(known.owner):
                take(int(known.owner[index]))

    def update(self, guesses: GuessesSnapshot) -> None:
        """Take others."""
        self.guesses = guesses
        if not len(guesses.owner):
            return
        larger = max(float(np.median(guesses.length)) / _HAND_BONE_M, 1.0)
        thick = 2 * np.minimum(_THICK * guesses.length, _MOST_M * larger)
        scales = np.stack([thick, guesses.length, thick], axis=1)
        self.bones.batched_positions = guesses.position.astype(np.float32)
        self.bones.batched_wxyzs = quaternion_wxyz(guesses.rotation).astype(np.float32)
        self.bones.batched_scales = np.maximum(scales, 1e-6).astype(np.float32)
        self.bones.batched_colors = linear(np.array(GHOSTS)[guesses.owner])

    def show(self, wanted: bool, frame: int) -> None:
        """Show those of the frame shown, if they are wanted."""
        known = self.guesses
        visible = wanted and known is not None and len(known.owner) > 0 and known.frame == frame
        put(self.bones, visible=visible)
