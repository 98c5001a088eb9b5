"""Benchmark: a page before 18,000 tracked frames: its own work until it is open, and what ten seconds of playback send and keep.

A real browser, which draws in software here: its frames a second say nothing of one with a GPU, its own work and memory do.
"""

from __future__ import annotations

import tempfile
import time
from collections import defaultdict
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from tests.experiments.workbench.chromium import DRAWN, chromium
from tests.experiments.workbench.long_recording import make_recording
from tests.experiments.workbench.program import RunningWorkbench
from tests.experiments.workbench.wire import WireClient

_FRAMES, _FEW = 18_000, 100
_PLAYED_S, _TIMES, _SETTLED_S = 10.0, 4, 5.0
_LANES = "() => !!document.querySelector('.handtrack-timeline svg polyline')"


def long_page() -> dict[str, Any]:
    """Return the page's work until the recording is shown at a glance, memory after stretches of playback, and bytes a shown frame."""
    few = _short()
    with tempfile.TemporaryDirectory() as name:
        folder = make_recording(Path(name), _FRAMES, truth=False)
        with RunningWorkbench(str(folder)) as program, chromium((1280, 800)) as (page, errors):
            figures: dict[str, Any] = _opened(page, program.url)
            figures |= {f"{name}_of_{_FEW}_frames": value for name, value in few.items()}
            probe = page.context.new_cdp_session(page)
            probe.send("Performance.enable")
            time.sleep(_SETTLED_S)
            page.mouse.click(640, 60)
            kept = [_kept(probe)]
            with WireClient(program.url) as wire:
                time.sleep(_SETTLED_S)
                figures |= _played(page, wire, "_with_pictures")
                kept.append(_kept(probe))
                page.get_by_label("Live images").click()
                page.mouse.click(640, 60)  # keys are for the scene again
                for n in range(_TIMES):
                    figures |= _played(page, wire, "" if n == 0 else "_at_last")
                    kept.append(_kept(probe))
            heap, nodes = np.array(kept).T
            assert not errors, errors
    return {
        "ratio": figures["opened_work_s"] / 3.0,
        "reference": f"3 s of the page's own work until {_FRAMES:,} frames are shown at a glance",
        **figures,
        "heap_mb_before": float(heap[0]),
        "heap_mb_after_each": " ".join(f"{mb:.1f}" for mb in heap[1:]),
        "nodes_before": int(nodes[0]),
        "nodes_after_each": " ".join(f"{count:.0f}" for count in nodes[1:]),
    }


def _short() -> dict[str, float]:
    """Return what opening a short recording takes: all that does not come from the length."""
    with tempfile.TemporaryDirectory() as name:
        folder = make_recording(Path(name), _FEW, truth=False)
        with RunningWorkbench(str(folder)) as program, chromium((1280, 800)) as (page, _):
            return _opened(page, program.url)


def _opened(page: Any, url: str) -> dict[str, float]:
    """Open a page; return how long it took, and the processor time of its own process [s]. What draws in software is another."""
    _warm(url)
    probe = page.context.browser.new_browser_cdp_session()
    before, began = _page_s(probe), time.monotonic()
    page.goto(f"{url}&fixedDpr=0.5")
    page.wait_for_function(DRAWN, arg=["/hand/flesh"], timeout=120_000)
    page.wait_for_function(_LANES, timeout=120_000)
    return {"opened_wall_s": time.monotonic() - began, "opened_work_s": _page_s(probe) - before}


def _page_s(probe: Any) -> float:
    """Return the processor time of the browser's pages so far [s]."""
    told = probe.send("SystemInfo.getProcessInfo")["processInfo"]
    return sum(one["cpuTime"] for one in told if one["type"] == "renderer")


def _warm(url: str) -> None:
    """Wait until the program has the whole recording at hand: what it does before is no work of a page."""
    with WireClient(url) as wire:
        until = time.monotonic() + 120.0
        while time.monotonic() < until and "handtrack-timeline" not in str(wire.messages[-2000:]):
            time.sleep(0.5)
        time.sleep(_SETTLED_S)


def _metrics(probe: Any) -> dict[str, float]:
    return {one["name"]: one["value"] for one in probe.send("Performance.getMetrics")["metrics"]}


def _kept(probe: Any) -> tuple[float, float]:
    """Return what the page keeps once what is not needed is thrown away: heap [MB], nodes of the document."""
    probe.send("HeapProfiler.collectGarbage")
    now = _metrics(probe)
    return now["JSHeapUsedSize"] / 1e6, now["Nodes"]


def _played(page: Any, wire: WireClient, words: str) -> dict[str, float]:
    """Play for a while; return the frames shown a second, and what each sent: bytes on the wire, messages, and of which they are."""
    began, before = time.perf_counter(), wire.bytes_taken
    page.keyboard.press("p")
    time.sleep(_PLAYED_S)
    page.keyboard.press("p")
    taken = wire.bytes_taken - before
    messages = [m for came, m in list(wire.messages) if came > began]
    shown = sum(_changes(m, "/hand/flesh", "batched_positions") for m in messages)
    sizes = defaultdict[str, float](float)
    for message in messages:
        sizes["pictures" if _is_picture(message) else "the rest"] += _size(message)
    shown = max(shown, 1)
    figures = {
        "frames_a_second": shown / _PLAYED_S,
        "bytes_a_frame": taken / shown,
        "messages_a_frame": len(messages) / shown,
    }
    if sizes["pictures"]:
        figures["bytes_a_frame_of_pictures"] = sizes["pictures"] / shown
    return {f"{name}{words}": value for name, value in figures.items()}


def _changes(message: dict[str, Any], name: str, prop: str) -> bool:
    return message.get("name") == name and prop in message.get("updates", {})


def _is_picture(message: dict[str, Any]) -> bool:
    return "_data" in message.get("updates", {}) or "_image_data" in message.get("updates", {})


def _size(message: dict[str, Any]) -> int:
    """Return a message's bytes before it is compressed; pictures are already."""
    return len(msgspec.msgpack.encode(message, enc_hook=lambda array: array.tobytes()))
