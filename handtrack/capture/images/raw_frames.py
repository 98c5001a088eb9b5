"""Numbered files of raw Bayer mosaics as colour images, with green along the estimated level line as in the 2004 paper (§2.2).

Green pixels form a quincunx: the four neighbours of a pixel without green are a square that stands on
its corner. The paper names them P1 P2 / P3 P4, estimates the gradient (Δx, Δy) of the square, and takes
the line of equal brightness through the wanted point, (−Δy, Δx). It cuts the square's sides in P' and
P''; both are interpolated along their sides, and the point between them. Red and blue stay linear.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np

from handtrack.arrays import D3, Array, Axes, Bytes, Floats, H, K, L, W
from handtrack.capture.images.frames import RAW, ImageFiles
from handtrack.errors import HandtrackError, unknown_name

PATTERNS = ("RGGB", "BGGR", "GRBG", "GBRG")
METHODS = ("library", "library_vng", "bilinear", "level_line", "level_line_hue")
# OpenCV names a pattern by its second row's second and third pixel.
_CV2_NAME = {"RGGB": "BG", "BGGR": "RG", "GRBG": "GB", "GBRG": "GR"}
_AROUND = 4  # [px] border added for the library, which only copies its outermost pixels
_PLACES = ((0, 0), (0, 1), (1, 0), (1, 1))


def demosaic(mosaic: Array[H, W], pattern: str, method: str = "library") -> Array[H, W, D3]:
    """Return the colour image BGR of a raw mosaic, uint8 or uint16, same type.

    Methods: `library` (OpenCV's edge-aware one), `library_vng` (8 bit only), `bilinear`,
    `level_line` (the paper's), `level_line_hue` (its green, and red and blue by their differences
    to it: our extension).

    Parameters
    ----------
    pattern
        Colours of the first 2 x 2 pixels, row by row.

    Raises
    ------
    HandtrackError
        For what is no mosaic.
    """
    check_mosaic(mosaic, pattern)
    if method in ("library", "library_vng"):
        return _library(mosaic, pattern, method)
    if method not in METHODS:
        raise unknown_name("method", method, METHODS)
    values = mosaic.astype(np.float64)
    masks = {colour: _mask(mosaic.shape, pattern, colour) for colour in "BGR"}
    green = (
        _averaged(values, masks["G"]) if method == "bilinear" else level_line_green(values, pattern)
    )
    base = green if method == "level_line_hue" else 0.0
    blue, red = (_averaged(values - base, masks[colour]) + base for colour in "BR")
    image = np.stack([blue, green, red], axis=-1)
    most = np.iinfo(mosaic.dtype).max
    return np.clip(np.round(image), 0, most).astype(mosaic.dtype)


def level_line_green(mosaic: Floats[H, W], pattern: str) -> Floats[H, W]:
    """Return green at every pixel: as seen where it was seen, along the level line elsewhere."""
    padded = np.pad(np.asarray(mosaic, dtype=float), 1, mode="reflect")
    # the square on its corner, turned so that its corners read P1 P2 / P3 P4
    p1, p2 = padded[1:-1, :-2], padded[:-2, 1:-1]  # left, above
    p3, p4 = padded[2:, 1:-1], padded[1:-1, 2:]  # below, right
    middle = np.full(mosaic.shape, 0.5)
    found = _on_level_line((p1, p2, p3, p4), middle, middle)
    return np.where(_mask(mosaic.shape, pattern, "G"), mosaic, found)


def level_line_at(
    image: Array[H, W, *Axes], x: Floats[K, L], y: Floats[K, L]
) -> Floats[K, L, *Axes]:
    """Return the values of an image, of any number of channels, at real coordinates [px]: along the level line of the square of
    four pixels around each, by the paper's rule for any place.

    The line through the place leaves the square in P' and P''; both are interpolated along their sides, and the place between
    them by distance. Outside the image its border is repeated.
    """
    height, width = image.shape[:2]
    x, y = np.clip(x, 0, width - 1), np.clip(y, 0, height - 1)
    column = np.minimum(x.astype(np.intp), width - 2)
    row = np.minimum(y.astype(np.intp), height - 2)
    u, v = x - column, y - row
    found = [
        _on_level_line([plane[row + j, column + i].astype(float) for j, i in _PLACES], u, v)
        for plane in np.moveaxis(image.reshape(height, width, -1), -1, 0)
    ]
    return np.stack(found, axis=-1).reshape(*x.shape, *image.shape[2:])


def _on_level_line(corners: Sequence[Floats], u: Floats, v: Floats) -> Floats:
    """Return the values at (u, v) from 0 to 1 of squares with the corners P1, P2, P3, P4."""
    p1, p2, p3, p4 = corners
    along_x, along_y = -((p3 - p1) + (p4 - p2)), (p2 - p1) + (p4 - p3)  # (−Δy, Δx), twice
    along_x = np.where((along_x == 0) & (along_y == 0), 1.0, along_x)  # flat: any line will do

    def remedy(sign: float) -> Floats:
        """Return how far along the line the square ends, in units of its direction."""
        with np.errstate(divide="ignore", invalid="ignore"):
            across = ((sign * along_x > 0) - u) / (sign * along_x)
            down = ((sign * along_y > 0) - v) / (sign * along_y)
        return np.minimum(
            np.where(along_x != 0, across, np.inf), np.where(along_y != 0, down, np.inf)
        )

    def on_side(direction: Floats) -> Floats:
        """Return the value where the line ends: linear between two corners, for it lies on a side."""
        a, b = (
            np.clip(u + direction * along_x, 0.0, 1.0),
            np.clip(v + direction * along_y, 0.0, 1.0),
        )
        above, below = p1 + (p2 - p1) * a, p3 + (p4 - p3) * a
        return above + (below - above) * b

    ahead, behind = remedy(1.0), remedy(-1.0)
    share = ahead / np.maximum(ahead + behind, 1e-300)
    return on_side(ahead) * (1.0 - share) + on_side(-behind) * share


def check_mosaic(mosaic: Array[*Axes], pattern: str) -> None:
    """Raise HandtrackError unless an array can be a mosaic of the pattern."""
    if pattern not in PATTERNS:
        raise unknown_name("Bayer pattern", pattern, PATTERNS)
    if mosaic.ndim == 3:
        raise HandtrackError(
            f"a raw mosaic has one channel; found an image of shape {mosaic.shape}. It is colour "
            "already, or was read as colour: read it unchanged."
        )
    if mosaic.ndim != 2 or min(mosaic.shape) < 4:
        raise HandtrackError(f"a raw mosaic has at least 4 x 4 pixels; found shape {mosaic.shape}.")
    if mosaic.dtype not in (np.uint8, np.uint16):
        raise HandtrackError(
            f"a raw mosaic has 8 or 16 bits a pixel; found {mosaic.dtype}. Packed 10 or 12 bits must be "
            "unpacked to 16 first."
        )


def mosaic_warnings(mosaic: Array[H, W], pattern: str) -> tuple[str, ...]:
    """Return what speaks against a mosaic of this pattern, in plain sentences.

    The two green pixels of each 2 x 2 block resemble each other more than red and blue do; a grey image
    has all four alike. Red and blue exchanged cannot be seen from numbers: look at the colours.
    """
    check_mosaic(mosaic, pattern)
    main, other = _diagonal_differences(mosaic.astype(float))
    if max(main, other) < 2 * min(main, other) or max(main, other) < 0.01 * float(mosaic.mean()):
        return (
            "the image may be no mosaic (grey, or colour made grey): the pixels of each 2 x 2 block differ "
            "as little along one diagonal as along the other, where red and blue should.",
        )
    green_on_main = main < other
    if green_on_main != (pattern[0] == "G"):
        likely = "GRBG or GBRG" if green_on_main else "RGGB or BGGR"
        return (
            f"the pattern {pattern} looks wrong: the green pixels seem to lie as in {likely}; the image would "
            "show a maze of dots.",
        )
    return ()


def _diagonal_differences(values: Floats) -> tuple[float, float]:
    """Return how much the two colours on the main and on the other diagonal of the blocks differ.

    Each pixel against its four diagonal neighbours, so that slopes cancel; averaged with its sign over
    16 x 16 pixels, so that texture does.
    """
    diagonal = np.array([[1, 0, 1], [0, 0, 0], [1, 0, 1]]) / 4
    off = values - cv2.filter2D(values, -1, diagonal, borderType=cv2.BORDER_REFLECT_101)
    local = [cv2.blur(off[row::2, column::2], (8, 8)) for row, column in ((0, 0), (0, 1))]
    return float(np.abs(local[0]).mean()), float(np.abs(local[1]).mean())


def _library(mosaic: Array, pattern: str, method: str) -> Array:
    if method == "library_vng" and mosaic.dtype != np.uint8:
        raise HandtrackError(
            "the method library_vng takes 8 bits a pixel; found 16. Use library, or level_line."
        )
    kind = "EA" if method == "library" else "VNG"
    code = getattr(cv2, f"COLOR_Bayer{_CV2_NAME[pattern]}2BGR_{kind}")
    shift = _vng_shift() if kind == "VNG" else 0
    height, width = mosaic.shape
    # mirrored about the border's pixels, which keeps the pattern's phase
    padded = np.pad(mosaic, _AROUND, mode="reflect")
    colour = np.asarray(cv2.demosaicing(padded, code))
    return colour[_AROUND + shift : _AROUND + shift + height, _AROUND : _AROUND + width].copy()


@lru_cache(maxsize=1)
def _vng_shift() -> int:
    """Return by how many rows this OpenCV's VNG moves the picture down: 2 before 4.12 (its issue 27225)."""
    step = np.zeros((32, 32), np.uint8)
    step[16:] = 200
    green = cv2.demosaicing(step, cv2.COLOR_BayerBG2BGR_VNG)[:, 16, 1]
    return int(np.argmax(green > 100)) - 16


def _mask(shape: tuple[int, ...], pattern: str, colour: str) -> Array:
    """Return (H, W) bool: where the sensor saw a colour."""
    mask = np.zeros(shape, dtype=bool)
    for (row, column), here in zip(_PLACES, pattern):
        if here == colour:
            mask[row::2, column::2] = True
    return mask


def _averaged(values: Floats, mask: Array) -> Floats:
    """Return values where they are known, elsewhere the mean of the known ones among 8 neighbours.

    Nearer neighbours, those along an edge, before diagonal ones, as in linear interpolation.
    """
    weight = np.array([[1, 2, 1], [2, 4, 2], [1, 2, 1]], dtype=float)
    border = cv2.BORDER_REFLECT_101  # keeps the pattern's phase
    known = cv2.filter2D(mask.astype(float), -1, weight, borderType=border)
    total = cv2.filter2D(np.where(mask, values, 0.0), -1, weight, borderType=border)
    return np.where(mask, values, total / np.maximum(known, 1e-12))


_WHITE_PERCENTILE = 99.5  # 10 or 12 bits in 16, dark or bright; single hot pixels do not count
_EIGHT_BIT = 255.0


class MosaicFiles(ImageFiles):
    """Numbered raw files (H, W), 8 or 16 bits, as images (H, W, 3) uint8 BGR."""

    def __init__(
        self,
        paths: Iterable[Path],
        pattern: str,
        white_level: float | None = None,
        method: str | None = None,
        expected_size: tuple[int, int] | None = None,
        where: str = "",
        in_order: bool = False,
    ) -> None:
        """pattern: colours of the first 2 x 2 pixels, row by row: RGGB, BGGR, GRBG or GBRG. white_level: the value that becomes 255;
        None: 255 of 8 bit files, and of 16 bit ones the level that the brightest half per cent of the first readable file exceeds; the
        same for all frames, so that colours stay. method: how the missing colours are found, see `demosaic`.
        """
        super().__init__(paths, RAW, expected_size, where, in_order)
        self._pattern, self._method = pattern, method or METHODS[0]
        self._said_white = white_level
        self._seen: tuple[float, tuple[str, ...]] | None = None
        """what `_look` found, once a file was read"""

    @property
    def warnings(self) -> tuple[str, ...]:
        return (*super().warnings, *(self._seen[1] if self._seen else ()))

    def read(self, frame: int) -> Bytes[H, W, D3] | None:
        """Return the image of a frame, None where there is none. Raises HandtrackError for what is no mosaic."""
        mosaic = super().read(frame)
        if mosaic is None:
            return None
        if self._seen is None:
            self._seen = self._look()
        try:
            colour = demosaic(mosaic, self._pattern, self._method)
        except HandtrackError as error:
            raise HandtrackError(f"{self.path(frame)}: {error}") from None
        if colour.dtype == np.uint8 and self._said_white is None:
            return colour
        return np.clip(colour * (_EIGHT_BIT / self._seen[0]), 0, 255).astype(np.uint8)

    def _look(self) -> tuple[float, tuple[str, ...]]:
        """Return the white level, and what speaks against the pattern, by the first readable file."""
        for frame in self.frames:
            mosaic = super().read(frame)
            if mosaic is None:
                continue
            path = self.path(frame)
            try:
                warnings = mosaic_warnings(mosaic, self._pattern)
            except HandtrackError as error:
                raise HandtrackError(f"{path}: {error}") from None
            usual = max(float(np.percentile(mosaic, _WHITE_PERCENTILE)), 1.0)
            return self._said_white or usual, tuple(f"{path}: {text}" for text in warnings)
        return 1.0, ()
