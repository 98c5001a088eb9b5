"""Compiled loop that numbers the cells of a grid in which points lie."""

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
