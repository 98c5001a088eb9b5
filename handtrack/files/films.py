"""Films that OpenCV writes."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import cv2


def check_film(path: Path, frames: int) -> None:
    """Raise OSError where a film that was written has fewer frames: of a full disk, OpenCV says nothing."""
    film = cv2.VideoCapture(str(path))
    held = int(film.get(cv2.CAP_PROP_FRAME_COUNT))
    film.release()
    if held < frames:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))
