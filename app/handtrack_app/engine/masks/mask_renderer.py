"""Makes what the page shows of a frame's masks: each over its camera's image. Knows no threads."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from handtrack.arrays import D3, Bytes, H, W
from handtrack.capture.masks.mask_correction import AS_IT_IS
from handtrack.diagnostics.residual_image import mask_picture
from handtrack.errors import HandtrackError
from handtrack.session.session import Session
from handtrack.session.sources.views import View
from handtrack_app.engine.pictures.camera_pictures import CameraPictures, contact_sheet
from handtrack_app.protocol.masks import MaskPicture

_SMALL_PX = 240  # height, as of the other small pictures
_CORRECTED = (86, 180, 233)
"""around what was corrected"""


@dataclass(frozen=True, eq=False)
class MaskMoment:
    """What pictures of a frame's masks are made from."""

    frame: int
    session: Session
    on_all: bool
    """over all cameras' small pictures"""
    screens: tuple[str, ...]
    """cameras whose large pictures are looked at"""


class MaskRenderer:
    """On the render thread only."""

    def __init__(self, session: Session) -> None:
        self._maker = CameraPictures(session)

    def picture(self, moment: MaskMoment) -> MaskPicture:
        """Return the masks over the images. What cannot be made of a camera is told, and the others are shown."""
        small: dict[str, Bytes] = {}
        screens: dict[tuple[str, str], Bytes] = {}
        corrected: dict[str, str] = {}
        wrong: list[str] = []
        for view in moment.session.views:
            if not moment.on_all and view.name not in moment.screens:
                continue
            try:
                large = self._painted(view, moment.frame)
                corrected[view.name] = _words(view, moment.frame)
            except HandtrackError as error:
                large = self._maker.plain(view.name, moment.frame)
                wrong.append(str(error))
            if view.name in moment.screens:
                screens[view.name, "mask"] = large
            if moment.on_all:
                small[view.name] = _small(large)
        sheet = (
            contact_sheet({f"{name}  {moment.frame}": image for name, image in small.items()})
            if small
            else None
        )
        return MaskPicture(moment.frame, small, sheet, screens, corrected, " ".join(wrong))

    def _painted(self, view: View, frame: int) -> Bytes[H, W, D3]:
        image, silhouette = self._maker.plain(view.name, frame), view.silhouette(frame)
        if silhouette is None:
            return image
        picture = mask_picture(image, silhouette)
        own = view.own_frame(frame)
        layer = None if own is None else view.corrections.layer(own)
        if layer is not None:
            marked = np.where(layer != AS_IT_IS, np.uint8(255), np.uint8(0))
            straight = self._maker.straight(view.name, marked)
            lines, _ = cv2.findContours(straight, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
            cv2.drawContours(picture, lines, -1, _CORRECTED, 1)
        return picture


def _small(image: Bytes[H, W, D3]) -> Bytes[H, W, D3]:
    height, width = image.shape[:2]
    if height <= _SMALL_PX:
        return image
    size = (round(width * _SMALL_PX / height), _SMALL_PX)
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)  # type: ignore[return-value]


def _words(view: View, frame: int) -> str:
    frames, own = view.corrections.frames, view.own_frame(frame)
    here = "corrected here" if own in frames else "not corrected here"
    return f"{here}; {len(frames)} frame{'s' if len(frames) != 1 else ''} in all"
