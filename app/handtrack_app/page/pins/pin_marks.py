"""Pins as they are drawn in the scene: a head on the ray, and a thread to what it holds."""

from __future__ import annotations

import numpy as np

from handtrack_app.page.page import Page, put
from handtrack_app.page.pins.taking_hold import near_joint_m
from handtrack_app.page.scene.model_view import ball
from handtrack_app.protocol.palette import CONTRADICTED, PIN
from handtrack_app.protocol.snapshots import HAND_REACH_M, PoseSnapshot, SessionSnapshot

_HEADS, _THREADS = "/pins/heads", "/pins/threads"
_HEAD_M = 0.0028
_MISSED = 1.6
"""times as large is the head of a pin that the pose misses: red and orange look alike to many"""
_BEFORE_M = 0.03
"""that a pin's head stands nearer to its camera than what it holds: flesh does not hide it"""


class PinMarks:
    """They are drawn for all pages."""

    def __init__(self, page: Page) -> None:
        self._page = page
        mesh = ball(8, 12)
        self._heads = page.server.scene.add_batched_meshes_simple(
            _HEADS, mesh.vertices, mesh.faces, np.array([[1.0, 0.0, 0.0, 0.0]]), np.zeros((1, 3)),
            batched_scales=np.array([_HEAD_M], np.float32), batched_colors=PIN, lod="off", cast_shadow=False, visible=False,
        )  # fmt: skip
        self._threads = page.server.scene.add_line_segments(
            _THREADS, np.zeros((1, 2, 3), np.float32), PIN, thickness=2.0, thickness_units="screen",
            visible=False,
        )  # fmt: skip

    def show(self, session: SessionSnapshot, pose: PoseSnapshot) -> None:
        """Show the pins of a pose; those that it misses, which contradict something, are red and larger."""
        pins, larger = pose.pins, session.reach_m / HAND_REACH_M
        centres = {card.name: card.centre for card in session.cameras}
        with self._page.server.atomic():
            if pins:
                meant = np.array([pin.meant for pin in pins])
                back = np.array([centres[pin.camera] for pin in pins]) - meant
                away = np.linalg.norm(back, axis=1, keepdims=True)
                heads = meant + back * np.minimum(larger * _BEFORE_M / np.maximum(away, 1e-9), 0.5)
                places = np.array([pin.place for pin in pins])
                turn = np.array([1.0, 0.0, 0.0, 0.0], np.float32)
                self._heads.batched_positions = heads.astype(np.float32)
                self._heads.batched_wxyzs = np.tile(turn, (len(pins), 1))
                missed = np.array([pin.off_m > near_joint_m(session) for pin in pins])
                heads_m = larger**0.75 * _HEAD_M * np.where(missed, _MISSED, 1.0)
                self._heads.batched_scales = heads_m.astype(np.float32)
                colours = np.where(missed[:, None], CONTRADICTED, PIN).astype(np.uint8)
                self._heads.batched_colors = colours
                self._threads.colors = np.repeat(colours[:, None], 2, axis=1)
                self._threads.points = np.stack([heads, places], axis=1).astype(np.float32)
            put(self._heads, visible=bool(pins))
            put(self._threads, visible=bool(pins))
