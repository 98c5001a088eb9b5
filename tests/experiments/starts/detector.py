"""Benchmark: in how many images of two real recordings the hand detector finds a hand, the processor time of all threads, and what
looking at every n-th image only costs.
"""

from __future__ import annotations

import time
from collections.abc import Iterator

import cv2
import numpy as np

from handtrack.arrays import D3, Array, Floats, H, W
from handtrack.bench.measuring import data_folder, recording
from handtrack.detector.hand_detector import BACKENDS, HandDetector, usual_backend
from handtrack.detector.hand_follower import HandFollower

_RUN, _EVERY = (
    3,
    30,
)  # images in a row: the first is searched, the others are followed; a run begins every so often
_SKIPS = (1, 2, 4)  # images from one that is looked at to the next
_STRETCH, _APART = 9, 60  # images in a row for that, and from one row's begin to the next's
_IN_BOTH = range(18, 367)  # frames of desk_two_view in which the hand is in both views


def detector() -> dict[str, float | str]:
    """Return found [%] by camera, and processor time an image [ms], by the backends that are installed."""
    weights = data_folder() / "hand_detector" / "hand_landmarker.task"
    backends = [b for b in BACKENDS if b == "opencv" or usual_backend() == b]
    figures: dict[str, float | str] = {}
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        for backend in backends:
            network = HandDetector.open(weights, backend)
            spent: dict[str, list[float]] = {"searched": [], "followed": []}
            for name, images in _recordings():
                found = _found(network, images, spent)
                figures[f"{backend}_{name}_found_percent"] = 100 * float(np.mean(found))
                figures[f"{backend}_{name}_images"] = float(len(found))
            figures |= _skipping(network, backend)
            for kind, times in spent.items():
                figures[f"{backend}_{kind}_ms"] = 1e3 * float(np.median(times))
    finally:
        cv2.setNumThreads(threads)
    figures["images"] = (
        f"{_RUN} in a row, every {_EVERY}; of desk_two_view where the hand is in view"
    )
    return figures


def _found(
    network: HandDetector, images: Iterator[list[Array[H, W, D3]]], spent: dict[str, list[float]]
) -> list[bool]:
    found = []
    for run in images:
        follower = HandFollower(network)
        for place, image in enumerate(run):
            start = time.process_time()
            found.append(bool(follower.step(image)))
            spent["followed" if place else "searched"].append(time.process_time() - start)
    return found


def _skipping(network: HandDetector, backend: str) -> dict[str, float | str]:
    """Return for each skip how often a hand is found where it is looked for [%], how far points between (interpolated) are from those
    that looking at each image finds (the median and 90 % of them) [px], and the processor time an image, looked at or not [ms].
    """
    found: dict[int, list[bool]] = {skip: [] for skip in _SKIPS}
    off: dict[int, list[float]] = {skip: [] for skip in _SKIPS}
    spent = dict.fromkeys(_SKIPS, 0.0)
    images = 0
    for _, rows in _recordings(_STRETCH, _APART):
        for row in rows:
            images += len(row) - 1
            each = dict[int, Floats]()
            for skip in _SKIPS:
                follower, seen = HandFollower(network, 1), dict[int, Floats]()
                for place in range(0, len(row), skip):
                    start = time.process_time()
                    hands = follower.step(row[place])
                    spent[skip] += time.process_time() - start if place else 0.0
                    found[skip].append(bool(hands))
                    if hands:
                        (seen[place],) = (hand.points for hand in hands.values())
                each = each or seen
                off[skip] += _interpolated_off(seen, each, skip)
    figures: dict[str, float | str] = {}
    for skip in _SKIPS:
        name = f"{backend}_every_{skip}"
        figures[f"{name}_found_percent"] = 100 * float(np.mean(found[skip]))
        if skip > 1:
            figures[f"{name}_between_px"] = float(np.median(off[skip]))
            figures[f"{name}_between_90_px"] = float(np.percentile(off[skip], 90))
        figures[f"{name}_ms_an_image"] = 1e3 * spent[skip] / images
    return figures


def _interpolated_off(seen: dict[int, Floats], each: dict[int, Floats], skip: int) -> list[float]:
    off: list[float] = []
    for first, points in seen.items():
        after = seen.get(first + skip)
        for place in range(first + 1, first + skip):
            if after is not None and place in each:
                share = (place - first) / skip
                missed = (1 - share) * points + share * after - each[place]
                off += np.linalg.norm(missed, axis=1).tolist()
    return off


def _recordings(
    row: int = _RUN, every: int = _EVERY
) -> Iterator[tuple[str, Iterator[list[Array[H, W, D3]]]]]:
    """Yield recordings by name, as rows of so many images."""
    for view in recording("desk_two_view").views:
        starts = range(_IN_BOTH.start, _IN_BOTH.stop - row, every)
        runs = ([view.image(start + k) for k in range(row)] for start in starts)
        yield f"desk_{view.name}", ([i for i in run if i is not None] for run in runs)
    yield (
        "wall",
        _runs_of(
            cv2.VideoCapture(str(data_folder() / "hand_video_single/human_hand_video.mp4")),
            row,
            every,
        ),
    )


def _runs_of(video: cv2.VideoCapture, row: int, every: int) -> Iterator[list[Array[H, W, D3]]]:
    run: list[Array[H, W, D3]] = []
    number = 0
    while video.grab():
        if number % every < row:
            run.append(video.retrieve()[1])
        if len(run) == row:
            yield run
            run = []
        number += 1
