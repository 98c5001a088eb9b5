"""The model: ellipsoids as one batched mesh, bones, joints, the merged surface; and the truth."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
import viser

from handtrack.arrays import D2, D3, D4, Bytes, Floats, Ints, N, T, V
from handtrack.geometry.rotation import quaternion_wxyz
from handtrack_app.page.page import Display, put
from handtrack_app.palette import GHOSTS, TRUTH, colour_of, colours_of, linear
from handtrack_app.protocol import (
    HAND_REACH_M,
    GuessesSnapshot,
    PoseSnapshot,
    SessionSnapshot,
)

_BONE_RADIUS = 0.0028  # [m]
_JOINT_RADIUS = 0.0045
_THICKER = 0.75  # power of the model's size with which bones grow thicker
_CHAINS = [[0, *range(first, first + 4)] for first in range(1, 21, 4)]
KEYPOINT_LINKS = np.array([pair for chain in _CHAINS for pair in pairwise(chain)])


class HandView:
    """One hand in the scene, hidden until its first pose comes: from then on only poses are sent, never meshes."""

    def __init__(self, server: viser.ViserServer, session: SessionSnapshot) -> None:
        scene, names = server.scene, session.bone_names
        self._root = scene.add_frame("/hand", show_axes=False)
        self.bone_length = session.bone_length
        small, count = ball(12, 16), len(names)
        colours = colours_of(names, np.arange(count))
        thick = (session.reach_m / HAND_REACH_M) ** _THICKER
        across = np.full(count, thick * _BONE_RADIUS)

        def batch(
            node: str, mesh: Solid, scales: Floats, colour: Bytes | tuple[int, int, int], **more: Any
        ) -> viser.BatchedMeshHandle:  # fmt: skip
            more |= {"batched_colors": colour, "visible": False}
            return add_batch(scene, f"/hand/{node}", mesh, scales, **more)

        of_ellipsoids = colours_of(names, session.ellipsoid_bone)
        self.ellipsoids = batch("flesh", ball(20, 32), session.radii, of_ellipsoids)
        self.bones = batch(
            "bones", rod(16), np.stack([across, session.bone_length, across], 1), colours
        )
        self.joints = batch(
            "joints", small, np.full(2 * count, thick * _JOINT_RADIUS), np.tile(colours, (2, 1))
        )
        self.truth_lines = scene.add_line_segments(
            "/hand/truth", np.zeros((len(KEYPOINT_LINKS), 2, 3), np.float32), TRUTH, thickness=2.5,
            thickness_units="screen", visible=False,
        )  # fmt: skip
        self.truth_points = batch(
            "truth_points", small, np.full(21, 0.0028), TRUTH, cast_shadow=False
        )
        self.part_bone = [part.bone for part in session.parts]
        self.parts = tuple(
            scene.add_mesh_simple(
                f"/hand/part{i}", part.vertices.astype(np.float32), part.faces.astype(np.uint32),
                color=colour_of(names[part.bone]), visible=False,
            )
            for i, part in enumerate(session.parts)
        )  # fmt: skip
        """of a body, drawn instead of ellipsoids"""

    def show(self, display: Display, instead: bool) -> None:
        """Apply the display options to the hand. instead: the surface stands where the ellipsoids would."""
        shown = display.ellipsoids or (display.surface and not instead)
        self.ellipsoids.visible = shown and not self.parts
        for part in self.parts:
            put(part, visible=shown)
        self.bones.visible = self.joints.visible = display.skeleton

    def move_to_pose(self, pose: PoseSnapshot, display: Display) -> None:
        """Move what is shown of the hand to a pose; what is hidden follows when it is shown."""
        places, turns = pose.bone_position, quaternion_wxyz(pose.bone_rotation)
        if display.ellipsoids or display.surface:  # for which they stand while that is made
            if not self.parts:
                self.ellipsoids.batched_positions = pose.centre.astype(np.float32)
                wxyzs = quaternion_wxyz(pose.rotation).astype(np.float32)
                self.ellipsoids.batched_wxyzs = wxyzs
            for part, bone in zip(self.parts, self.part_bone, strict=True):
                part.position, part.wxyz = places[bone], turns[bone]
        if self.bones.visible:
            ends = places + pose.bone_rotation[:, :, 1] * self.bone_length[:, None]
            self.bones.batched_positions = places.astype(np.float32)
            self.bones.batched_wxyzs = turns.astype(np.float32)
            self.joints.batched_positions = np.concatenate([places, ends]).astype(np.float32)

    def show_truth(self, pose: PoseSnapshot, wanted: bool) -> None:
        """Show the true keypoints of the pose's frame, where there are 21 of them."""
        truth = pose.truth if wanted else None
        known = np.zeros(21, bool)
        if truth is not None and len(truth) == 21:
            known[:] = np.isfinite(truth).all(axis=1)
        shown = bool(known.any())
        if shown and truth is not None:
            somewhere = truth[known][0]  # where what is unknown is drawn, too: nobody sees it there
            whole = known[KEYPOINT_LINKS].all(axis=1).reshape(-1, 1, 1)
            lines = np.where(whole, truth[KEYPOINT_LINKS], somewhere)
            self.truth_lines.points = lines.astype(np.float32)
            points = np.where(known[:, None], truth, somewhere)
            self.truth_points.batched_positions = points.astype(np.float32)
        self.truth_lines.visible = self.truth_points.visible = shown

    def remove(self) -> None:
        """Take the hand out of the scene."""
        self._root.remove()


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


TINY = 1e-3
"""size of the mesh whose instances can be clicked, in place of 1. viser keeps one more of it, hidden, for the outline of what is
pointed at: until something is, that stands unscaled at the world's origin and takes the pointer from all that is behind it
"""


def tiny(mesh: Solid) -> Solid:
    """Return a mesh of size 1 as small as those of instances that can be clicked."""
    return TINY * mesh[0], mesh[1]


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
            server.scene, "/ghosts", tiny(capsule(0.5, 0.25, 4, 8)), np.full((1, 3), 1e-4),
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
        self.bones.batched_scales = (np.maximum(scales, 1e-6) / TINY).astype(np.float32)
        self.bones.batched_colors = linear(np.array(GHOSTS)[guesses.owner])

    def show(self, wanted: bool, frame: int) -> None:
        """Show those of the frame shown, if they are wanted."""
        known = self.guesses
        visible = wanted and known is not None and len(known.owner) > 0 and known.frame == frame
        put(self.bones, visible=visible)
