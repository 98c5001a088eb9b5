"""A small drawing of lines, areas and words, written as SVG, or as PNG with the same things in the same places."""

from __future__ import annotations

import html
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

INK = "ink"
"""the colour of words and axes: it is the page's, or black"""
_BLACK, _SCALE = "#1a1a1a", 2  # pixels of a PNG for a unit
_DASH = 5.0
_ASCII = str.maketrans({"°": "deg", "±": "+-", "–": "-", "σ": "sd", "²": "2"})  # OpenCV's letters
Point = tuple[float, float]


@dataclass(frozen=True)
class Line:
    """A line through points."""

    points: Sequence[Point]
    colour: str
    width: float = 1.5
    dashed: bool = False


@dataclass(frozen=True)
class Area:
    """A filled area."""

    points: Sequence[Point]
    colour: str
    opacity: float = 1.0


@dataclass(frozen=True)
class Words:
    """Words that begin, end, or have their middle at a point."""

    x: float
    y: float
    text: str
    size: float = 10.0
    anchor: str = "start"
    """`start`, `middle` or `end`"""
    colour: str = INK
    bold: bool = False


Part = Line | Area | Words


@dataclass(frozen=True)
class Drawing:
    """Parts on a sheet; y is down."""

    width: float
    height: float
    parts: Sequence[Part]

    def svg(self, ink: str = _BLACK, ground: str = "") -> str:
        """Return it as SVG. ground: the sheet's colour; empty: none."""
        sheet = f"<rect width='100%' height='100%' fill='{ground}'/>" if ground else ""
        drawn = "".join(_svg_of(part, ink) for part in self.parts)
        return (
            f"<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 {self.width:g} {self.height:g}' width='{self.width:g}' "
            f"height='{self.height:g}' font-family='sans-serif'>{sheet}{drawn}</svg>"
        )

    def png(self) -> bytes:
        """Return it as PNG, black on white, two pixels for a unit."""
        import cv2  # slow to import

        shape = round(_SCALE * self.height), round(_SCALE * self.width), 3
        image = np.full(shape, 255, np.uint8)
        for part in self.parts:
            if isinstance(part, Words):
                _write(image, part)
            elif isinstance(part, Area):
                over = image.copy()
                cv2.fillPoly(over, [_pixels(part.points)], _bgr(part.colour), cv2.LINE_AA)
                cv2.addWeighted(over, part.opacity, image, 1 - part.opacity, 0, image)
            else:
                width = max(round(_SCALE * part.width), 1)
                for piece in _dashes(part):
                    cv2.polylines(
                        image, [_pixels(piece)], False, _bgr(part.colour), width, cv2.LINE_AA
                    )
        done, data = cv2.imencode(".png", image)
        assert done
        return data.tobytes()


def _svg_of(part: Part, ink: str) -> str:
    colour = ink if part.colour == INK else part.colour
    if isinstance(part, Words):
        weight = " font-weight='bold'" if part.bold else ""
        return (
            f"<text x='{part.x:.1f}' y='{part.y:.1f}' font-size='{part.size:g}' text-anchor='{part.anchor}' "
            f"fill='{colour}'{weight}>{html.escape(part.text)}</text>"
        )
    points = " ".join(f"{x:.1f},{y:.1f}" for x, y in part.points)
    if isinstance(part, Area):
        return f"<polygon points='{points}' fill='{colour}' fill-opacity='{part.opacity:g}'/>"
    dash = f" stroke-dasharray='{_DASH:g}'" if part.dashed else ""
    return (
        f"<polyline points='{points}' fill='none' stroke='{colour}' stroke-width='{part.width:g}' stroke-linejoin='round'"
        f"{dash}/>"
    )


def _write(image: np.ndarray[tuple[int, ...], np.dtype[np.uint8]], words: Words) -> None:
    import cv2

    text = words.text.translate(_ASCII).encode("ascii", "replace").decode()
    scale, thick = _SCALE * words.size / 28.0, 2 if words.bold else 1
    (width, _), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, scale, thick)
    x = _SCALE * words.x - {"start": 0.0, "middle": 0.5, "end": 1.0}[words.anchor] * width
    place = round(x), round(_SCALE * words.y)
    colour = _bgr(words.colour)
    cv2.putText(image, text, place, cv2.FONT_HERSHEY_SIMPLEX, scale, colour, thick, cv2.LINE_AA)


def _pixels(points: Sequence[Point]) -> np.ndarray[tuple[int, ...], np.dtype[np.int32]]:
    return np.rint(_SCALE * np.asarray(points, dtype=float)).astype(np.int32)


def _bgr(colour: str) -> tuple[int, int, int]:
    shown = _BLACK if colour == INK else colour
    red, green, blue = (int(shown[i : i + 2], 16) for i in (1, 3, 5))
    return blue, green, red


def _dashes(line: Line) -> list[Sequence[Point]]:
    """Return a dashed line's pieces; a whole line's is itself."""
    points = np.asarray(line.points, dtype=float)
    if not line.dashed or len(points) < 2:
        return [line.points]
    along = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))]
    found: list[Sequence[Point]] = []
    for begin in np.arange(0.0, along[-1], 2 * _DASH):
        at = np.linspace(begin, min(begin + _DASH, along[-1]), 3)
        found.append(list(zip(np.interp(at, along, points[:, 0]), np.interp(at, along, points[:, 1]), strict=True)))  # fmt: skip
    return found
