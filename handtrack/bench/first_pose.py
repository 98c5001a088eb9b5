"""Benchmarks: processor seconds from the start of `handtrack track` to the first frame, with compiled kernels at hand and without."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from handtrack.session.bundled import bundled_session

_ROUNDS_WARM = 3
_TRACK = "import sys; from handtrack_app.cli import main; sys.exit(main(sys.argv[1:]))"
_IMPORTS = "import cv2, numba, numpy, scipy.optimize, scipy.spatial"


def first_pose_warm() -> dict[str, Any]:
    """Return the processor seconds of the first frame, all kernels compiled by an earlier run; the least of three."""
    with tempfile.TemporaryDirectory() as cache:
        _first_frame(cache)
        return _figures(min(_first_frame(cache) for _ in range(_ROUNDS_WARM)), cache)


def first_pose_cold() -> dict[str, Any]:
    """Return the processor seconds of the first frame on a machine where nothing was compiled before."""
    with tempfile.TemporaryDirectory() as cache:
        _seconds([sys.executable, "-c", f"{_IMPORTS}, handtrack_app.commands.track"], cache)
        return _figures(_first_frame(cache), cache)


def _figures(seconds: float, cache: str) -> dict[str, Any]:
    imports = min(_seconds([sys.executable, "-c", _IMPORTS], cache) for _ in range(_ROUNDS_WARM))
    return {
        "ratio": seconds / imports,
        "ours_s": seconds,
        "reference_s": imports,
        "reference": f"`{_IMPORTS}` in a process of its own; processor seconds of all threads",
    }


def _first_frame(cache: str) -> float:
    with tempfile.TemporaryDirectory() as folder:
        words = [
            "track",
            str(bundled_session("open_fist_open")),
            "--frames",
            "0:1",
            "--out",
            str(Path(folder) / "poses.npz"),
        ]
        return _seconds([sys.executable, "-c", _TRACK, *words], cache)


def _seconds(command: list[str], cache: str) -> float:
    """Return the processor seconds of a process. The folder `cache` keeps kernels, and Python's bytecode as an installer
    would have written it, whatever the environment says of that.
    """
    own = {"NUMBA_CACHE_DIR": cache, "PYTHONPYCACHEPREFIX": str(Path(cache) / "bytecode")}
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"} | own
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(command, env=environment, capture_output=True, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
