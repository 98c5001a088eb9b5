"""Compiled loops over the points of a cloud: which cell of a grid each lies in, and whether a ball is near."""

from __future__ import annotations

import numpy as np

from handtrack.compiled import compiled

_SPREAD = np.uint64(0x9E3779B97F4A7C15)  # 2⁶⁴ by the golden ratio (Knuth, TAOCP 3, 6.4)


@compiled
def number_cells(cells):  # pragma: no cover - compiled
    """Return of cells, each a whole number (N,), which one each is, by the order in which they come, and how many of the same came before."""
    bits = 1
    while 1 << bits < 2 * len(cells):
        bits += 1
    held, last = np.full(1 << bits, -1), (1 << bits) - 1  # by hash, where each cell came first
    number, before, met = np.empty_like(cells), np.empty_like(cells), np.zeros_like(cells)
    count = 0
    for n in range(len(cells)):
        slot = np.int64((np.uint64(cells[n]) * _SPREAD) >> np.uint64(64 - bits))
        while held[slot] >= 0 and cells[held[slot]] != cells[n]:
            slot = (slot + 1) & last
        if held[slot] < 0:
            held[slot], number[n] = n, count
            count += 1
        number[n] = number[held[slot]]
        before[n] = met[number[n]]
        met[number[n]] += 1
    return number, before


@compiled
def near_balls(points, balls, reach, found):  # pragma: no cover - compiled
    """Fill found (N,): whether a point (N, 3) lies within reach of one of balls (E, 4), centre and radius."""
    for n in range(points.shape[0]):
        found[n] = False
        for b in range(balls.shape[0]):
            x, y, z = (
                points[n, 0] - balls[b, 0],
                points[n, 1] - balls[b, 1],
                points[n, 2] - balls[b, 2],
            )
            if x * x + y * y + z * z <= (balls[b, 3] + reach) ** 2:
                found[n] = True
                break
