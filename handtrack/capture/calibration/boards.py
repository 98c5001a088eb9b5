"""Calibration boards: chessboards and ChArUco boards, written as one short text, drawn to be printed, and found in images.

`chessboard:9x6:25mm` has 9 x 6 *inner* corners and squares of 25 mm; `charuco:7x5:30mm:22mm:DICT_4X4_50`
has 7 x 5 *squares* of 30 mm with markers of 22 mm. Board frame: x along a row to the right, y down the
rows, z into the board; origin at the first inner corner of a chessboard, at the outer corner of a
ChArUco board.
"""

from __future__ import annotations

import io
import re
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from PIL import Image

from handtrack.arrays import D2, D3, D4, Array, Axes, Bytes, Floats, H, Ints, N, R, W, runs
from handtrack.capture.images.frames import FrameSource
from handtrack.errors import HandtrackError, unknown_name
from handtrack.files.text_files import UNITS_M

_LEAST_SIDE = 3
EXAMPLES = "chessboard:9x6:25mm (inner corners) or charuco:7x5:30mm:22mm:DICT_4X4_50 (squares)"


@dataclass(frozen=True)
class Board:
    """A chessboard of columns x rows inner corners, its square at the upper left black; or, with a dictionary, a ChArUco board of
    columns x rows squares, with an ArUco marker in each white one.
    """

    columns: int
    rows: int
    square_m: float
    marker_m: float = 0.0
    dictionary: str = ""

    @property
    def text(self) -> str:
        start = f"{self.columns}x{self.rows}:{_millimetres(self.square_m)}"
        if not self.dictionary:
            return f"chessboard:{start}"
        return f"charuco:{start}:{_millimetres(self.marker_m)}:{self.dictionary}"

    @property
    def squares(self) -> tuple[int, int]:
        """Columns and rows of squares, the outer ones included."""
        outer = 0 if self.dictionary else 1
        return self.columns + outer, self.rows + outer

    @property
    def cv2_dictionary(self) -> Any:
        return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, self.dictionary))

    @cached_property
    def cv2_board(self) -> Any:
        size = (self.columns, self.rows)
        return cv2.aruco.CharucoBoard(size, self.square_m, self.marker_m, self.cv2_dictionary)

    @cached_property
    def points(self) -> Floats[N, D3]:
        """(N, 3) inner corners by their number, of a chessboard row by row, board frame [m]."""
        if self.dictionary:
            return np.array(self.cv2_board.getChessboardCorners(), dtype=float).reshape(-1, 3)
        row, column = np.mgrid[: self.rows, : self.columns]
        grid = np.stack([column, row, np.zeros_like(row)], axis=-1)
        return grid.reshape(-1, 3) * self.square_m

    @cached_property
    def turns(self) -> tuple[Ints[N], ...]:
        """Renumberings of the corners that look the same as the board in colour and shape.

        Turned by it, corner i of what is seen is corner `turn[i]` of the board. The first is the
        identity; more than one means the board does not tell how it is turned, as markers do.
        """
        if self.dictionary:
            return (np.arange(len(self.points)),)
        numbers = np.arange(self.columns * self.rows).reshape(self.rows, self.columns)
        # quarter turns after which the first inner square is black again
        kept = (0, 2) if (self.columns + self.rows) % 2 == 0 else (0,)
        if self.columns == self.rows and self.rows % 2 == 0:
            kept = range(4)
        return tuple(np.rot90(numbers, k).reshape(-1) for k in kept)


def parse_board(text: str) -> Board:
    """Return the board that a text describes. Raises HandtrackError saying what was expected."""
    kind, *parts = text.strip().split(":")
    if kind == "chessboard" and len(parts) == 2:
        return Board(*_counts(parts[0], text), _length(parts[1], text))
    if kind == "charuco" and len(parts) == 4:
        square, marker = (_length(part, text) for part in parts[1:3])
        columns, rows = _counts(parts[0], text)
        board = Board(columns, rows, square, marker, parts[3].upper())
        _check_markers(board, text)
        return board
    raise HandtrackError(f"board '{text}': expected {EXAMPLES}.")


