"""A mask as pieces of one value along its rows, made once a frame and shared by the silhouette terms."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from handtrack.arrays import (
    D2,
    D8,
    D24,
    Array,
    Bytes,
    Floats,
    H,
    Ints,
    K,
    L,
    M,
    N,
    W,
    X,
    array_dataclass,
    check_shape,
)
from handtrack.errors import HandtrackError
from handtrack.geometry.camera import Camera
from handtrack.observation.observation import Silhouette
from handtrack.terms.silhouettes.pieces_kernels import fill_pieces, mark_edges


class MaskArrays(NamedTuple):
    """An observation Z as pieces of one value, as compiled sums take it."""

    valid: Array[H, D2]
    """int32: per row the half-open column span that counts."""
    begins: Ints[L]
    """(H + 1,): the pieces of row v, in each of which Z has one value, are begins[v] to begins[v + 1]."""
    ends: Ints[K]
    """the column where each piece ends, and the next begins."""
    values: Floats[K]
    """Z; above 0 where nobody knows, which counts for nothing."""
    edges: Bytes[H, M]
    """(H, W // 8 + 1): a bit for each pixel at which a piece begins, but the first of a row."""
    powers: Floats[N, D8]
    """(2W + 1, 8): sums of x⁰ … x⁴, see `power_sums`."""
    heights: Floats[X, D24]
    """(2H + 1, 24): the powers of y that go with each sum, see `height_powers`."""


@array_dataclass
class PreparedSilhouette:
    """One camera's observation Z, ready for terms. Made by `prepare`, shared by all terms of a frame."""

    camera: Camera
    mask: MaskArrays
    row_energy: Floats[H]
    """Σ Z² over each row's valid pixels."""
    area: float
    """−Σ Z over valid pixels: the mask's area [px]."""
    wider_m: float = 0.0
    """by how much the outline of a hand is farther out in it than the hand's own, all along"""

    @property
    def outline_px(self) -> float:
        """How long the mask's outline is [px]: Crofton, by crossings of rows."""
        begins = self.mask.begins
        rows = np.repeat(np.arange(len(begins) - 1), np.diff(begins))
        crossed = (rows[1:] == rows[:-1]) & (np.abs(np.diff(self.mask.values)) > 0.5)
        return 0.5 * np.pi * float(crossed.sum())

    def energy(self, step: int) -> float:
        """Return Σ Z² over valid pixels, by one row of each `step`."""
        return step * float(self.row_energy[step // 2 :: step].sum())

    def times(self, factor: float) -> PreparedSilhouette:
        """Return the observation factor · Z; factor > 0."""
        return replace(
            self,
            mask=self.mask._replace(values=factor * self.mask.values),
            row_energy=factor**2 * self.row_energy,
            area=factor * self.area,
        )


def prepare(
    silhouette: Silhouette,
    line: Sequence[float] | None = None,
    observation: Array[H, W] | None = None,
) -> PreparedSilhouette:
    """Return a silhouette made ready for ConicFieldTerm and CoverageTerm.

    Parameters
    ----------
    line
        (a, b, c), pixels with a u + b v + c < 0 are not observed, see `clip_spans`.
    observation
        The observed field, ≤ 0, in place of −mask (the 2007 paper's simulated field images).

    Raises
    ------
    HandtrackError
        For wrong shapes and for values that are not finite numbers.
    """
    camera = silhouette.camera
    width, height = camera.size
    where = f"silhouette of camera '{camera.name}'"
    image = silhouette.mask if observation is None else np.asarray(observation, dtype=np.float64)
    check_shape(image, (height, width), where)
    check_shape(silhouette.valid, (height, 2), f"valid spans of the {where}")
    valid = np.clip(silhouette.valid, 0, width).astype(np.int32)
    if line is not None:
        valid = clip_spans(valid, line)
    image = np.ascontiguousarray(image, dtype=np.float32 if observation is None else np.float64)
    begins, edges = np.empty(height + 1, np.int64), np.empty((height, width // 8 + 1), np.uint8)
    count = mark_edges(image, edges, begins)
    ends, values, energy = np.empty(count, np.int64), np.empty(count), np.empty(height)
    sign = -1.0 if observation is None else 1.0
    area = fill_pieces(image, sign, valid, edges, begins, ends, values, energy)
    if not np.isfinite(energy).all():
        raise HandtrackError(
            f"{where}: it holds values that are not finite numbers; expected coverage from 0 to 1 (or a field ≤ 0)."
        )
    powers = power_sums(width), height_powers(height)
    mask = MaskArrays(valid, begins, ends, values, edges, *powers)
    return PreparedSilhouette(camera, mask, energy, float(area))


def clip_spans(valid: Array[H, D2], line: Sequence[float]) -> Array[H, D2]:
    """Return the spans without the pixels where a u + b v + c < 0. line: (a, b, c) [px]."""
    a, b, c = (float(x) for x in line)
    begin, end = valid[:, 0].astype(float), valid[:, 1].astype(float)
    level = b * np.arange(len(valid)) + c
    if a == 0.0:
        end = np.where(level >= 0, end, begin)
    else:
        # the division may round across a whole number: the sum itself decides the pixel next to it
        near = np.rint(-level / a)
        on_pixel = a * near + level >= 0
        if a > 0:
            begin = np.maximum(begin, near + ~on_pixel)
        else:
            end = np.minimum(end, near + on_pixel)
    spans = np.stack([begin, end], axis=1)
    spans[spans[:, 0] >= spans[:, 1]] = 0
    return spans.astype(np.int32)


@lru_cache(maxsize=16)
def power_sums(width: int) -> Floats[K, D8]:
    """Return (2W + 1, 8): row i holds Σ x⁰ … Σ x⁴ over whole x from −W to i − W − 1, and the first three again.

    Exact up to W ≈ 2000.
    """
    x = np.arange(-width, width, dtype=float)
    table = np.zeros((2 * width + 1, 8))
    table[1:] = np.cumsum(x[:, None] ** np.array([0, 1, 2, 3, 4, 0, 1, 2]), axis=0)
    return table


@lru_cache(maxsize=16)
def height_powers(height: int) -> Floats[K, D24]:
    """Return (2H + 1, 24): row j holds, with y = j − H, the power of y in each sum of MOMENTS."""
    y = np.arange(-height, height + 1, dtype=float)[:, None]
    powers = np.array([0, 0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 3, 3, 4, 0, 0, 0, 0, 1, 1, 2, 0, 0])
    table = y**powers
    table[:, [15, 22, 23]] = 0.0
    return table
