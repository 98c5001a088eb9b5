"""Colours of skin from images that were segmented by hand: a person's corrections of masks, or image files with mask files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from handtrack.arrays import D3, Bytes, N
from handtrack.errors import HandtrackError
from handtrack.session.session import Session

_HAND = 255


def painted_skin(session: Session) -> list[Bytes[N, D3]]:
    """Return, image by image, the colours uint8 RGB below what was painted as hand in a recording's masks.

    Raises HandtrackError where nothing is painted.
    """
    found = []
    for view in session.views:
        if view.settings.images is None or not (painted := set(view.corrections.frames)):
            continue
        for frame in session.frame_range:
            own = view.own_frame(frame)
            if own is None or own not in painted:
                continue
            image, layer = view.image(frame), view.corrections.layer(own)
            if image is not None and layer is not None and (layer == _HAND).any():
                found.append(image[layer == _HAND][:, ::-1])
    if not found:
        raise HandtrackError(
            f"{session.folder}: in no camera's image a hand is painted, so there is no skin to take the colour from. Paint it in "
            "the workbench's tab Masks in an image or two, and save; or give segmented images as files."
        )
    return found


def segmented_skin(files: Sequence[tuple[Path, Path]]) -> list[Bytes[N, D3]]:
    """Return the colours uint8 RGB of each image file where their masks (8 bit, above 127: hand) cover them. Raises HandtrackError."""
    found = []
    for image_file, mask_file in files:
        image = _read(image_file, cv2.IMREAD_COLOR)
        mask = _read(mask_file, cv2.IMREAD_GRAYSCALE)
        if image.shape[:2] != mask.shape:
            raise HandtrackError(
                f"{mask_file}: a mask of {mask.shape[1]} x {mask.shape[0]} pixels; expected the size of {image_file}, "
                f"{image.shape[1]} x {image.shape[0]}."
            )
        found.append(image[mask > 127][:, ::-1])
    return found


def _read(path: Path, how: int) -> Bytes:
    image = cv2.imread(str(path), how) if path.is_file() else None
    if image is None:
        raise HandtrackError(f"{path}: no image that can be read; expected a PNG or JPEG file.")
    return np.asarray(image, np.uint8)
