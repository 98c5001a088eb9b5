"""Benchmark: the workbench for five minutes with four clients that edit, of whom one comes and goes: memory and handles."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from tests.experiments.workbench.hostile import latencies_ms, pose_sliders
from tests.experiments.workbench.program import RunningWorkbench
from tests.experiments.workbench.wire import WireClient

_MINUTES, _SETTLED = 5.0, 2.0
_CLIENTS, _STAY_S = 4, 5.0
_RATE = 10.0
"""frames scrubbed a second; a pose is set each second, as by a quick person: each is kept, so that it can be undone"""


def soak() -> dict[str, Any]:
    """Return how memory and handles grow after the first two minutes, while clients pose, scrub, and one reconnects."""
    with RunningWorkbench() as program, WireClient(program.url) as first:
        time.sleep(5.0)
        sliders = pose_sliders(first)
        frame = next(one for one in first.widgets() if one["props"].get("label") == "Frame")
        others = [WireClient(program.url) for _ in range(_CLIENTS - 1)]
        began, taken, sent = time.monotonic(), [], 0
        renewed = began
        while (now := time.monotonic()) < began + 60 * _MINUTES:
            for client in (first, *others):
                client.set_value(frame["uuid"], sent % 100)
                if sent % int(_RATE) == 0:
                    slider = sliders[sent // int(_RATE) % len(sliders)]
                    low, high = slider["props"]["min"], slider["props"]["max"]
                    client.set_value(slider["uuid"], low + (high - low) * (sent % 97) / 97)
            sent += 1
            if now - renewed > _STAY_S:
                others.pop().__exit__(None, None, None)
                others.append(WireClient(program.url))
                renewed = now
                taken.append((
                    now - began, program.resident_mb(), program.page_mb(), program.open_files(), program.threads(),
                ))  # fmt: skip
            time.sleep(1 / _RATE)
        waits = latencies_ms(first, sliders[0], 30)
        for client in others:
            client.__exit__(None, None, None)
        settled = np.array([row for row in taken if row[0] > 60 * _SETTLED])
        scale_change, page_growth = 3600 * np.polyfit(settled[:, 0], settled[:, 1:3], 1)[0]
        return {
            "ratio": float(scale_change) / 5.0,
            "reference": "5 MB an hour after ten minutes; here by a line through the last three of five, in which memory still settles",
            "minutes": _MINUTES,
            "memory_settled_mb": float(settled[0, 1]),
            "memory_last_mb": float(settled[-1, 1]),
            "growth_mb_an_hour": float(scale_change),
            "of_this_the_page": float(page_growth),
            "page_last_mb": float(settled[-1, 2]),
            "open_files": f"{int(settled[:, 3].min())} to {int(settled[:, 3].max())}",
            "threads": f"{int(settled[:, 4].min())} to {int(settled[:, 4].max())}",
            "latency_at_the_end_ms": float(np.median(waits)),
        }
