"""From a camera's images or video to the board views that are worth calibrating with."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from handtrack.arrays import Array, Axes, Floats, H, W
from handtrack.capture.calibration.board_detection import BoardView, find_board
from handtrack.capture.calibration.boards import Board, Chessboard
from handtrack.capture.images.frames import FrameSource
from handtrack.errors import HandtrackError

_BLURRED = 1.6  # times the camera's median edge width: left out where there are enough others
_THOROUGH_UP_TO = 60  # images: more is a video, where one view less does not matter


@dataclass(frozen=True)
class CameraViews:
    """What one camera saw of the board."""

    name: str
    size: tuple[int, int]
    """width, height [px]."""
    shared: tuple[BoardView, ...]
    """views synchronised with the other cameras by frame number"""
    alone: tuple[BoardView, ...] = ()
    """views for this camera's lens alone"""
    tried: int = 0
    """images that were searched"""
    where: str = ""
    """files, for messages"""

    @property
    def views(self) -> tuple[BoardView, ...]:
        """All of them, shared ones first."""
        return *self.shared, *self.alone

    def only(self, keep: Callable[[BoardView], bool]) -> CameraViews:
        """Return the same camera with some of its views."""
        kept = (tuple(filter(keep, views)) for views in (self.shared, self.alone))
        return replace(self, **dict(zip(("shared", "alone"), kept)))


Progress = Callable[[], object]
"""Called after each image; it may raise to stop."""