def _check_markers(board: Board, text: str) -> None:
    known = sorted(name for name in dir(cv2.aruco) if name.startswith("DICT_"))
    if board.dictionary not in known:
        raise unknown_name("marker dictionary", board.dictionary, known, f"board '{text}'")
    if board.marker_m >= board.square_m:
        raise HandtrackError(
            f"board '{text}': the marker ({board.marker_m * 1e3:g} mm) must be smaller than its square "
            f"({board.square_m * 1e3:g} mm); the square comes first."
        )
    needed, there = (board.columns * board.rows) // 2, len(board.cv2_dictionary.bytesList)
    if needed > there:
        raise HandtrackError(
            f"board '{text}': it needs {needed} markers, {board.dictionary} has {there}; choose a larger "
            "dictionary or fewer squares."
        )


def _counts(part: str, text: str) -> tuple[int, int]:
    found = re.fullmatch(r"(\d+)[xX](\d+)", part.strip())
    if not found:
        raise HandtrackError(f"board '{text}': '{part}' is no size; expected {EXAMPLES}.")
    columns, rows = int(found[1]), int(found[2])
    if min(columns, rows) < _LEAST_SIDE or max(columns, rows) > 60:
        raise HandtrackError(
            f"board '{text}': {columns} x {rows}; expected {_LEAST_SIDE} to 60 of them along each side."
        )
    return columns, rows


def _length(part: str, text: str) -> float:
    found = re.fullmatch(r"(\d+(?:\.\d+)?)\s*(mm|cm|m)", part.strip())
    if not found:
        raise HandtrackError(
            f"board '{text}': '{part}' is no length; expected a number with its unit, such as 25mm."
        )
    length = float(found[1]) * UNITS_M[found[2]]
    if not 1e-3 <= length <= 2.0:
        raise HandtrackError(
            f"board '{text}': a side of {length * 1e3:g} mm; expected 1 mm to 2 m. Is the unit "
            "right?"
        )
    return length


def _millimetres(length_m: float) -> str:
    return f"{length_m * 1e3:.6g}mm"


# ---- Boards to print, in their true size: SVG and PDF as exact rectangles, PNG with its resolution


FORMATS = (".svg", ".pdf", ".png")
_MARGIN_MM = 12.0  # white around the squares: detectors need it, and the line of text stands in it
_POINT_MM = 25.4 / 72
_TEXT_MM = 3.5


def write_board(path: Path, board: Board, dpi: float) -> tuple[float, float]:
    """Write a board to an SVG, PDF or PNG file in true size; return the page's size (w, h) [mm].

    Parameters
    ----------
    dpi
        Of a PNG, whose edges are shaded to a quarter of a pixel; SVG and PDF are exact.
    """
    writers = {".svg": _svg, ".pdf": _pdf, ".png": lambda b: _png(b, dpi)}
    writer = writers.get(path.suffix.lower())
    if writer is None:
        raise HandtrackError(
            f"--out {path}: a board is written as {', '.join(FORMATS)}; found the suffix "
            f"'{path.suffix}'."
        )
    path.write_bytes(writer(board))
    return page_size_mm(board)


def page_size_mm(board: Board) -> tuple[float, float]:
    """Return width and height of the drawing with its margin [mm]."""
    square = board.square_m * 1e3
    margin = _margin_mm(board)
    width, height = board.squares
    return width * square + 2 * margin, height * square + 2 * margin


