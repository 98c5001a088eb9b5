"""Images of a lens as a pinhole view shows them; see `geometry.source_lens`."""

from __future__ import annotations

from functools import cached_property

import cv2
import numpy as np

from handtrack.arrays import Array, Axes, H, W
from handtrack.capture.images.frames import FrameSource
from handtrack.geometry.source_lens import PinholeView, SourceLens


class StraightenedFrames:
    """A source whose images are brought into a view of their lens; see capture.images.frames.FrameSource."""

    def __init__(self, taken: FrameSource, lens: SourceLens, view: PinholeView) -> None:
        """taken: the images as the lens took them."""
        self._taken, self._lens, self._view = taken, lens, view

    @cached_property
    def _maps(self) -> tuple[Array[H, W], Array[H, W]]:
        """float32: column and row of the taken image that each of the view's pixels shows."""
        places = np.nan_to_num(self._view.source(self._lens), nan=-1e4).astype(np.float32)
        return np.ascontiguousarray(places[..., 0]), np.ascontiguousarray(places[..., 1])

    @property
    def where(self) -> str:
        return self._taken.where

    @property
    def size(self) -> tuple[int, int] | None:
        return None if self._taken.size is None else self._view.size

    @property
    def frames(self) -> range:
        return self._taken.frames

    @property
    def known_frames(self) -> range:
        return self._taken.known_frames

    @property
    def warnings(self) -> tuple[str, ...]:
        return self._taken.warnings

    def has(self, frame: int) -> bool:
        return self._taken.has(frame)

    def read(self, frame: int) -> Array[H, W, *Axes] | None:
        image = self._taken.read(frame)
        return None if image is None else cv2.remap(image, *self._maps, cv2.INTER_LINEAR)
