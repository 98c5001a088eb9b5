"""Benchmark: in how many images of two real recordings the hand detector finds a hand, and the processor time of all threads."""

from __future__ import annotations

import time
from collections.abc import Iterator

import cv2
import numpy as np

from handtrack.arrays import D3, Array, H, W
from handtrack.bench.measuring import data_folder, recording
from handtrack.detector.hand_detector import HandDetector
from handtrack.detector.hand_follower import HandFollower
from handtrack.detector.networks import BACKENDS, usual_backend

_RUN, _EVERY = (
    3,
    30,
)  # images in a row: the first is searched, the others are followed; a run begins every so often
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


def _recordings() -> Iterator[tuple[str, Iterator[list[Array[H, W, D3]]]]]:
    for view in recording("desk_two_view").views:
        starts = range(_IN_BOTH.start, _IN_BOTH.stop - _RUN, _EVERY)
        runs = ([view.image(start + k) for k in range(_RUN)] for start in starts)
        yield f"desk_{view.name}", ([i for i in run if i is not None] for run in runs)
    yield (
        "wall",
        _runs_of(cv2.VideoCapture(str(data_folder() / "hand_video_single/human_hand_video.mp4"))),
    )


def _runs_of(video: cv2.VideoCapture) -> Iterator[list[Array[H, W, D3]]]:
    run: list[Array[H, W, D3]] = []
    number = 0
    while video.grab():
        if number % _EVERY < _RUN:
            run.append(video.retrieve()[1])
        if len(run) == _RUN:
            yield run
            run = []
        number += 1