def frames_to_search(sources: Iterable[FrameSource], most: int = 400) -> range:
    """Return the frames to look at in all cameras alike: every one, or every n-th of a long video."""
    count = max((len(source.frames) for source in sources), default=0)
    return range(0, count, max(1, -(-count // most)))


def search_views(
    source: FrameSource,
    board: Board,
    frames: Iterable[int],
    progress: Progress = lambda: None,
    as_image: Callable[[Array[H, W, *Axes]], Array[H, W, *Axes]] = lambda image: image,
) -> tuple[list[BoardView], tuple[int, int] | None, int]:
    """Return the views of the board in a source, the image size and how many images there were.

    as_image: makes what the source gives (a raw mosaic) an image. Raises HandtrackError when images
    of one camera differ in size.
    """
    frames = [frame for frame in frames if source.has(frame)]
    thorough = len(frames) <= _THOROUGH_UP_TO
    views: list[BoardView] = []
    size: tuple[int, int] | None = None
    first, tried = "", 0
    for frame in frames:
        image = source.read(frame)
        progress()
        if image is None:
            continue
        image, tried = as_image(image), tried + 1
        here = _name(source, frame)
        found = (image.shape[1], image.shape[0])
        if size is not None and found != size:
            raise HandtrackError(
                f"{here} is {found[0]} x {found[1]}, but {first} of the same camera is {size[0]} x "
                f"{size[1]}; expected one size, that of the recordings to be tracked. Leave the "
                "others out."
            )
        size, first = found, first or here
        view = find_board(image, board, frame, here, thorough)
        if view is not None:
            views.append(view)
    return views, size, tried


def _name(source: FrameSource, frame: int) -> str:
    path = getattr(source, "path", None)
    return str(path(frame)) if callable(path) else f"{source.where}, frame {frame}"


def natural_order(paths: Iterable[Path]) -> list[Path]:
    """Return files by the numbers in their names: img2 before img10."""
    return sorted(
        paths,
        key=lambda p: [int(t) if t.isdecimal() else t for t in re.split(r"(\d+)", str(p))],
    )


def choose_views(cameras: Sequence[CameraViews], most: int = 40) -> list[CameraViews]:
    """Return the cameras with at most `most` views each: sharp ones, spread over place, size and tilt.

    Frames are chosen once for all cameras, so that views stay common ones.
    """
    sharp = [_without_blurred(camera) for camera in cameras]
    describing = {camera.name: _descriptions(camera, camera.shared) for camera in sharp}
    frames = _spread_frames(sharp, describing, most)
    chosen = []
    for camera in sharp:
        shared = tuple(view for view in camera.shared if view.frame in frames)
        alone = camera.alone
        if len(alone) > most:
            alone = tuple(alone[i] for i in _farthest(_descriptions(camera, alone), most))
        chosen.append(replace(camera, shared=shared, alone=alone))
    return chosen


def _without_blurred(camera: CameraViews) -> CameraViews:
    if len(camera.views) < 12:
        return camera  # too few to be choosy
    limit = _BLURRED * float(np.median([view.blur_px for view in camera.views]))
    return camera.only(lambda view: view.blur_px <= limit)


def _spread_frames(
    cameras: Sequence[CameraViews], describing: dict[str, Floats], most: int
) -> set[int]:
    """Return frames such that each camera has up to `most`; frames that more cameras see go first."""
    seen: dict[int, int] = {}
    for camera in cameras:
        for view in camera.shared:
            seen[view.frame] = seen.get(view.frame, 0) + 1
    frames: set[int] = set()
    # first per number of cameras: what all see binds the rig together
    for camera in sorted(cameras, key=lambda c: len(c.shared)):
        have = [i for i, view in enumerate(camera.shared) if view.frame in frames]
        weight = np.array([seen[view.frame] for view in camera.shared], dtype=float)
        rows = _farthest(describing[camera.name], most, have, weight)
        frames |= {camera.shared[i].frame for i in rows}
    for camera in cameras:  # others' choices may have brought more than wanted
        extra = [view.frame for view in camera.shared if view.frame in frames]
        if len(extra) > 2 * most:
            frames -= {f for f in extra[:: max(2, len(extra) // most)] if seen[f] == 1}
    return frames


def _descriptions(camera: CameraViews, views: Sequence[BoardView]) -> Floats:
    """Return (V, 6) what matters in a view: place, size, tilt; each about 0 to 1."""
    width, height = camera.size
    rows = []
    for view in views:
        middle = view.pixels.mean(axis=0)
        spread = view.pixels - middle
        _, values, _ = np.linalg.svd(spread.T @ spread / len(spread))
        long, short = np.sqrt(values)
        corner_sizes = _foreshortening(view.pixels)
        rows.append(
            [middle[0] / width, middle[1] / height, 2 * long / width, short / long, *corner_sizes]
        )
    return np.array(rows).reshape(len(views), 6)


def _foreshortening(pixels: Floats) -> tuple[float, float]:
    """Return how much corners crowd to one side, along x and y: the sign of a tilt."""
    low, high = pixels.min(axis=0), pixels.max(axis=0)
    share = (pixels.mean(axis=0) - low) / np.maximum(high - low, 1e-9)
    return float(4 * (share[0] - 0.5)), float(4 * (share[1] - 0.5))


def _farthest(
    rows: Floats, most: int, have: Sequence[int] = (), weight: Array | None = None
) -> list[int]:
    """Return up to `most` rows, each next one the farthest from all before, begun with `have`."""
    chosen = list(have)[:]
    if len(rows) <= most:
        return list(range(len(rows)))
    weight = np.ones(len(rows)) if weight is None else weight
    if not chosen:
        middle = np.median(rows, axis=0)
        chosen = [int(np.argmax(weight - 0.1 * np.linalg.norm(rows - middle, axis=1)))]
    distance = np.min([np.linalg.norm(rows - rows[i], axis=1) for i in chosen], axis=0)
    while len(chosen) < most:
        best = int(np.argmax(distance * weight))
        if distance[best] <= 0:
            break
        chosen.append(best)
        distance = np.minimum(distance, np.linalg.norm(rows - rows[best], axis=1))
    return chosen


def require_views(
    board: Board, cameras: Sequence[CameraViews], images: Callable[[], list[Array[H, W, *Axes]]]
) -> None:
    """Raise HandtrackError when a camera never saw the board, or it is larger than was said.

    images: gives a few images in which a board of another size is looked for.
    """
    for camera in cameras:
        views = camera.views
        larger = [view for view in views if view.goes_on]
        if len(larger) > 0.5 * len(views):
            other = _other_size(board, images()) if isinstance(board, Chessboard) else None
            found = f"; it looks like {other[0]} x {other[1]}" if other is not None else ""
            raise HandtrackError(
                f"the board is larger than {board.text}: in {len(larger)} of {len(views)} views of camera "
                f"'{camera.name}' squares go on beyond its edge ({larger[0].source}){found}. Count all inner "
                "corners, where four squares meet."
            )
    without = [camera for camera in cameras if not camera.views]
    if not without:
        return
    tried = sum(camera.tried for camera in without)
    names = ", ".join(f"'{camera.name}'" for camera in without)
    text = (
        f"no {board.text} board was found in any of {tried} images of camera {names} "
        f"({without[0].where})."
    )
    other = _other_size(board, images()) if isinstance(board, Chessboard) else None
    if other is not None:
        raise HandtrackError(
            f"{text} There is a chessboard of {other[0]} x {other[1]} inner corners: use "
            f"--board chessboard:{other[0]}x{other[1]}:{board.square_m * 1e3:g}mm. Count inner "
            "corners, where four squares meet, not squares."
        )
    if all(not camera.tried for camera in without):
        raise HandtrackError(f"camera {names}: no image could be read ({without[0].where}).")
    advice = (
        "The whole board with its white border must be seen, sharp and lit evenly; the size counts inner corners."
        if isinstance(board, Chessboard)
        else "At least eight corners must be seen, sharp; check squares, dictionary and that the print is not mirrored."
    )
    raise HandtrackError(f"{text} {advice}")


def _other_size(board: Chessboard, images: Sequence[Array]) -> tuple[int, int] | None:
    c, r = board.columns, board.rows
    likely = [(c - 1, r - 1), (c + 1, r + 1), (c - 1, r), (c, r - 1), (c + 1, r), (c, r + 1)]
    common = [
        (9, 6),
        (8, 6),
        (7, 6),
        (10, 7),
        (8, 5),
        (7, 5),
        (6, 5),
        (7, 4),
        (6, 4),
        (5, 4),
        (11, 8),
    ]
    for columns, rows in dict.fromkeys(likely + common):
        if min(columns, rows) >= 3 and (columns, rows) != (c, r):
            other = Chessboard(columns, rows, board.square_m)
            found = [find_board(image, other) for image in images]
            if any(view is not None and not view.goes_on for view in found):
                return columns, rows
    return None