def black_rectangles(board: Board) -> Floats[R, D4]:
    """Return x, y, width, height [mm] of what is black, from the page's upper left corner."""
    square, margin = board.square_m * 1e3, _margin_mm(board)
    columns, rows = board.squares
    cells: list[tuple[float, ...]] = [
        (margin + c * square, margin + r * square, square, square)
        for r in range(rows)
        for c in range(columns)
        if (r + c) % 2 == 0
    ]
    if board.dictionary:
        cells += _marker_rectangles(board, margin)
    return np.array(cells)


def draw_board(board: Board, pixels_per_mm: float) -> Bytes[H, W]:
    """Return the page uint8 at a resolution; edges inside a pixel are shaded."""
    fine = 4  # sub-pixels along each side
    width, height = (round(side * pixels_per_mm) for side in page_size_mm(board))
    page = np.full((height * fine, width * fine), 255, np.uint8)
    for x, y, w, h in black_rectangles(board) * pixels_per_mm * fine:
        page[round(y) : round(y + h), round(x) : round(x + w)] = 0
    return page.reshape(height, fine, width, fine).mean(axis=(1, 3)).round().astype(np.uint8)


def _margin_mm(board: Board) -> float:
    return max(_MARGIN_MM, 0.5 * board.square_m * 1e3)


def _marker_rectangles(board: Board, margin: float) -> Iterator[tuple[float, ...]]:
    """Yield the black bits of all markers, neighbours in a row joined so that no hair lines show."""
    dictionary = board.cv2_dictionary
    modules = dictionary.markerSize + 2
    bit = board.marker_m * 1e3 / modules
    corners = [np.array(c, float).reshape(4, 3) for c in board.cv2_board.getObjPoints()]
    for number, corner in zip(board.cv2_board.getIds().reshape(-1), corners, strict=True):
        black = cv2.aruco.generateImageMarker(dictionary, int(number), modules) < 128
        left, top = corner[:, :2].min(axis=0) * 1e3 + margin
        for r, row in enumerate(black):
            for start, end in runs(row):
                yield left + start * bit, top + r * bit, (end - start) * bit, bit


def _caption(board: Board) -> str:
    width, height = (n * board.square_m * 1e3 for n in board.squares)
    return f"{board.text}   black and white squares together {width:g} x {height:g} mm: measure after printing at 100 %"


def _svg(board: Board) -> bytes:
    width, height = page_size_mm(board)
    rectangles = "\n".join(
        f'<rect x="{x:.6g}" y="{y:.6g}" width="{w:.6g}" height="{h:.6g}"/>'
        for x, y, w, h in black_rectangles(board)
    )
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.6g}mm" height="{height:.6g}mm" '
        f'viewBox="0 0 {width:.6g} {height:.6g}" shape-rendering="crispEdges">\n'
        f'<rect width="100%" height="100%" fill="white"/>\n{rectangles}\n'
        f'<text x="{_margin_mm(board):.6g}" y="{height - 4:.6g}" font-family="sans-serif" '
        f'font-size="{_text_mm(board):.3g}" fill="#666">{_caption(board)}</text>\n</svg>\n'
    ).encode()


def _text_mm(board: Board) -> float:
    """Return a size of letters with which the caption fits under the board [mm]."""
    return min(_TEXT_MM, page_size_mm(board)[0] / (0.6 * len(_caption(board))))


def _pdf(board: Board) -> bytes:
    """Return a one-page PDF; its page is the drawing, so that '100 %' and 'actual size' are true."""
    width, height = (side / _POINT_MM for side in page_size_mm(board))
    # PDF counts upwards from the lower left
    drawing = [
        f"{x / _POINT_MM:.4f} {height - (y + h) / _POINT_MM:.4f} {w / _POINT_MM:.4f} {h / _POINT_MM:.4f} re"
        for x, y, w, h in black_rectangles(board)
    ]
    caption = _caption(board).replace("(", r"\(").replace(")", r"\)")
    left, size = _margin_mm(board) / _POINT_MM, _text_mm(board) / _POINT_MM
    text = f"0.4 g BT /F1 {size:.2f} Tf {left:.2f} {4 / _POINT_MM:.2f} Td ({caption}) Tj ET"
    stream = ("0 g\n" + "\n".join(drawing) + f"\nf\n{text}\n").encode("latin-1")
    page = f"<< /Type /Page /Parent 2 0 R /MediaBox [0 0 {width:.4f} {height:.4f}] /Contents 4 0 R "
    objects = [
        b"<< /Type /Catalog /Pages 2 0 R /ViewerPreferences << /PrintScaling /None >> >>",
        b"<< /Type /Pages /Kids [3 0 R] /Count 1 >>",
        page.encode() + b"/Resources << /Font << /F1 5 0 R >> >> >>",
        b"<< /Length %d >>\nstream\n" % len(stream) + stream + b"endstream",
        b"<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica >>",
    ]
    return _pdf_file(objects)


