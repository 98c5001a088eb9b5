"""Benchmark: what five minutes of a hostile client that knows the token do to the workbench and to an honest client."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from dataclasses import asdict
from typing import Any

import numpy as np

from handtrack.bench.registry import REPOSITORY
from tests.experiments.workbench.attacks import ATTACKS, TargetPage
from tests.experiments.workbench.program import RunningWorkbench
from tests.experiments.workbench.wire import WireClient

_MINUTES = 5.0
_CALM_S = 1.0
"""after an attack, before the honest client's latency is taken"""


def hostile() -> dict[str, Any]:
    """Return the honest client's latency during and 1 s after attacks, memory, widgets that still work, words on the terminal."""
    with RunningWorkbench() as program, WireClient(program.url) as honest:
        time.sleep(5.0)
        sliders = pose_sliders(honest)
        page = TargetPage(program.url, [one["uuid"] for one in honest.widgets()])
        moving = [one for one in sliders if latencies_ms(honest, one, 1)[0] < np.inf]
        quiet = latencies_ms(honest, sliders[0], 30)
        before, words, files = program.resident_mb(), len(program.terminal()), program.open_files()
        during, peak = [], before
        after: dict[str, list[float]] = {name: [] for name in ATTACKS}
        until = time.monotonic() + 60 * _MINUTES
        while time.monotonic() < until:
            for name in ATTACKS:
                attack = started(name, page)
                while attack.poll() is None:
                    during += latencies_ms(honest, sliders[0], 5)
                    peak = max(peak, program.resident_mb())
                time.sleep(_CALM_S)
                after[name] += latencies_ms(honest, sliders[0], 10)
        alive = sum(latencies_ms(honest, one, 1)[0] < np.inf for one in moving)
        answers = np.concatenate(list(after.values()))
        slowest = max(after, key=lambda name: max(after[name]))
        return {
            "ratio": float(answers.max()) / 100.0,
            "reference": "100 ms, 1 s after each attack; ours the slowest answer",
            "quiet_median_ms": float(np.median(quiet)),
            "attacked_median_ms": float(np.median(during)),
            "attacked_slowest_ms": max(during),
            "afterwards_median_ms": float(np.median(answers)),
            "afterwards_slowest_ms": float(answers.max()),
            "slowest_after": slowest,
            "answers_afterwards": len(answers),
            "sliders_that_move_the_hand": f"{alive} of {len(moving)}",
            "memory_before_mb": before,
            "memory_peak_mb": peak,
            "memory_afterwards_mb": program.resident_mb(),
            "open_files_more": program.open_files() - files,
            "characters_on_the_terminal": len(program.terminal()) - words,
        }


def started(name: str, page: TargetPage) -> subprocess.Popen[str]:
    """Return an attack in a process of its own."""
    command = [sys.executable, "-m", "tests.experiments.workbench.attacks", name]
    quiet = subprocess.DEVNULL
    attack = subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=quiet, text=True, cwd=REPOSITORY
    )
    assert attack.stdin is not None
    with attack.stdin:
        json.dump(asdict(page), attack.stdin)
    return attack


def pose_sliders(client: WireClient) -> list[dict[str, Any]]:
    """Return the sliders of joint angles: those in degrees."""
    return [
        one
        for one in client.widgets()
        if one["type"] == "GuiSliderMessage" and one["props"]["label"].endswith("°")
    ]


def latencies_ms(client: WireClient, slider: dict[str, Any], count: int) -> list[float]:
    """Return the time from a slider's message to the moved hand's message [ms]; infinite where none comes within 20 s."""
    props, waits = slider["props"], []
    for _ in range(count):
        part = 0.3 + 0.4 * (time.monotonic() % 1.0)  # another value each time
        sent = client.set_value(slider["uuid"], props["min"] + part * (props["max"] - props["min"]))
        came = client.wait_for(sent, "/hand/flesh", "batched_positions", 20.0)
        waits.append(1e3 * (came - sent) if came is not None else float("inf"))
        time.sleep(0.05)
    return waits
