"""Camera images as the page shows them: undistorted, small for the frusta, large and painted for the screen."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import replace

import cv2
import numpy as np

from handtrack.arrays import D2, D3, Array, Axes, Bytes, Floats, H, N, W
from handtrack.capture.clouds.stereo import REJECTED, RectifiedPair, StereoView
from handtrack.capture.masks.mask_correction import AS_IT_IS
from handtrack.diagnostics.residuals import (
    field_picture,
    joint_pairs,
    joints_picture,
    mask_picture,
    outline_picture,
    residual_picture,
)
from handtrack.errors import HandtrackError
from handtrack.geometry.camera import Camera
from handtrack.model.ellipsoids import Ellipsoids
from handtrack.parallel import LRUCache
from handtrack.session.sources.views import View
from handtrack_app.engine.document import Document, Moment
from handtrack_app.engine.service import FramePictures, RenderThread
from handtrack_app.palette import FILTERS, KEPT, REJECTS
from handtrack_app.protocol import Command, Image, PictureSnapshot, Snapshot

_THUMBNAIL = 240  # [px] height of a frustum's image
_KEPT = 24  # undistorted images kept in memory
_DARK, _LIGHT = 26, 150  # grey of a silhouette's background and hand, where a camera has no image


def shrunk(image: Image) -> Image:
    """Return an image no higher than a frustum's."""
    height, width = image.shape[:2]
    if height <= _THUMBNAIL:
        return image
    return as_wide(image, round(width * _THUMBNAIL / height))


def as_wide(image: Image, width: int) -> Image:
    """Return an image of another width [px]."""
    size = (width, max(round(width * image.shape[0] / image.shape[1]), 1))
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)  # type: ignore[return-value]


class CameraPictures:
    """Makes pictures of cameras; keeps the last ones, for posing redraws the same frame."""

    def __init__(self) -> None:
        self._maps: dict[Camera, Sequence[Array]] = {}
        self._plain = LRUCache[tuple[Camera, int], Bytes]()

    def plain(self, view: View, frame: int) -> Image:
        """Return a camera's undistorted picture RGB; its silhouette where it has no images."""
        key = view.camera, frame
        return self._plain.value(key, lambda: self._read(view, frame), lambda _: _KEPT)

    def straight(self, camera: Camera, image: Array[H, W, *Axes]) -> Bytes[H, W, *Axes]:
        """Return a camera's image, or a layer over it, without the lens's distortion."""
        if not camera.is_distorted:
            return image  # type: ignore[return-value]
        if camera not in self._maps:
            self._maps[camera] = cv2.initUndistortRectifyMap(
                camera.matrix,
                camera.distortions,
                np.eye(3),
                camera.matrix,
                camera.size,
                cv2.CV_16SC2,
            )
        kind = cv2.INTER_LINEAR if image.ndim > 2 else cv2.INTER_NEAREST
        return cv2.remap(image, *self._maps[camera], kind)  # type: ignore[return-value]

    def painted(self, moment: Moment, name: str, over: str, small: bool = False) -> Image:
        """Return a camera's undistorted picture with the model of a moment painted over it.

        over: `outline`, `field` in place of the image, `residual` against the masks with a detector's joints, of a small picture the
        outline; `close` for the outline on what is near the model; else nothing.
        """
        session = moment.run.session
        view = session.view(name)
        image, camera = self.plain(view, moment.frame), view.camera.without_distortion()
        if small:
            image = shrunk(image)
            camera = camera.scaled((image.shape[1], image.shape[0]))
        match over:
            case "field":
                return field_picture(camera, moment.ellipsoids)
            case "close":
                return close_up(image, camera, moment.ellipsoids, moment.aside)
            case "residual" if not small:
                observed = session.observation(moment.frame, cloud=False).silhouettes
                for silhouette in (s for s in observed if s.camera.name == name):
                    image = residual_picture(image, camera, moment.ellipsoids, silhouette.mask)
                return joints_picture(image, _joints(moment, view))
            case "outline" | "residual":
                return outline_picture(image, camera, moment.ellipsoids)
        return image

    def _read(self, view: View, frame: int) -> Bytes:
        bgr = view.image(frame)
        if bgr is not None:
            return self.straight(view.camera, cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB))  # type: ignore[return-value]
        depth = None if view.camera.is_distorted else view.depth_m(frame)
        if depth is not None:
            return depth_picture(depth)
        silhouette = view.silhouette(frame)
        if silhouette is not None:
            shade = np.where(silhouette.mask < 0, 0.5, silhouette.mask)
            grey = _DARK + (_LIGHT - _DARK) * shade
            return np.repeat(grey.astype(np.uint8)[..., None], 3, axis=2)
        width, height = view.camera.size
        nothing, size = np.full((height, width, 3), _DARK, np.uint8), width / 400
        place = width // 12, height // 6
        cv2.putText(nothing, "no image", place, cv2.FONT_HERSHEY_SIMPLEX, size, (_LIGHT,) * 3, 2)
        return nothing


