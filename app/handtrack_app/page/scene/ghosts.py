"""Ghosts: other poses that explain a frame, as translucent skeletons; a click takes one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import viser

from handtrack.geometry.rotation import quaternion_wxyz
from handtrack_app.page.page import Page, put
from handtrack_app.page.scene.model_view import capsule
from handtrack_app.protocol.palette import GHOSTS, linear
from handtrack_app.protocol.snapshots import ComparedSnapshot, GuessesSnapshot

_THICK, _OPACITY = 0.06, 0.4  # of a bone's length, at most; and how opaque
_MOST_M = 0.0026


@dataclass
class GhostView:
    """The bones of all guesses as one batched mesh."""

    bones: viser.BatchedMeshHandle
    guesses: GuessesSnapshot | None = None


def add_ghosts(server: viser.ViserServer, name: str, take: Callable[[int], None]) -> GhostView:
    """Add the mesh, hidden; `take(rank)` is called when one is clicked."""
    rod = capsule(0.5, 0.25, 4, 8)
    bones = server.scene.add_batched_meshes_simple(
        name, rod.vertices, rod.faces, np.array([[1.0, 0.0, 0.0, 0.0]]), np.zeros((1, 3)),
        batched_scales=np.full((1, 3), 1e-4, np.float32), batched_colors=np.zeros((1, 3), np.uint8),
        opacity=_OPACITY, lod="off", cast_shadow=False, visible=False,
    )  # fmt: skip
    view = GhostView(bones)

    @bones.on_click
    def _(event: viser.SceneNodePointerEvent) -> None:
        known, index = view.guesses, event.instance_index
        if known is not None and index is not None and 0 <= index < len(known.owner):
            take(int(known.owner[index]))

    return view


def update_ghosts(view: GhostView, guesses: GuessesSnapshot) -> None:
    """Take another list of guesses."""
    view.guesses = guesses
    if not len(guesses.owner):
        return
    thick = 2 * np.minimum(_THICK * guesses.length, _MOST_M * max(_size(guesses), 1.0))
    scales = np.stack([thick, guesses.length, thick], axis=1)
    view.bones.batched_positions = guesses.position.astype(np.float32)
    view.bones.batched_wxyzs = quaternion_wxyz(guesses.rotation).astype(np.float32)
    view.bones.batched_scales = np.maximum(scales, 1e-6).astype(np.float32)
    view.bones.batched_colors = linear(np.array(GHOSTS)[guesses.owner])


def show_ghosts(view: GhostView, wanted: bool, frame: int) -> None:
    """Show the guesses of the frame shown, if they are wanted."""
    known = view.guesses
    visible = wanted and known is not None and len(known.owner) > 0 and known.frame == frame
    put(view.bones, visible=visible)


def _size(guesses: GuessesSnapshot) -> float:
    """Return how many times longer bones are than a hand's, which may have a forearm."""
    return float(np.median(guesses.length) / 0.045)


# ---- The hand of the take that is compared: a yellow skeleton beside the one shown


_YELLOW = 5  # of the ghosts' colours


class ComparedHand:
    """It is there for the frame that it is of, and for no other."""

    def __init__(self, page: Page) -> None:
        self.view = add_ghosts(page.server, "/compared", lambda rank: None)
        self.snapshot: ComparedSnapshot | None = None
        self._frame: int | None = None

    def show(self, compared: ComparedSnapshot) -> None:
        """Take the hand of a frame."""
        self.snapshot = compared
        if len(compared.length):
            owner = np.full(len(compared.length), _YELLOW)
            bones = GuessesSnapshot(
                compared.frame, "compared", (), owner, compared.position, compared.rotation, compared.length
            )  # fmt: skip
            update_ghosts(self.view, bones)
        self._place()

    def show_frame(self, frame: int) -> None:
        """Hide it where it is of another frame."""
        self._frame = frame
        self._place()

    def _place(self) -> None:
        known = self.snapshot
        there = known is not None and len(known.length) > 0 and known.frame == self._frame
        put(self.view.bones, visible=there)
