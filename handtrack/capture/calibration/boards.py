"""Calibration boards: chessboards and ChArUco boards, written as one short text.

`chessboard:9x6:25mm` has 9 x 6 *inner* corners and squares of 25 mm; `charuco:7x5:30mm:22mm:DICT_4X4_50`
has 7 x 5 *squares* of 30 mm with markers of 22 mm. Board frame: x along a row to the right, y down the
rows, z into the board; origin at the first inner corner of a chessboard, at the outer corner of a
ChArUco board.
"""

from __future__ import annotations

import io
import re
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from PIL import Image

from handtrack.arrays import D3, D4, Bytes, Floats, H, Ints, N, R, W, runs
from handtrack.errors import HandtrackError, unknown_name
from handtrack.files.text_files import UNITS_M

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
    if min(columns, rows) < 3 or max(columns, rows) > 60:
        raise HandtrackError(
            f"board '{text}': {columns} x {rows}; expected 3 to 60 of them along each side."
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
    cells = [
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


def _marker_rectangles(board: Board, margin: float) -> list[tuple[float, ...]]:
    """Return the black bits of all markers, neighbours in a row joined so that no hair lines show."""
    found: list[tuple[float, ...]] = []
    dictionary = board.cv2_dictionary
    modules = dictionary.markerSize + 2
    bit = board.marker_m * 1e3 / modules
    corners = [np.array(c, float).reshape(4, 3) for c in board.cv2_board.getObjPoints()]
    for number, corner in zip(board.cv2_board.getIds().reshape(-1), corners, strict=True):
        black = cv2.aruco.generateImageMarker(dictionary, int(number), modules) < 128
        left, top = corner[:, :2].min(axis=0) * 1e3 + margin
        for r, row in enumerate(black):
            for start, end in runs(row):
                found.append((left + start * bit, top + r * bit, (end - start) * bit, bit))
    return found


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