CLOSE_SIZE = (640, 480)
"""width and height [px]; the page's wall has room for that shape"""
_AIR = 1.5  # times what just fits
_MOST = 12.0  # times enlarged at most, as in a view through a camera
_THICK = 2  # [px] of the outline


def close_up(image: Image, camera: Camera, ellipsoids: Ellipsoids, aside: int = -1) -> Image:
    """Return the part of an undistorted image RGB that shows a model with its outline, `CLOSE_SIZE` large; all of it where none is before the camera.

    aside: a bone that may be cut off, a hand's forearm.
    """
    part = _part(camera, ellipsoids, aside)
    way = cv2.INTER_CUBIC if part[0, 0] > 1 else cv2.INTER_AREA
    close = cv2.warpAffine(image, part[:2], CLOSE_SIZE, flags=way, borderValue=(26, 26, 26))
    near = replace(camera.without_distortion(), size=CLOSE_SIZE, matrix=part @ camera.matrix)
    return outline_picture(np.asarray(close, np.uint8), near, ellipsoids, _THICK)


def _part(camera: Camera, ellipsoids: Ellipsoids, aside: int) -> Floats[D3, D3]:
    """Return what brings the image's pixels to those of the part."""
    reach, depth = ellipsoids.radii.max(axis=1), camera.to_camera(ellipsoids.centre)[:, 2]
    ahead = (depth > reach) & (ellipsoids.bone != aside)
    size, whole, air = np.array(CLOSE_SIZE), np.array(camera.size), 1.0
    low, high = np.zeros(2), whole
    if ahead.any():
        pixels = camera.without_distortion().project(ellipsoids.centre[ahead])
        around = (reach / depth)[ahead, None] * np.diag(camera.matrix)[:2]
        low, high, air = (pixels - around).min(axis=0), (pixels + around).max(axis=0), _AIR
    least = (size / whole).min()
    wanted = (size / np.maximum(high - low, 1.0)).min() / air
    factor = np.clip(wanted, least, _MOST * least)
    corner = np.clip((low + high) / 2, 0, whole) - size / 2 / factor
    return np.array([[factor, 0, -factor * corner[0]], [0, factor, -factor * corner[1]], [0, 0, 1]])


# ---- Pictures of clouds: camera images with each point in its filter's colour, and how a pair was matched


NARROW_PX, WIDE_PX = 310, 620  # width of a picture in its panel, and large
_LINES = 12  # epipolar lines
_MARGIN = 0.12  # around what was matched, as a share of its size
_LINE = (86, 180, 233)


def points_picture(
    image: Image,
    camera: Camera,
    points: Floats[N, D3],
    fate: Array[N],
    names: tuple[str, ...],
    width: int,
) -> Image:
    """Return an image RGB at a width [px], each point painted in the colour of the filter that dropped it.

    points: world [m]. fate: place of the filter in `names`, or their number for points that stay.
    """
    factor = width / image.shape[1]
    picture = np.asarray(0.72 * as_wide(image, width), np.uint8)
    size = picture.shape[1::-1]
    pixels = factor * (camera.project(points) + 0.5) if len(points) else np.zeros((0, 2))
    with np.errstate(invalid="ignore"):
        observed = ((pixels >= 0) & (pixels < size)).all(axis=1)
    for number, name in enumerate(names):  # those that stay come last, on top
        _paint(picture, pixels[observed & (fate == number)], FILTERS[name], 1)
    _paint(picture, pixels[observed & (fate == len(names))], KEPT, 1 + (width > NARROW_PX))
    return picture


def _paint(picture: Bytes, pixels: Floats, colour: tuple[int, int, int], side: int) -> None:
    x, y = pixels.astype(np.int64).T if len(pixels) else np.zeros((2, 0), np.int64)
    for right in range(side):
        for down in range(side):
            rows = np.minimum(y + down, picture.shape[0] - 1)
            picture[rows, np.minimum(x + right, picture.shape[1] - 1)] = colour


def depth_picture(depth_m: Floats[H, W]) -> Image:
    """Return a depth image [m] in colours RGB, near is bright; black where nothing was measured."""
    known = np.isfinite(depth_m) & (depth_m > 0)
    return _coloured(np.where(known, -depth_m, np.nan))