def _pdf_file(objects: list[bytes]) -> bytes:
    file, places = b"%PDF-1.4\n", []
    for number, content in enumerate(objects, 1):
        places.append(len(file))
        file += b"%d 0 obj\n" % number + content + b"\nendobj\n"
    table = b"".join(b"%010d 00000 n \n" % place for place in places)
    count = len(objects) + 1
    end = b"trailer\n<< /Size %d /Root 1 0 R >>\nstartxref\n%d\n%%%%EOF\n" % (count, len(file))
    return file + b"xref\n0 %d\n0000000000 65535 f \n" % count + table + end


def _png(board: Board, dpi: float) -> bytes:
    page = draw_board(board, dpi / 25.4)
    size = _text_mm(board) * dpi / 25.4
    place = (round(_margin_mm(board) * dpi / 25.4), round(page.shape[0] - 4 * dpi / 25.4))
    cv2.putText(
        page, _caption(board), place, cv2.FONT_HERSHEY_SIMPLEX, size / 32, 100, 1, cv2.LINE_AA
    )
    file = io.BytesIO()
    Image.fromarray(page).save(file, "PNG", dpi=(dpi, dpi))
    return file.getvalue()


# ---- Views of a board: numbered inner corners to a fraction of a pixel, of those images that are worth calibrating with


_FLAGS = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
_LARGE = 2000  # [px] longer side above which corners are first looked for in a half-size image
_LEAST_AROUND = 0.08
"""of the contrast within the corners, that of the squares around them: in photographs with shadows it is 0.16 and more"""
_LEAST_CORNERS = 8  # of a ChArUco board that is partly seen; a pose needs four, a check more


@dataclass(frozen=True)
class BoardView:
    """A board as one camera saw it in one place."""

    ids: Ints[N]
    """rows of the board's `points`."""
    pixels: Floats[N, D2]
    blur_px: float
    """width of the board's edges [px]: about 2 in a sharp image."""
    source: str = ""
    """file or frame, for messages."""
    pose: Floats[D4, D4] = field(default_factory=lambda: np.full((4, 4), np.nan))
    """T_camera_board; NaN before the lens was fitted."""


def find_board(
    image: Array[H, W, *Axes],
    board: Board,
    source: str = "",
    thorough: bool = False,
) -> BoardView | None:
    """Return the board in an image (H, W[, 3]) uint8, None where it is not (fully) seen.

    Parameters
    ----------
    thorough
        Take a second or two an image for hard ones: blurred, or lit unevenly.
    """
    gray = _grey(image)
    if board.dictionary:
        found = _find_charuco(gray, board)
    else:
        found = _find_chessboard(gray, board, thorough)
    if found is None:
        return None
    ids, pixels = found
    # OpenCV 4's own refinement leaves half a pixel where markers are large; 5's does not
    side = float(min(_side_lengths(board, ids, pixels), default=0.0))
    pixels = _refined(gray, pixels, side * _free(board))
    return BoardView(ids, pixels, _blur(gray, board, ids, pixels), source)


def _grey(image: Array) -> Bytes:
    return image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)  # type: ignore[return-value]


