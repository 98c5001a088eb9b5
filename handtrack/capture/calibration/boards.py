"""Calibration boards: chessboards and ChArUco boards, written as one short text.

`chessboard:9x6:25mm` has 9 x 6 *inner* corners and squares of 25 mm; `charuco:7x5:30mm:22mm:DICT_4X4_50`
has 7 x 5 *squares* of 30 mm with markers of 22 mm. Board frame: x along a row to the right, y down the
rows, z into the board; origin at the first inner corner of a chessboard, at the outer corner of a
ChArUco board.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import cv2
import numpy as np

from handtrack.arrays import D3, Floats, Ints, N
from handtrack.errors import HandtrackError, unknown_name

EXAMPLES = "chessboard:9x6:25mm (inner corners) or charuco:7x5:30mm:22mm:DICT_4X4_50 (squares)"
_UNIT_M = {"mm": 1e-3, "cm": 1e-2, "m": 1.0}


@dataclass(frozen=True)
class Chessboard:
    """A chessboard of columns x rows inner corners; its square at the upper left is black."""

    columns: int
    rows: int
    square_m: float

    @property
    def text(self) -> str:
        return f"chessboard:{self.columns}x{self.rows}:{_millimetres(self.square_m)}"

    @property
    def squares(self) -> tuple[int, int]:
        """Columns and rows of squares, the outer ones included."""
        return self.columns + 1, self.rows + 1

    @cached_property
    def points(self) -> Floats[N, D3]:
        """(columns * rows, 3) inner corners row by row, board frame [m]."""
        row, column = np.mgrid[: self.rows, : self.columns]
        grid = np.stack([column, row, np.zeros_like(row)], axis=-1)
        return grid.reshape(-1, 3) * self.square_m

    @cached_property
    def turns(self) -> tuple[Ints[N], ...]:
        """Renumberings of the corners that look the same as the board in colour and shape.

        Turned by it, corner i of what is seen is corner `turn[i]` of the board. The first is the
        identity; more than one means the board does not tell how it is turned.
        """
        numbers = np.arange(self.columns * self.rows).reshape(self.rows, self.columns)
        quarter = range(4) if self.columns == self.rows else (0, 2)
        kept = [k for k in quarter if self._keeps_colours(k)]
        return tuple(np.rot90(numbers, k).reshape(-1) for k in kept)

    def _keeps_colours(self, quarter_turns: int) -> bool:
        """Whether the first inner square is black again after some quarter turns."""
        if quarter_turns == 2:
            return (self.columns + self.rows) % 2 == 0
        return quarter_turns == 0 or self.rows % 2 == 0  # of a board with as many rows as columns


@dataclass(frozen=True)
class CharucoBoard:
    """A chessboard of columns x rows squares with an ArUco marker in each white one."""

    columns: int
    rows: int
    square_m: float
    marker_m: float
    dictionary: str

    @property
    def text(self) -> str:
        sizes = f"{_millimetres(self.square_m)}:{_millimetres(self.marker_m)}"
        return f"charuco:{self.columns}x{self.rows}:{sizes}:{self.dictionary}"

    @property
    def squares(self) -> tuple[int, int]:
        """Columns and rows of squares."""
        return self.columns, self.rows

    @property
    def cv2_dictionary(self) -> Any:
        return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, self.dictionary))

    @cached_property
    def cv2_board(self) -> Any:
        size = (self.columns, self.rows)
        return cv2.aruco.CharucoBoard(size, self.square_m, self.marker_m, self.cv2_dictionary)

    @cached_property
    def points(self) -> Floats[N, D3]:
        """((columns − 1) (rows − 1), 3) inner corners by their number, board frame [m]."""
        corners = self.cv2_board.getChessboardCorners()
        return np.array(corners, dtype=float).reshape(-1, 3)

    @property
    def turns(self) -> tuple[Ints[N], ...]:
        """The identity alone: markers tell how the board is turned."""
        return (np.arange(len(self.points)),)


Board = Chessboard | CharucoBoard


def parse_board(text: str) -> Board:
    """Return the board that a text describes. Raises HandtrackError saying what was expected."""
    kind, *parts = text.strip().split(":")
    if kind == "chessboard" and len(parts) == 2:
        columns, rows = _counts(parts[0], text)
        return Chessboard(columns, rows, _length(parts[1], text))
    if kind == "charuco" and len(parts) == 4:
        columns, rows = _counts(parts[0], text)
        square, marker = (_length(part, text) for part in parts[1:3])
        return _charuco(columns, rows, square, marker, parts[3].upper(), text)
    raise HandtrackError(f"board '{text}': expected {EXAMPLES}.")


def _charuco(
    columns: int, rows: int, square: float, marker: float, dictionary: str, text: str
) -> CharucoBoard:
    known = sorted(name for name in dir(cv2.aruco) if name.startswith("DICT_"))
    if dictionary not in known:
        raise unknown_name("marker dictionary", dictionary, known, f"board '{text}'")
    if marker >= square:
        raise HandtrackError(
            f"board '{text}': the marker ({marker * 1e3:g} mm) must be smaller than its square "
            f"({square * 1e3:g} mm); the square comes first."
        )
    board = CharucoBoard(columns, rows, square, marker, dictionary)
    needed, there = (columns * rows) // 2, len(board.cv2_dictionary.bytesList)
    if needed > there:
        raise HandtrackError(
            f"board '{text}': it needs {needed} markers, {dictionary} has {there}; choose a larger "
            "dictionary or fewer squares."
        )
    return board


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
    length = float(found[1]) * _UNIT_M[found[2]]
    if not 1e-3 <= length <= 2.0:
        raise HandtrackError(
            f"board '{text}': a side of {length * 1e3:g} mm; expected 1 mm to 2 m. Is the unit "
            "right?"
        )
    return length


def _millimetres(length_m: float) -> str:
    return f"{length_m * 1e3:.6g}mm"
