"""Ghosts: other poses than the one shown, as translucent skeletons."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import viser

from handtrack.geometry.rotation import quaternion_wxyz
from handtrack_app.page.page import put
from handtrack_app.page.scene.model_view import capsule
from handtrack_app.protocol.palette import GHOSTS, linear
from handtrack_app.protocol.snapshots import GuessesSnapshot

_THICK, _OPACITY = 0.06, 0.4  # of a bone's length, at most; and how opaque
_MOST_M = 0.0026
_HAND_BONE_M = 0.045  # of a hand, which may have a forearm, the median


class Ghosts:
    """The bones of all of them as one batched mesh, which is seen at the frame that they are of."""

    def __init__(
        self, server: viser.ViserServer, name: str, take: Callable[[int], None] | None = None
    ) -> None:
        """Add the mesh, hidden; `take(rank)` is called when one is clicked."""
        rod = capsule(0.5, 0.25, 4, 8)
        self.guesses: GuessesSnapshot | None = None
        self.bones = server.scene.add_batched_meshes_simple(
            name, rod.vertices, rod.faces, np.array([[1.0, 0.0, 0.0, 0.0]]), np.zeros((1, 3)),
            batched_scales=np.full((1, 3), 1e-4, np.float32), batched_colors=np.zeros((1, 3), np.uint8),
            opacity=_OPACITY, lod="off", cast_shadow=False, visible=False,
        )  # fmt: skip
        if take is not None:
            self.bones.on_click(lambda event: self._clicked(event.instance_index, take))

    def _clicked(self, index: int | None, take: Callable[[int], None]) -> None:
        known = self.guesses
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