def _searched(gray: Bytes) -> tuple[Bytes, int]:
    """Return the image in which chessboards are looked for first, and how many times smaller it is."""
    return (cv2.pyrDown(gray), 2) if max(gray.shape) > _LARGE else (gray, 1)  # type: ignore[return-value]


def _find_charuco(gray: Bytes, board: Board) -> tuple[Ints, Floats] | None:
    corners, ids, *_ = cv2.aruco.CharucoDetector(board.cv2_board).detectBoard(gray)
    if ids is None or len(ids) < _LEAST_CORNERS:
        return None
    numbers = np.array(ids, dtype=np.int64).reshape(-1)
    rows, columns = np.divmod(numbers, board.columns - 1)
    if len(np.unique(rows)) < 2 or len(np.unique(columns)) < 2:
        return None  # all in one line: no pose
    return numbers, np.array(corners, dtype=float).reshape(-1, 2)


def _find_chessboard(gray: Bytes, board: Board, thorough: bool) -> tuple[Ints, Floats] | None:
    size = (board.columns, board.rows)
    searched, smaller = _searched(gray)
    found, corners = cv2.findChessboardCorners(searched, size, flags=_FLAGS)
    if not found and thorough:
        flags = cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_ACCURACY
        found, corners = cv2.findChessboardCornersSB(searched, size, flags=flags)
    if not found:
        return None
    pixels = np.array(corners, dtype=float).reshape(-1, 2) * smaller
    grid = _oriented(gray, pixels.reshape(board.rows, board.columns, 2))
    return None if grid is None else (np.arange(len(pixels)), grid.reshape(-1, 2))


def _free(board: Board) -> float:
    """Return how far from a corner there is nothing but its own edges, as a share of the square."""
    if board.dictionary:
        return 0.45 * (1 - board.marker_m / board.square_m)
    return 0.35


def _refined(gray: Bytes, pixels: Floats, free_px: float) -> Floats:
    """Return corners (N, 2) moved to where their edges meet, looking `free_px` about them."""
    window = int(np.clip(free_px, 2, 11))
    points = np.ascontiguousarray(pixels.reshape(-1, 1, 2), dtype=np.float32)
    stop = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 60, 1e-3)
    refined = cv2.cornerSubPix(gray, points, (window, window), (-1, -1), stop)
    return np.array(refined, dtype=float).reshape(-1, 2)


def _oriented(gray: Bytes, grid: Floats) -> Floats | None:
    """Return corners (rows, columns, 2) numbered as the board is: not mirrored, first square black.

    The detectors number from either end. Where colours leave a choice, the numbering whose first
    corner is nearest to the image's upper left is taken. None when no numbering fits the colours.
    """
    right, down = grid[:, -1] - grid[:, 0], grid[-1] - grid[0]
    if np.linalg.det([right.mean(axis=0), down.mean(axis=0)]) < 0:  # mirrored
        grid = grid[:, ::-1]
    turned = (np.rot90(grid, k) for k in range(4))
    fitting = [one for one in turned if one.shape == grid.shape and _black_first(gray, one)]
    return min(fitting, key=lambda corners: float(corners[0, 0].sum()), default=None)


