"""Type names for arrays with shapes in words, and a check of shapes where arrays enter."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from handtrack.errors import HandtrackError

Floats = NDArray[np.floating[Any]]
Ints = NDArray[np.integer[Any]]
Bytes = NDArray[np.uint8]
Array = NDArray[Any]


def check_shape(array: Array, shape: tuple[int | None, ...], name: str) -> None:
    """Raise HandtrackError unless `array` has `shape`; None stands for any length."""
    fits = array.ndim == len(shape) and all(
        want is None or want == have for want, have in zip(shape, array.shape, strict=True)
    )
    if not fits:
        expected = "(" + ", ".join("any" if n is None else str(n) for n in shape) + ")"
        raise HandtrackError(f"{name}: expected an array of shape {expected}, found {array.shape}")
