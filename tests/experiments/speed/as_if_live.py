"""Benchmark: three cameras of 640 × 480 followed as if live, with segmentation by colour and what the page is shown."""

from __future__ import annotations

from typing import Any

from handtrack.bench.measuring import alone

_RATES = ("30", "60")
"""images a second; more than can be followed tells the highest rate"""


def as_if_live() -> dict[str, Any]:
    """Return frames solved a second, dropped ones and the slowest frame, the bundled videos being played as cameras.

    The page's side is the application's, so that it runs in a process of its own, with all cores; its page is not drawn.
    """
    figures = alone("tests.experiments.speed.live_pace", *_RATES, all_cores=True)
    highest = max(figures[f"at_{rate}_fps_solved_a_second"] for rate in _RATES)
    return {
        "ratio": 30.0 / highest,
        "reference": "30 frames a second; ours the highest rate reached",
    } | figures
