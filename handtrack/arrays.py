"""Types of arrays, which say their axes (`Floats[N, D3]`), what is made of them, and a check of shapes where they enter."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias, TypeVar, TypeVarTuple, dataclass_transform

import numpy as np

from handtrack.errors import HandtrackError

Shape = TypeVarTuple("Shape")
Floats = np.ndarray[tuple[*Shape], np.dtype[np.floating[Any]]]  # pyright: ignore[reportInvalidTypeArguments]
Ints = np.ndarray[tuple[*Shape], np.dtype[np.integer[Any]]]  # pyright: ignore[reportInvalidTypeArguments]
Bytes = np.ndarray[tuple[*Shape], np.dtype[np.uint8]]  # pyright: ignore[reportInvalidTypeArguments]
Array = np.ndarray[tuple[*Shape], np.dtype[Any]]  # pyright: ignore[reportInvalidTypeArguments]
"""of any kind: booleans, bytes or floats, words"""

# An axis is a letter. For the type checker each is a number, so that it counts axes; in one signature, or one dataclass,
# equal letters are equal lengths.
Axis: TypeAlias = int
Axes: TypeAlias = tuple[Any, ...]
"""`*Axes`: any axes, or none"""
P = S = Axis
"""solver parameters, joint parameters"""
B = J = E = Axis
"""bones, joints, ellipsoids"""
V = T = Axis
"""vertices and triangles of a mesh"""
C = F = H = W = Axis
"""cameras; frames; rows and columns of an image"""
X = Y = Z = Axis
"""cells of a grid in space"""
K = L = M = N = Q = R = Axis
"""as many as there are: N points, rows or poses, M others"""
P2 = Axis
"""2 P: places and velocities"""
D2 = D3 = D4 = D5 = D6 = D7 = D8 = D9 = D12 = D13 = D16 = D21 = D24 = Axis
"""just so many: D3 are x, y, z; D21 the keypoints of a hand"""


_Class = TypeVar("_Class", bound=type)


@dataclass_transform(eq_default=False, frozen_default=True, field_specifiers=(field,))
def array_dataclass(own: _Class) -> _Class:
    """Make a class data that nobody changes, compared and hashed by identity: of arrays there is no plain equality."""
    return dataclass(frozen=True, eq=False)(own)


def check_shape(array: Array[*Axes], shape: tuple[int | None, ...], name: str) -> None:
    """Raise HandtrackError unless `array` has `shape`; None stands for any length."""
    fits = array.ndim == len(shape) and all(
        want is None or want == have for want, have in zip(shape, array.shape, strict=True)
    )
    if not fits:
        expected = "(" + ", ".join("any" if n is None else str(n) for n in shape) + ")"
        raise HandtrackError(f"{name}: expected an array of shape {expected}, found {array.shape}")


def contiguous(*arrays: Floats[*Axes]) -> tuple[Floats[*Axes], ...]:
    """Return arrays as compiled sums take them: so these are compiled for one kind of array only."""
    return tuple(np.ascontiguousarray(array, dtype=float) for array in arrays)


def pixel_grid(size: tuple[int, int]) -> Floats[H, W, D2]:
    """Return column and row of each pixel of an image of (width, height)."""
    return np.stack(np.meshgrid(np.arange(float(size[0])), np.arange(float(size[1]))), axis=-1)


def indices(known: Sequence[Any], wanted: Iterable[Any]) -> list[int]:
    """Return where each of those wanted stands among the known ones."""
    return [known.index(one) for one in wanted]


def runs(marked: Array[N]) -> list[list[int]]:
    """Return begin and end, half-open, of each stretch of true."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], np.asarray(marked, int), [0]])))
    return edges.reshape(-1, 2).tolist()


def number_runs(numbers: Iterable[int]) -> list[tuple[int, int]]:
    """Return where whole numbers, each once, follow one another: half-open, ascending."""
    found: list[tuple[int, int]] = []
    for number in sorted(numbers):
        first = found.pop()[0] if found and found[-1][1] == number else number
        found.append((first, number + 1))
    return found


def evenly_spread(count: int, most: int) -> list[int]:
    """Return all rows of `count`, or at most so many, evenly spread from the first to the last."""
    return np.unique(np.linspace(0, count - 1, most).round().astype(int)).tolist() if count else []
