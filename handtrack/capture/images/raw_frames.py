"""Read numbered files of raw Bayer mosaics as colour images."""

from __future__ import annotations

import threading
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from handtrack.arrays import D3, Array, Bytes, H, W
from handtrack.capture.images.bayer import METHODS, demosaic, mosaic_doubts
from handtrack.capture.images.frames import RAW, ImageFiles
from handtrack.errors import HandtrackError

_WHITE_PERCENTILE = 99.5  # 10 or 12 bits in 16, dark or bright; single hot pixels do not count
_EIGHT_BIT = 255.0


@dataclass(frozen=True)
class MosaicSettings:
    """How a camera's raw files become colour images."""

    pattern: str
    """colours of the first 2 x 2 pixels, row by row: RGGB, BGGR, GRBG or GBRG."""
    white_level: float | None = None
    """the value that becomes 255; None: 255 of 8 bit files, and of 16 bit ones the level that the brightest
    half per cent of the first readable file exceeds. The same for all frames, so that colours stay."""
    method: str = METHODS[0]
    """how the missing colours are found, see `demosaic`."""


class MosaicFiles(ImageFiles):
    """Numbered raw files (H, W), 8 or 16 bits, as images (H, W, 3) uint8 BGR."""

    def __init__(
        self,
        paths: Iterable[Path],
        settings: MosaicSettings,
        expected_size: tuple[int, int] | None = None,
        where: str = "",
    ) -> None:
        super().__init__(paths, RAW, expected_size, where)
        self._settings = settings
        self._white = settings.white_level
        self._doubts: tuple[str, ...] = ()
        self._looked = False
        self._lock = threading.Lock()

    @property
    def size(self) -> tuple[int, int] | None:
        """width, height [px] of the first readable file, which is also looked at for a wrong pattern."""
        self._look()
        return super().size

    @property
    def warnings(self) -> tuple[str, ...]:
        with self._lock:
            return (*super().warnings, *self._doubts)

    def read(self, frame: int) -> Bytes[H, W, D3] | None:
        """Return the image of a frame, None where there is none. Raises HandtrackError for what is no mosaic."""
        mosaic = super().read(frame)
        if mosaic is None:
            return None
        self._look()
        settings = self._settings
        try:
            colour = demosaic(mosaic, settings.pattern, settings.method)
        except HandtrackError as error:
            raise HandtrackError(f"{self.path(frame)}: {error}") from None
        if colour.dtype == np.uint8 and settings.white_level is None:
            return colour
        return np.clip(colour * (_EIGHT_BIT / (self._white or 1.0)), 0, 255).astype(np.uint8)

    def _look(self) -> None:
        """Find the white level and look for a wrong pattern, once, in the first readable file."""
        with self._lock:
            if self._looked:
                return
            self._looked = True
            for frame in self.frames:
                mosaic = super().read(frame)
                if mosaic is not None:
                    self._learn(mosaic, frame)
                    return

    def _learn(self, mosaic: Array, frame: int) -> None:
        path = self.path(frame)
        try:
            doubts = mosaic_doubts(mosaic, self._settings.pattern)
        except HandtrackError as error:
            raise HandtrackError(f"{path}: {error}") from None
        self._doubts = tuple(f"{path}: {text}" for text in doubts)
        if self._white is None:
            self._white = max(float(np.percentile(mosaic, _WHITE_PERCENTILE)), 1.0)
