"""Corrections of a camera's masks, painted by a person: where they say something, they win over files and methods."""

from __future__ import annotations

import threading
from pathlib import Path

import cv2
import numpy as np

from handtrack.arrays import Array, Bytes, H, W
from handtrack.capture.masks.mask_correction import AS_IT_IS, LEVELS, corrected
from handtrack.errors import HandtrackError
from handtrack.files.atomic import write_over
from handtrack.session.layout import CORRECTED_FOLDER, inside


class CorrectedMasks:
    """A camera's corrections by its own frames: files, and before them what is not in files yet. Safe from several threads."""

    def __init__(self, folder: Path, camera: str, size: tuple[int, int], has_files: bool) -> None:
        """size: width, height [px] of the camera's images. has_files: those of a running camera are about a recording's frames."""
        self._root, self._camera, self._size = folder, camera, size
        self._has_files = has_files
        self._held: dict[int, bytes | None] = {}
        self._lock = threading.Lock()

    def hold(self, frame: int, content: bytes | None) -> None:
        """Let a correction, as `encoded` gives it, count before what stands in files; None: none counts."""
        with self._lock:
            self._held[frame] = content

    def content(self, frame: int) -> bytes | None:
        """Return a frame's correction as a PNG file has it; None where nobody corrected it. Raises HandtrackError."""
        with self._lock:
            if frame in self._held:
                return self._held[frame]
        path = self.path(frame) if self._has_files else None
        return path.read_bytes() if path is not None and path.is_file() else None

    def layer(self, frame: int) -> Bytes[H, W] | None:
        """Return a frame's correction: 255 hand, 0 background, UNKNOWN_LEVEL nobody knows, AS_IT_IS not corrected; None where
        nobody corrected it. Raises HandtrackError for a file that is none.
        """
        content = self.content(frame)
        return None if content is None else decoded(content, self._size, str(self.path(frame)))

    def over(self, frame: int, mask: Bytes[H, W] | None, unknown: int) -> Bytes[H, W] | None:
        """Return a frame's mask with its correction painted over it; the same mask where nobody
        corrected it.

        Parameters
        ----------
        unknown
            The value of the result where nobody knows.
        """
        layer = self.layer(frame)
        return mask if layer is None else corrected(layer, mask, unknown)

    def write(self, frame: int, content: bytes | None, ours: bytes | None) -> bool:
        """Write or (None) remove the file of a correction; see `write_over`."""
        return write_over(self.path(frame), content, ours)

    def path(self, frame: int) -> Path:
        """Return where the file of a frame lies, if there is one. Raises HandtrackError where that leaves the session."""
        return inside(
            self._root, f"{CORRECTED_FOLDER}/{self._camera}/{frame:06d}.png", str(self._root)
        )

    @property
    def frames(self) -> list[int]:
        """The camera's own frames that are corrected."""
        files = self.path(0).parent.glob("*.png") if self._has_files else ()
        found = {int(path.stem) for path in files if path.stem.isdecimal()}
        with self._lock:
            held = dict(self._held)
        return sorted(
            {f for f in found if f not in held} | {f for f, c in held.items() if c is not None}
        )


def encoded(layer: Bytes[H, W]) -> bytes | None:
    """Return a layer as a PNG file; None for one that says nothing."""
    if (layer == AS_IT_IS).all():
        return None
    good, buffer = cv2.imencode(".png", layer)
    assert good, "a PNG is always made"
    return buffer.tobytes()


def decoded(content: bytes, size: tuple[int, int], where: str) -> Bytes[H, W]:
    """Return the layer of a PNG file. Raises HandtrackError, naming `where`, for another size or other levels."""
    image: Array | None = None
    if content:
        image = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
    wanted = f"a grey PNG of {size[0]} x {size[1]} with the levels {', '.join(map(str, LEVELS))}"
    if image is None:
        raise HandtrackError(
            f"{where}: no image that can be read; expected a correction of masks, {wanted}."
        )
    if image.dtype != np.uint8 or image.shape != (size[1], size[0]):
        raise HandtrackError(
            f"{where}: found an image {image.shape} of {image.dtype}; expected {wanted}."
        )
    others = np.setdiff1d(image, LEVELS)
    if len(others):
        raise HandtrackError(
            f"{where}: found the level {others[0]}; expected {wanted}: background, not corrected, unknown, hand."
        )
    return np.asarray(image, np.uint8)  # type: ignore[return-value]
