"""Mask methods: known answers on drawn images, settings read and refused."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import pytest

from handtrack.arrays import Array, Bytes
from handtrack.capture.masks.background import BackgroundMedian, BackgroundMog2
from handtrack.capture.masks.mask_cleaning import clean, inside_roi, largest_component, opened
from handtrack.capture.masks.segmentation import (
    METHODS,
    DepthRange,
    SkinYCrCb,
    mask_method_table,
    read_mask_method,
)
from handtrack.capture.masks.skin_adaptive import SkinAdaptive
from handtrack.errors import HandtrackError

SKIN = (110, 140, 200)  # BGR
DESK = (120, 110, 100)


class Frames:
    """Images in memory as a frame source."""

    where = "drawn"
    size = (80, 60)
    warnings = ()

    def __init__(self, images: list[Array | None]) -> None:
        self._images = images
        self.frames = range(len(images))

    def has(self, frame: int) -> bool:
        return self.read(frame) is not None

    def read(self, frame: int) -> Array | None:
        return self._images[frame] if 0 <= frame < len(self._images) else None


def scene(rng: np.random.Generator, *boxes: tuple[int, int, int, int]) -> Array:
    """A desk with skin-coloured boxes x, y, w, h and a little noise."""
    image = np.full((60, 80, 3), DESK, np.int16)
    for x, y, w, h in boxes:
        image[y : y + h, x : x + w] = SKIN
    return (image + rng.integers(-2, 3, image.shape)).clip(0, 255).astype(np.uint8)


def box_mask(x: int, y: int, w: int, h: int) -> Bytes:
    mask = np.zeros((60, 80), np.uint8)
    mask[y : y + h, x : x + w] = 255
    return mask


HAND, SPECK = (20, 15, 30, 25), (70, 50, 3, 3)


def test_skin_ycrcb_keeps_the_closed_box_of_colours() -> None:
    ycrcb = np.array(
        [[[40, 138, 85], [39, 138, 85], [40, 175, 125], [40, 176, 125], [255, 150, 84]]]
    )
    image = cv2.cvtColor(ycrcb.astype(np.uint8), cv2.COLOR_YCrCb2BGR)
    back = cv2.cvtColor(image, cv2.COLOR_BGR2YCrCb)
    method = SkinYCrCb(open_px=0, largest=False)
    mask = method.segmenter(Frames([]))(image)
    y, cr, cb = np.moveaxis(back.astype(int), -1, 0)
    expected = (y >= 40) & (cr >= 138) & (cr <= 175) & (cb >= 85) & (cb <= 125)
    np.testing.assert_array_equal(mask > 0, expected)
    assert set(np.unique(mask)) <= {0, 255}


def test_skin_ycrcb_finds_the_largest_piece(rng: np.random.Generator) -> None:
    mask = SkinYCrCb(open_px=0).segmenter(Frames([]))(scene(rng, HAND, (60, 5, 8, 8)))
    np.testing.assert_array_equal(mask, box_mask(*HAND))


def test_the_region_of_interest_comes_before_the_largest_piece(rng: np.random.Generator) -> None:
    other = (60, 5, 8, 8)
    segment = SkinYCrCb(open_px=0).segmenter(Frames([]), roi=(55, 0, 25, 60))
    np.testing.assert_array_equal(segment(scene(rng, HAND, other)), box_mask(*other))


@pytest.mark.parametrize("side", [2, 3, 4, 5])
def test_opening_removes_specks_and_shifts_nothing(side: int) -> None:
    mask = box_mask(*HAND)
    mask[50 : 50 + side - 1, 70 : 70 + side - 1] = 255
    np.testing.assert_array_equal(opened(mask, side), box_mask(*HAND))


def test_cleaning_steps() -> None:
    mask = np.maximum(box_mask(*HAND), box_mask(*SPECK))
    np.testing.assert_array_equal(largest_component(mask), box_mask(*HAND))
    np.testing.assert_array_equal(inside_roi(mask, SPECK), box_mask(*SPECK))
    np.testing.assert_array_equal(clean(mask, 0, False, None), mask)
    assert not clean(np.zeros_like(mask), 5, True, None).any()


def test_skin_adaptive_fits_its_sample(rng: np.random.Generator) -> None:
    frames = Frames([None, scene(rng, HAND)])
    method = SkinAdaptive(sample=(25, 20, 10, 10), size=4.0, reference=1)
    bright = (scene(rng, HAND) * 0.8).astype(np.uint8)  # chromaticity does not mind the brightness
    mask = method.segmenter(frames)(bright)
    assert np.mean(mask != box_mask(*HAND)) < 0.005


def test_skin_adaptive_refuses_what_it_cannot_sample(rng: np.random.Generator) -> None:
    with pytest.raises(
        HandtrackError, match=r"takes its sample from frame 3, which is missing; set `ref"
    ):
        SkinAdaptive(sample=(0, 0, 5, 5), reference=3).segmenter(Frames([scene(rng)]))
    with pytest.raises(
        HandtrackError, match=r"sample = \[78, 0, 5, 5\] leaves the image of 80 x 60"
    ):
        SkinAdaptive(sample=(78, 0, 5, 5)).segmenter(Frames([scene(rng)]))


@pytest.mark.parametrize("method", [BackgroundMedian(samples=9), BackgroundMog2(samples=20)])
def test_background_methods_find_what_moves(
    method: BackgroundMedian | BackgroundMog2, rng: np.random.Generator
) -> None:
    images: list[Array | None] = [
        scene(rng, (4 * i % 50, 5 * i % 35, 20, 20)) if i % 7 else scene(rng) for i in range(60)
    ]
    images[3] = None
    segment = method.segmenter(Frames(images))
    box = (4 * 26 % 50, 5 * 26 % 35, 20, 20)
    image = scene(rng, box)
    first = segment(image)
    assert np.mean(first != box_mask(*box)) < 0.02
    for other in images[:20]:
        if other is not None:
            segment(other)
    np.testing.assert_array_equal(segment(image), first)  # no memory of what was asked before


def test_a_background_needs_frames(rng: np.random.Generator) -> None:
    with pytest.raises(
        HandtrackError, match=r"drawn: a background needs at least 3 readable.*found 2"
    ):
        BackgroundMedian().segmenter(Frames([scene(rng), None, scene(rng)]))


def test_depth_range_is_in_metres_and_ignores_zero() -> None:
    depth = np.array([[0, 2999, 3000, 6000, 6001]], np.uint16)
    segment = DepthRange(near_m=0.3, far_m=0.6).segmenter(Frames([]), unit_m=0.0001)
    np.testing.assert_array_equal(segment(depth), [[0, 0, 255, 255, 0]])


SETTINGS: list[dict[str, Any]] = [
    {
        "method": "skin_ycrcb",
        "y_min": 50,
        "cr": [130, 170],
        "cb": [80, 120],
        "open_px": 3,
        "largest": False,
    },
    {"method": "skin_adaptive", "sample": [1, 2, 30, 40], "size": 2.5},
    {"method": "background_median", "samples": 9, "threshold": 5.0},
    {"method": "background_mog2", "shadows": False},
    {"method": "depth_range", "near_m": 0.2, "far_m": 0.9},
    {"method": "seeded", "samples": 9, "sure": 0.8},
]


@pytest.mark.parametrize("table", SETTINGS, ids=lambda table: table["method"])
def test_settings_read_and_write_back(table: dict[str, Any]) -> None:
    method = read_mask_method(table, "session.toml")
    written = mask_method_table(method)
    assert read_mask_method({k: _plain(v) for k, v in written.items()}, "session.toml") == method
    for key, value in table.items():
        assert _plain(written[key]) == value


def _plain(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) else value


def test_every_method_of_the_contract_exists() -> None:
    assert set(METHODS) == {table["method"] for table in SETTINGS}


BAD: dict[str, tuple[Any, str]] = {
    "unknown method": (
        {"method": "magic"},
        "s.toml: unknown mask method 'magic'; known methods: skin_ycrcb, skin_adaptive, "
        "background_mog2",
    ),
    "unknown key": (
        {"method": "skin_ycrcb", "ymin": 3},
        "\"skin_ycrcb\": unknown key 'ymin'; known keys: method, y_min, cr, cb, open_px, largest",
    ),
    "no method": ({"y_min": 3}, "the key 'method' is missing"),
    "no table": (3, "expected a table of settings, found 3"),
    "range": (
        {"method": "skin_ycrcb", "cr": [175, 138]},
        "cr = .175, 138.; expected least and most",
    ),
    "range type": ({"method": "skin_ycrcb", "cb": [85]}, "cb = .85.; expected 2 whole numbers"),
    "flag": ({"method": "skin_ycrcb", "largest": 1}, "largest = 1; expected true or false"),
    "opening": (
        {"method": "skin_ycrcb", "open_px": -1},
        "open_px = -1; expected a whole number of at",
    ),
    "no sample": ({"method": "skin_adaptive"}, "the key 'sample' is missing"),
    "sample": (
        {"method": "skin_adaptive", "sample": [-1, 0, 5, 5]},
        "sample = .*expected a box of at",
    ),
    "threshold": (
        {"method": "background_median", "threshold": 0},
        "threshold = 0; expected a number",
    ),
    "samples": ({"method": "background_mog2", "samples": 2}, "samples = 2; .* of at least 3"),
    "far": (
        {"method": "depth_range", "near_m": 0.5, "far_m": 0.4},
        "far_m = 0.4; expected a number above 0.5",
    ),
    "nan": (
        {"method": "depth_range", "near_m": float("nan"), "far_m": 1},
        "near_m = nan; expected a num",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_settings_are_refused(case: str) -> None:
    table, message = BAD[case]
    with pytest.raises(HandtrackError, match=message):
        read_mask_method(table, "s.toml")