def _black_first(gray: Bytes, grid: Floats) -> bool:
    """Whether the squares like the one between the first four corners are darker than the others, also those all around the corners.

    Around them nothing alternates where corners of the board's outline were taken for a row of it, whose other end is out of view.
    """
    for axis in (0, 1):
        first, second, before, last = (grid.take([k], axis) for k in (0, 1, -2, -1))
        grid = np.concatenate([2 * first - second, grid, 2 * last - before], axis)
    centres = (grid[:-1, :-1] + grid[1:, :-1] + grid[:-1, 1:] + grid[1:, 1:]) / 4
    smooth, at = cv2.GaussianBlur(gray, (3, 3), 0), centres.astype(np.float32)
    value = cv2.remap(smooth, at, None, cv2.INTER_NEAREST)  # type: ignore[call-overload]
    like_first = np.indices(value.shape).sum(axis=0) % 2 == 0
    in_view = np.all((centres >= 0) & (centres <= np.array(gray.shape[::-1]) - 1), axis=-1)
    dark, light = in_view & like_first, in_view & ~like_first

    def contrast(*part: slice | int) -> float:
        """Return by how much the first's like are darker in a part; infinite where too little is in view."""
        if min(dark[part].sum(), light[part].sum()) < 2:
            return np.inf
        return float(value[part][light[part]].mean() - value[part][dark[part]].mean())

    every = slice(None)
    inside = contrast(slice(1, -1), slice(1, -1))
    around = contrast(0), contrast(-1), contrast(every, 0), contrast(every, -1)
    return inside > 0 and min(around) > _LEAST_AROUND * inside


def _blur(gray: Bytes, board: Board, ids: Ints, pixels: Floats) -> float:
    """Return the width of the board's edges [px].

    An edge of contrast C and width w has ∫ |∇I|² = C² / w across it, so that w is C² times the edges' length over the sum of |∇I|².
    Squares of side s have 2 / s of edges a pixel; a marker's come on top, in each view the same share.
    """
    sides = _side_lengths(board, ids, pixels)
    if not len(sides):
        return float("inf")
    side = float(np.median(sides))
    inside = np.zeros(gray.shape, np.uint8)
    cv2.fillConvexPoly(inside, cv2.convexHull(pixels.round().astype(np.int32)), 1)
    values = gray[inside > 0].astype(float)
    contrast = float(np.ptp(np.quantile(values, [0.05, 0.95])))
    down, across = np.gradient(gray.astype(np.float32))
    steep = float(np.sum(down**2 + across**2, where=inside > 0))
    return contrast**2 * len(values) * 2 / side / max(steep, 1e-9)


def _side_lengths(board: Board, ids: Ints, pixels: Floats) -> Floats[N]:
    """Return the lengths of squares' sides [px] whose two corners were found."""
    column, row = np.round(board.points[ids, :2] / board.square_m).astype(int).T
    grid = np.full((row.max() + 1, column.max() + 1, 2), np.nan)
    grid[row, column] = pixels
    sides = (np.linalg.norm(np.diff(grid, axis=axis), axis=-1).ravel() for axis in (0, 1))
    lengths = np.concatenate([*sides])
    return lengths[np.isfinite(lengths)]


_BLURRED = 1.6  # times the camera's median edge width: left out where there are enough others
_THOROUGH_UP_TO = 60  # images: more is a video, where one view less does not matter


Place = tuple[str, int]
"""where a board stood: of a view that is for the lens alone its camera's name, else an empty one; and the frame, which is another
camera's too"""


@dataclass(frozen=True)
class CameraViews:
    """What one camera saw of the board."""

    name: str
    size: tuple[int, int]
    """width, height [px]."""
    views: Mapping[Place, BoardView]
    tried: int = 0
    """images that were searched"""
    where: str = ""
    """files, for messages"""

    @property
    def shared(self) -> dict[Place, BoardView]:
        """Views that are synchronised with the other cameras'."""
        return {place: view for place, view in self.views.items() if not place[0]}


