"""What benchmarks share: recordings, one thread, functions timed in turns."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from functools import wraps
from pathlib import Path
from typing import Any

import numpy as np

from handtrack.arrays import Floats
from handtrack.bench.registry import REPOSITORY
from handtrack.errors import HandtrackError
from handtrack.session.session import Session

_BLAS_ALONE = {f"{name}_NUM_THREADS": "1" for name in ("OPENBLAS", "OMP", "MKL", "VECLIB")}


def data_folder() -> Path:
    """Return the folder of the shared data: HANDTRACK_DATA, or ../shared/data beside the checkout."""
    beside = REPOSITORY.parent / "shared" / "data"
    folder = Path(os.environ.get("HANDTRACK_DATA") or beside)
    if not folder.is_dir():
        raise HandtrackError(
            f"no shared test data at {folder}; set the environment variable HANDTRACK_DATA to its folder."
        )
    return folder


def recording(name: str) -> Session:
    """Return a session of the shared data."""
    return Session.open(data_folder() / "sessions" / name)


def alone(measure: Callable[..., dict[str, Any]]) -> Callable[..., dict[str, Any]]:
    """Let a function that returns figures run in a process of its own. BLAS has one thread there, and all else too, or as many as
    `threads` says; as many as usual where that is empty.
    """

    @wraps(measure)
    def outside(*given: Any, threads: str = "1") -> dict[str, Any]:
        module, name = measure.__module__, measure.__name__
        call = f"{name}.__wrapped__(*{given!r})"
        own = {"NUMBA_NUM_THREADS": threads, "HANDTRACK_THREADS": threads} if threads else {}
        done = subprocess.run(
            [
                sys.executable,
                "-c",
                f"import json; from {module} import {name}; print(json.dumps({call}))",
            ],
            env=os.environ | _BLAS_ALONE | own | {"PYTHONPATH": str(REPOSITORY)},
            capture_output=True,
            text=True,
            check=True,
        )
        return json.loads(done.stdout.splitlines()[-1])

    return outside


def alternating_medians(
    functions: list[Callable[[], Any]], rounds: int, repeat: int = 5
) -> list[float]:
    """Return each function's median time by the clock on the wall [ms]; see `alternating_timings`."""
    timings = alternating_timings(functions, rounds, repeat, time.perf_counter)
    return [float(np.median(times)) for times in timings]


def alternating_timings(
    functions: Sequence[Callable[[], Any]],
    rounds: int,
    repeat: int = 3,
    clock: Callable[[], float] = time.thread_time,
) -> list[list[float]]:
    """Return how long each function takes [ms], time for time; they take turns, so that a slow moment meets them all.

    The least of many is the nearest to a quiet machine.

    Parameters
    ----------
    clock
        [s], the calling thread's unless given.
    """
    times: list[list[float]] = [[] for _ in functions]
    for function in functions:
        function()
    for _ in range(rounds):
        for function, kept in zip(functions, times, strict=True):
            for _ in range(repeat):
                start = clock()
                function()
                kept.append(1e3 * (clock() - start))
    return times


def ratio_figures(
    ours: Sequence[float], references: Sequence[Sequence[float]], reference: str
) -> dict[str, Any]:
    """Return a benchmark's figures by the least times; of the quickest reference."""
    own, best = min(ours), min(map(min, references))
    return {"ratio": own / best, "ours_ms": own, "reference_ms": best, "reference": reference}


def normal_equations(rows: int, width: int) -> list[Callable[[], Any]]:
    """Return JᵀJ and Jᵀr by BLAS in float64, of a formed (rows, width) J in either memory layout."""
    rng = np.random.default_rng(0)
    residual, jacobian = rng.normal(size=rows), rng.normal(size=(rows, width))

    def blas(matrix: Floats) -> Callable[[], Any]:
        return lambda: (matrix.T @ matrix, matrix.T @ residual)

    return [blas(jacobian), blas(np.asfortranarray(jacobian))]