def stereo_pictures(view: StereoView) -> dict[str, Image]:
    """Return what to show of a matched pair, RGB: both rectified images with lines along which they are compared,
    the disparity, and what was thrown away; cut to what was matched, and around it.
    """
    rows, columns, moved = _cut(view)
    left, right = (np.asarray(i[..., ::-1], np.uint8).copy() for i in (view.left, view.right))
    disparity = view.disparity[rows, columns]
    grey = np.asarray(left[rows, columns].mean(axis=2) * 0.4, np.uint8)
    thrown = np.repeat(grey[..., None], 3, axis=2)
    kept = np.isfinite(disparity)
    thrown[kept] = np.clip(thrown[kept].astype(int) + 40, 0, 255)
    for number in range(1, len(REJECTED)):
        thrown[view.rejected[rows, columns] == number] = REJECTS[number]
    return {
        "left, rectified": _with_lines(left[rows, columns]),
        "right, rectified": _with_lines(right[rows, moved]),
        "disparity": _coloured(np.where(kept, disparity, np.nan)),
        "rejected": thrown,
    }


def stereo_words(view: StereoView, pair: RectifiedPair) -> str:
    """Return how a pair was matched, in a line or two."""
    asked = max(view.asked, 1)
    known = view.disparity[np.isfinite(view.disparity)]
    asked_words = f"{view.asked:,}".replace(",", "\u202f")
    words = f"{100 * view.matched_share:.0f} % of {asked_words} pixels matched"
    if len(known):
        near, far = (float(pair.depth_of(np.quantile(known, q))) for q in (0.99, 0.01))
        words += f", {far * 100:.0f} to {near * 100:.0f} cm away"
    parts = [
        f"{REJECTED[n]} {100 * float((view.rejected == n).sum()) / asked:.0f} %"
        for n in range(1, len(REJECTED))
        if (view.rejected == n).any()
    ]
    return f"{words}. Rejected: {', '.join(parts)}." if parts else f"{words}."


def _cut(view: StereoView) -> tuple[slice, slice, slice]:
    """Return rows and columns of the left image around what was looked at, and the right image's columns."""
    height, width = view.disparity.shape
    looked = np.isfinite(view.disparity) | (view.rejected > 0)
    x, y, wide, high = cv2.boundingRect(looked.astype(np.uint8))
    if not wide:
        whole = slice(0, width)
        return slice(0, height), whole, whole
    top, bottom = _span(y, y + high, height)
    left, right = _span(x, x + wide, width)
    known = view.disparity[np.isfinite(view.disparity)]
    shift = round(float(np.median(known))) if len(known) else 0
    start = int(np.clip(left - shift, 0, width - (right - left)))
    return slice(top, bottom), slice(left, right), slice(start, start + right - left)


def _span(low: int, high: int, size: int) -> tuple[int, int]:
    room = round(_MARGIN * (high - low))
    return max(low - room, 0), min(high + room, size)