def frames_to_search(sources: Iterable[FrameSource], most: int) -> range:
    """Return the frames to look at in all cameras alike: every one, or every n-th of a long video."""
    count = max((len(source.frames) for source in sources), default=0)
    return range(0, count, max(1, -(-count // most)))


def search_views(
    name: str,
    searched: Iterable[tuple[FrameSource, Iterable[int], bool]],
    board: Board,
    progress: Callable[[], object] = lambda: None,
) -> CameraViews:
    """Return the views of the board that one camera has.

    Parameters
    ----------
    searched
        Its sources, the frames of each, and whether they are for the camera's lens alone.
    progress
        Called after each image; it may raise to stop.

    Raises
    ------
    HandtrackError
        When images of the camera differ in size, or a source has none.
    """
    views = dict[Place, BoardView]()
    size: tuple[int, int] | None = None
    first, tried, where = "", 0, ""
    for source, frames, alone in searched:
        frames = [frame for frame in frames if source.has(frame)]
        before, where = tried, where or source.where
        for frame in frames:
            image = source.read(frame)
            progress()
            if image is None:
                continue
            tried += 1
            here = _name(source, frame)
            found = (image.shape[1], image.shape[0])
            if size is not None and found != size:
                raise HandtrackError(
                    f"{here} is {found[0]} x {found[1]}, but {first} of the same camera is {size[0]} x "
                    f"{size[1]}; expected one size, that of the recordings to be tracked. Leave the "
                    "others out."
                )
            size, first = found, first or here
            view = find_board(image, board, here, len(frames) <= _THOROUGH_UP_TO)
            if view is not None:
                views[name if alone else "", frame] = view
        if tried == before:
            raise HandtrackError(f"camera '{name}': no image could be read from {source.where}.")
    assert size is not None, "a camera has a source"
    return CameraViews(name, size, views, tried, where)


def _name(source: FrameSource, frame: int) -> str:
    path = getattr(source, "path", None)
    return str(path(frame)) if callable(path) else f"{source.where}, frame {frame}"


def natural_order(paths: Iterable[Path]) -> list[Path]:
    """Return files by the numbers in their names: img2 before img10."""
    return sorted(
        paths,
        key=lambda p: [int(t) if t.isdecimal() else t for t in re.split(r"(\d+)", str(p))],
    )


def choose_views(cameras: Sequence[CameraViews], most: int) -> list[CameraViews]:
    """Return the cameras with at most `most` views each: sharp ones, spread over place, size and tilt.

    Frames are chosen once for all cameras, so that views stay common ones.
    """
    sharp = [_without_blurred(camera) for camera in cameras]
    places = _spread_places(sharp, most)
    chosen = []
    for camera in sharp:
        shared = {place: view for place, view in camera.shared.items() if place in places}
        alone = {place: view for place, view in camera.views.items() if place[0]}
        chosen.append(replace(camera, views=shared | _spread(camera, alone, most)))
    return chosen


def _without_blurred(camera: CameraViews) -> CameraViews:
    if len(camera.views) < 12:
        return camera  # too few to be choosy
    limit = _BLURRED * float(np.median([view.blur_px for view in camera.views.values()]))
    return replace(camera, views={p: v for p, v in camera.views.items() if v.blur_px <= limit})


def _spread_places(cameras: Sequence[CameraViews], most: int) -> set[Place]:
    """Return shared places such that each camera has up to `most`; those that more cameras see go first."""
    seen = Counter(place for camera in cameras for place in camera.shared)
    places: set[Place] = set()
    # first per number of cameras: what all see binds the rig together
    for camera in sorted(cameras, key=lambda c: len(c.shared)):
        weight = np.array([seen[place] for place in camera.shared], dtype=float)
        places |= _spread(camera, camera.shared, most, places, weight).keys()
    for camera in cameras:  # others' choices may have brought more than wanted
        extra = [place for place in camera.shared if place in places]
        if len(extra) > 2 * most:
            places -= {p for p in extra[:: max(2, len(extra) // most)] if seen[p] == 1}
    return places


def _descriptions(camera: CameraViews, views: Collection[BoardView]) -> Floats:
    """Return (V, 6) what matters in a view: place, size, tilt; each about 0 to 1."""
    rows = []
    for view in views:
        middle = view.pixels.mean(axis=0)
        spread = view.pixels - middle
        box = np.maximum(np.ptp(view.pixels, axis=0), 1e-9)
        long, short = np.linalg.svd(spread, compute_uv=False) / np.sqrt(len(spread))
        # how much corners crowd to one side, along x and y: the sign of a tilt
        crowded = 4 * (-spread.min(axis=0) / box - 0.5)
        rows.append([*middle / camera.size, 2 * long / camera.size[0], short / long, *crowded])
    return np.array(rows).reshape(len(views), 6)


def _spread(
    camera: CameraViews,
    views: Mapping[Place, BoardView],
    most: int,
    have: Collection[Place] = (),
    weight: Array[N] | float = 1.0,
) -> dict[Place, BoardView]:
    """Return up to `most` views, each next one the farthest from all before, begun with those in the places that there are."""
    if len(views) <= most:
        return dict(views)
    rows, places = _descriptions(camera, views.values()), list(views)
    chosen = [i for i, place in enumerate(places) if place in have]
    if not chosen:
        off = np.linalg.norm(rows - np.median(rows, axis=0), axis=1)
        chosen = [int(np.argmax(weight - 0.1 * off))]
    apart = np.linalg.norm(rows[:, None] - rows, axis=-1)
    while len(chosen) < most:
        distance = apart[chosen].min(axis=0)
        best = int(np.argmax(distance * weight))
        if distance[best] <= 0:
            break
        chosen.append(best)
    return {places[i]: views[places[i]] for i in chosen}


def require_views(
    board: Board,
    cameras: Sequence[CameraViews],
    images: Callable[[CameraViews], list[Array[H, W, *Axes]]],
) -> None:
    """Raise HandtrackError when a camera never saw the board, or it is larger than was said.

    Parameters
    ----------
    images
        Gives a few images of a camera, of those with the board where there are some.
    """
    without = [camera for camera in cameras if not camera.views]
    if not without:
        larger = _seen_size(images(cameras[0]), board)
        if larger is not None:
            raise HandtrackError(
                f"the board is larger than {board.text}: camera '{cameras[0].name}' sees squares beyond its edge "
                f"({next(iter(cameras[0].views.values())).source}); it looks like {larger.columns} x {larger.rows}. Count all inner corners, "
                "where four squares meet."
            )
        return
    tried = sum(camera.tried for camera in without)
    names = ", ".join(f"'{camera.name}'" for camera in without)
    text = (
        f"no {board.text} board was found in any of {tried} images of camera {names} "
        f"({without[0].where})."
    )
    least = replace(board, columns=_LEAST_SIDE, rows=_LEAST_SIDE)
    other = _seen_size([image for camera in without for image in images(camera)], least)
    if other is not None and {other.columns, other.rows} != {board.columns, board.rows}:
        raise HandtrackError(
            f"{text} There is a chessboard of {other.columns} x {other.rows} inner corners: use "
            f"--board {other.text}. Count inner corners, where four squares meet, not squares."
        )
    advice = (
        "The whole board with its white border must be seen, sharp and lit evenly; the size counts inner corners."
        if not board.dictionary
        else "At least eight corners must be seen, sharp; check squares, dictionary and that the print is not mirrored."
    )
    raise HandtrackError(f"{text} {advice}")


def _seen_size(images: Sequence[Array], least: Board) -> Board | None:
    """Return the chessboard that most of the images show; None where it is no larger than the least, or there is none."""
    if least.dictionary or not images:
        return None
    flags = cv2.CALIB_CB_LARGER | cv2.CALIB_CB_NORMALIZE_IMAGE
    sizes = Counter[tuple[int, ...]]()
    for image in images:
        searched, _ = _searched(_grey(image))
        size = least.columns, least.rows
        found, _, meta = cv2.findChessboardCornersSBWithMeta(searched, size, flags)
        sizes[tuple(sorted(meta.shape, reverse=True)) if found else ()] += 1
    largest = sizes.most_common(1)[0][0]
    if not largest or sorted(largest) == sorted(size):
        return None
    return replace(least, columns=largest[0], rows=largest[1])
