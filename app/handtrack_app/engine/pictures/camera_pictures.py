"""Camera images as the page shows them: undistorted, small for the frusta, large and painted for the screen."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import replace

import cv2
import numpy as np

from handtrack.arrays import D3, Array, Axes, Bytes, H, W
from handtrack.diagnostics.residual_image import (
    OUTLINE,
    field_picture,
    outline_picture,
    outline_polygons,
    residual_picture,
)
from handtrack.geometry.camera import Camera
from handtrack.model.flesh import PosedEllipsoids
from handtrack.observation.observation import Silhouette
from handtrack.session.session import Session
from handtrack_app.engine.pictures.cloud_pictures import depth_picture

_THUMBNAIL = 240  # [px] height of a frustum's image
_GAP, _PAPER = 8, 36  # [px] between pictures of a contact sheet, and its grey, that of the page
_SHEET = 620  # [px] width of a contact sheet
_KEPT = 24  # undistorted images kept in memory
_DARK, _LIGHT = 26, 150  # grey of a silhouette's background and hand, where a camera has no image


def smaller(camera: Camera, width: int, height: int) -> Camera:
    """Return the undistorted camera of a picture brought to another size."""
    factor = np.array([width / camera.size[0], height / camera.size[1]])
    matrix = camera.matrix.copy()
    matrix[0, 0], matrix[1, 1] = factor * (matrix[0, 0], matrix[1, 1])
    matrix[:2, 2] = factor * (matrix[:2, 2] + 0.5) - 0.5  # pixel centres have whole coordinates
    return replace(camera.without_distortion(), size=(width, height), matrix=matrix)


def contact_sheet(
    pictures: dict[str, Bytes[H, W, D3]], width: int = _SHEET, columns: int = 2
) -> Bytes[H, W, D3]:
    """Return the pictures side by side in rows, each with its camera's name, as one picture RGB."""
    columns = min(columns, max(len(pictures), 1))
    cell = (width - _GAP * (columns - 1)) // columns
    rows: list[Bytes] = []
    row: list[Bytes] = []
    named = list(pictures.items())
    for i, (name, picture) in enumerate(named):
        high = round(cell * picture.shape[0] / picture.shape[1])
        small = np.asarray(
            cv2.resize(picture, (cell, high), interpolation=cv2.INTER_AREA), np.uint8
        )
        for colour, thick in (((0, 0, 0), 5), ((255, 255, 255), 2)):
            cv2.putText(
                small, name, (10, high - 12), cv2.FONT_HERSHEY_SIMPLEX, 0.75, colour, thick,
                cv2.LINE_AA,
            )  # fmt: skip
        row.append(small)
        if len(row) == columns or i == len(named) - 1:
            rows.append(_padded(row, width, cell))
            row = []
    return np.concatenate(rows) if rows else np.full((8, width, 3), _DARK, np.uint8)


def _padded(row: list[Bytes], width: int, cell: int) -> Bytes:
    strip = np.full((max(p.shape[0] for p in row) + _GAP, width, 3), _PAPER, np.uint8)
    for i, picture in enumerate(row):
        left = i * (cell + _GAP)
        strip[: picture.shape[0], left : left + cell] = picture
    return strip


def _depth(session: Session, name: str, frame: int) -> Array | None:
    """Return what a depth camera gave (H, W) [m]; None where it is none, or its lens would have to be undone."""
    for view in session.views:
        if view.name == name and view.depth is not None and not view.camera.is_distorted:
            return view.depth_m(frame)
    return None