def _with_lines(image: Bytes) -> Bytes:
    picture = np.ascontiguousarray(image)
    thick = max(picture.shape[1] // 500, 1)
    for row in np.linspace(0, picture.shape[0] - 1, _LINES + 2)[1:-1].round().astype(int):
        cv2.line(picture, (0, int(row)), (picture.shape[1] - 1, int(row)), _LINE, thick)
    return picture


def _coloured(values: Array) -> Bytes:
    """Return values (H, W) in colours that people with any colour vision can read; NaN is black."""
    known = np.isfinite(values)
    if not known.any():
        return np.zeros((*values.shape, 3), np.uint8)
    low, high = np.quantile(values[known], [0.01, 0.99])
    share = (np.nan_to_num(values, nan=low) - low) / max(float(high - low), 1e-12)
    grey = np.asarray(np.clip(40 + 215 * share, 40, 255), np.uint8)
    picture = np.asarray(cv2.applyColorMap(grey, cv2.COLORMAP_CIVIDIS)[..., ::-1], np.uint8).copy()
    picture[~known] = 0
    return picture


# ---- What the page wants to see of the cameras at the frame shown


_MASKS_EVERY_S = 0.6  # while tracking runs: they may be made by a method


class Painter(FramePictures):
    """The cameras' images with the model painted over them."""

    every_s = 0.08  # the hand itself comes first
    hurried_s = 0.25  # a picture takes its time from tracking (`bench as_if_live`)
    _thumbnails, _masks, _paint = True, False, "plain"
    _screens: tuple[tuple[str, str], ...] = ()

    def __init__(
        self, document: Document, publish: Callable[[Snapshot], None], thread: RenderThread
    ) -> None:
        self._document, self._publish, self._thread = document, publish, thread
        self.maker = CameraPictures()
        """for the render thread alone"""

    @Command(view=True, latest=())
    def want_pictures(
        self,
        thumbnails: bool,
        paint: str,
        screens: tuple[tuple[str, str], ...] = (),
        masks: bool = False,
    ) -> None:
        """Show these pictures. paint: over the small ones: `plain`, `outline`, `residual` or `field`. screens: cameras whose pictures
        stand behind the hand, each with what is painted over it. masks: of all cameras, too.
        """
        self._thumbnails, self._masks, self._paint = thumbnails, masks, paint
        self._screens = screens
        self.hurried_s = _MASKS_EVERY_S if masks else type(self).hurried_s
        self.show()

    @property
    def is_wanted(self) -> bool:
        """Whether the page looks at any."""
        return self._thumbnails or self._masks or bool(self._screens)

    def _show(self, hurried: bool) -> None:
        self._thread.ask("pictures", self._make(self._publish))

    def picture(self) -> PictureSnapshot | None:
        """Return all that the page wants of the frame shown, in one; None where it wants nothing. Takes its time."""
        if not self.is_wanted:
            return None
        made = self._thread.wait_for(self._make(lambda _: None))
        return made if isinstance(made, PictureSnapshot) else None

    def _make(self, publish: Callable[[Snapshot], None]) -> Callable[[], PictureSnapshot]:
        """Return what makes them on the render thread. publish: gets the large ones, which come first."""
        moment, maker = self._document.moment, self.maker
        session, frame = moment.run.session, moment.frame
        small, over_small, masks = self._thumbnails, self._paint, self._masks
        screens = [one for one in self._screens if one[1] != "mask"]
        masked = [name for name, over in self._screens if over == "mask"]

        def make() -> PictureSnapshot:
            made = PictureSnapshot(frame)
            for camera, over in screens:
                made.screens[camera, over] = maker.painted(moment, camera, over)
            if screens and (small or masks or masked):
                publish(PictureSnapshot(frame, screens=made.screens))
            for camera in session.rig.names if small else ():
                made.thumbnails[camera] = maker.painted(moment, camera, over_small, small=True)
            add_masks(made, maker, session.views, masks, masked)
            return made

        return make


def _joints(moment: Moment, view: View) -> Floats[N, D2, D2]:
    """Return where a detector saw a camera's joints and where the model has them [px], of those that both have."""
    run, model = moment.run, moment.run.model
    sigma_px, places = run.settings.keypoints.detected_px, model.joint_positions(moment.bones)
    observed = view.keypoints(moment.frame, sigma_px)
    pairs = [joint_pairs(joints, model.joint_names, places) for joints in observed]
    return np.concatenate([np.zeros((0, 2, 2)), *pairs])


# ---- Masks over the images


_CORRECTED = (86, 180, 233)
"""around what was corrected"""


def add_masks(
    made: PictureSnapshot,
    maker: CameraPictures,
    views: Iterable[View],
    on_all: bool,
    looked_at: Collection[str],
) -> None:
    """Add a frame's masks over the images: small ones of all cameras, and large ones of those that are looked at.

    What cannot be made of a camera is told, and the others are shown. On the render thread only.
    """
    for view in views:
        if not on_all and view.name not in looked_at:
            continue
        try:
            large = _masked(maker, view, made.frame)
            made.corrected[view.name] = _corrected_words(view, made.frame)
        except HandtrackError as error:
            large = maker.plain(view, made.frame)
            made.problems.append(str(error))
        if view.name in looked_at:
            made.screens[view.name, "mask"] = large
        if on_all:
            made.masks[view.name] = shrunk(large)


def _masked(maker: CameraPictures, view: View, frame: int) -> Image:
    image, silhouette = maker.plain(view, frame), view.silhouette(frame)
    if silhouette is None:
        return image
    picture = mask_picture(image, silhouette)
    own = view.own_frame(frame)
    layer = None if own is None else view.corrections.layer(own)
    if layer is not None:
        marked = np.where(layer != AS_IT_IS, np.uint8(255), np.uint8(0))
        straight = maker.straight(view.camera, marked)
        lines, _ = cv2.findContours(straight, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
        cv2.drawContours(picture, lines, -1, _CORRECTED, 1)
    return picture


def _corrected_words(view: View, frame: int) -> str:
    frames, own = view.corrections.frames, view.own_frame(frame)
    if not frames:
        return ""
    here = "corrected here" if own in frames else "not corrected here"
    return f"{here}; {len(frames)} frame{'s' if len(frames) != 1 else ''} in all"
