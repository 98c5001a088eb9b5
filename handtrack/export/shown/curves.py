"""Curves over time as SVG: drawn without a library, readable in light and dark."""

from __future__ import annotations

import html
from collections.abc import Mapping

import numpy as np

from handtrack.arrays import F, Floats

WIDTH, HEIGHT = 860, 130
_LEFT, _RIGHT, _TOP, _BOTTOM = 56, 10, 8, 20
_COLOURS = ("#2b7de0", "#e0702b", "#3fa34d", "#8a63d2", "#c2477f")
_TICKS = 4


def curves(time_s: Floats[F], values: Mapping[str, Floats[F]], unit: str) -> str:
    """Return a picture of curves by name, with their axis; gaps where a value is not finite."""
    known = np.concatenate([column[np.isfinite(column)] for column in values.values()])
    low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, 1.0)
    if high - low < 1e-12:
        low, high = low - 0.5, high + 0.5
    first, last = float(time_s[0]), float(max(time_s[-1], time_s[0] + 1e-9))
    x = _LEFT + (time_s - first) / (last - first) * (WIDTH - _LEFT - _RIGHT)
    span = HEIGHT - _TOP - _BOTTOM
    parts = []
    for tick in _rounded_ticks(low, high):
        y = _TOP + (high - tick) / (high - low) * span
        parts.append(f'<path d="M{_LEFT} {y:.1f}H{WIDTH - _RIGHT}" class="grid"/>')
        parts.append(f'<text x="{_LEFT - 6}" y="{y + 4:.1f}" text-anchor="end">{tick:g}</text>')
    for tick in _rounded_ticks(first, last):
        at = _LEFT + (tick - first) / (last - first) * (WIDTH - _LEFT - _RIGHT)
        parts.append(f'<text x="{at:.1f}" y="{HEIGHT - 5}" text-anchor="middle">{tick:g} s</text>')
    for k, column in enumerate(values.values()):
        y = _TOP + (high - column) / (high - low) * span
        parts.append(f'<path d="{_line(x, y)}" fill="none" stroke="{_colour(k)}"/>')
    named = "".join(
        f'<span><i style="background:{_colour(k)}"></i>{html.escape(name)}</span>'
        for k, name in enumerate(values)
    )
    return (
        f'<figure><figcaption>{named}<span class="soft">[{html.escape(unit)}]</span></figcaption>'
        f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img">{"".join(parts)}</svg></figure>'
    )


def _line(x: Floats[F], y: Floats[F]) -> str:
    words, pen_down = [], False
    for across, down in zip(x, y, strict=True):
        if np.isfinite(down):
            words.append(f"{'L' if pen_down else 'M'}{across:.1f} {down:.1f}")
        pen_down = bool(np.isfinite(down))
    return "".join(words)


def _rounded_ticks(low: float, high: float) -> list[float]:
    """Return a few round numbers within an interval."""
    step = 10.0 ** np.floor(np.log10((high - low) / _TICKS))
    step *= next(m for m in (1, 2, 5, 10) if (high - low) / (m * step) <= _TICKS)
    return [round(k * step, 10) for k in range(int(np.ceil(low / step)), int(high / step) + 1)]


def _colour(index: int) -> str:
    return _COLOURS[index % len(_COLOURS)]