class CameraPictures:
    """Makes pictures of a session's cameras; keeps the last ones, for posing redraws the same frame."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._maps: dict[str, tuple[Array, Array] | None] = {}
        self._kept: OrderedDict[tuple[str, int], Bytes] = OrderedDict()

    def camera(self, name: str) -> Camera:
        return self._session.rig[name]

    def plain(self, name: str, frame: int) -> Bytes[H, W, D3]:
        """Return a camera's undistorted picture RGB; its silhouette where it has no images."""
        key = (name, frame)
        if key in self._kept:
            self._kept.move_to_end(key)
            return self._kept[key]
        image = self._read(name, frame)
        self._kept[key] = image
        if len(self._kept) > _KEPT:
            self._kept.popitem(last=False)
        return image

    def straight(self, name: str, image: Array[H, W, *Axes]) -> Bytes[H, W, *Axes]:
        """Return a camera's image, or a layer over it, without the lens's distortion."""
        maps = self._undistortion(self.camera(name))
        kind = cv2.INTER_LINEAR if image.ndim > 2 else cv2.INTER_NEAREST
        return image if maps is None else cv2.remap(image, *maps, kind)  # type: ignore[return-value]

    def thumbnail(
        self, name: str, frame: int, paint: str = "plain", flesh: PosedEllipsoids | None = None
    ) -> Bytes[H, W, D3]:
        """Return a small picture, with the model's outline over it unless `paint` is `plain`."""
        image = self.plain(name, frame)
        height, width = image.shape[:2]
        size = (round(width * _THUMBNAIL / height), _THUMBNAIL)
        small = image
        if height > _THUMBNAIL:
            small = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)
        if paint == "plain" or flesh is None:
            return small
        return outline_picture(
            small, smaller(self.camera(name), small.shape[1], small.shape[0]), flesh
        )

    def screen(
        self,
        name: str,
        frame: int,
        paint: str,
        flesh: PosedEllipsoids,
        silhouette: Silhouette | None,
        aside: int | None = None,
    ) -> Bytes[H, W, D3]:
        """Return the large picture with the model painted over it.

        paint: `plain`, `outline`, `residual`, `field`, or `close` for the outline on what is near the model; silhouette: where there is one; aside: a bone
        that a close picture may cut off.
        """
        image = self.plain(name, frame)
        camera = self.camera(name).without_distortion()
        if paint == "close":
            return close_up(image, camera, flesh, aside)
        if paint == "outline":
            return outline_picture(image, camera, flesh)
        if paint == "residual" and silhouette is not None:
            return residual_picture(image, camera, flesh, silhouette.mask)
        if paint == "field":
            return field_picture(camera, flesh)
        return image

    def _read(self, name: str, frame: int) -> Bytes:
        camera = self.camera(name)
        bgr = self._session.image(name, frame)
        if bgr is not None:
            return self.straight(name, cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB))  # type: ignore[return-value]
        depth = _depth(self._session, name, frame)
        if depth is not None:
            return depth_picture(depth)
        for silhouette in self._session.observation(frame, cloud=False).silhouettes:
            if silhouette.camera.name == name:
                shade = np.where(silhouette.mask < 0, 0.5, silhouette.mask)
                grey = _DARK + (_LIGHT - _DARK) * shade
                return np.repeat(grey.astype(np.uint8)[..., None], 3, axis=2)
        width, height = camera.size
        return np.full((height, width, 3), _DARK, np.uint8)

    def _undistortion(self, camera: Camera) -> tuple[Array, Array] | None:
        if camera.name not in self._maps:
            maps = None
            if camera.is_distorted:
                matrix, size = camera.matrix, camera.size
                made = cv2.initUndistortRectifyMap(
                    matrix, camera.distortions, np.eye(3), matrix, size, cv2.CV_16SC2
                )
                maps = (made[0], made[1])
            self._maps[camera.name] = maps
        return self._maps[camera.name]


CLOSE_SIZE = (640, 480)
"""width and height [px]; the page's wall has room for that shape"""
_AIR = 1.5  # times what just fits
_MOST = 12.0  # times enlarged at most, as in a view through a camera
_THICK = 2  # [px] of the outline


def close_up(
    image: Bytes[H, W, D3], camera: Camera, flesh: PosedEllipsoids, aside: int | None = None
) -> Bytes[H, W, D3]:
    """Return the part of an undistorted image RGB that shows a model with its outline, `CLOSE_SIZE` large; all of it where none is before the camera.

    aside: a bone that may be cut off, a hand's forearm.
    """
    factor, left, top = _part(camera, flesh, aside)
    shift = np.array([[factor, 0, -factor * left], [0, factor, -factor * top]])
    way = cv2.INTER_CUBIC if factor > 1 else cv2.INTER_AREA
    close = cv2.warpAffine(image, shift, CLOSE_SIZE, flags=way, borderValue=(26, 26, 26))
    picture = np.ascontiguousarray(close, np.uint8)
    matrix = camera.matrix.copy()
    matrix[0, 0], matrix[1, 1] = factor * matrix[0, 0], factor * matrix[1, 1]
    matrix[:2, 2] = factor * (matrix[:2, 2] - (left, top))
    near = replace(camera.without_distortion(), size=CLOSE_SIZE, matrix=matrix)
    lines = [np.rint(line).astype(np.int32)[:, None] for line in outline_polygons(near, flesh)]
    cv2.polylines(picture, lines, True, OUTLINE, _THICK, cv2.LINE_AA)
    return picture


def _part(camera: Camera, flesh: PosedEllipsoids, aside: int | None) -> tuple[float, float, float]:
    """Return the enlargement, and the column and row [px] of the part's upper left pixel."""
    seen = flesh.centre @ camera.rotation.T + camera.translation
    reach = flesh.radii.max(axis=1)
    ahead = (seen[:, 2] > reach) & (flesh.bone != (-1 if aside is None else aside))
    wide, high = camera.size
    low, high_corner = np.zeros(2), np.array([wide, high], float)
    if ahead.any():
        depth = seen[ahead, 2:]
        pixels = (seen[ahead] / depth) @ camera.matrix[:2].T
        around = reach[ahead, None] / depth * np.diag(camera.matrix)[:2]
        low, high_corner = (pixels - around).min(axis=0), (pixels + around).max(axis=0)
    size = np.maximum(high_corner - low, 1.0)
    least = min(CLOSE_SIZE[0] / wide, CLOSE_SIZE[1] / high)
    factor = min(CLOSE_SIZE[0] / size[0], CLOSE_SIZE[1] / size[1]) / (_AIR if ahead.any() else 1.0)
    factor = float(np.clip(factor, least, _MOST * least))
    middle = np.clip((low + high_corner) / 2, 0, (wide, high))
    left, top = middle - np.array(CLOSE_SIZE) / 2 / factor
    return factor, float(left), float(top)
