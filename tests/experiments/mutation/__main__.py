"""Random mutation: prints each mutant and how many of them the tests notice.

    pytest --cov --cov-context=test --cov-report=
    python -m tests.experiments.mutation --draw 100 --seed 7

The first tells which tests run which line. Every mutant is tried on tests that run its line, in a process of its own, forked
from one that has imported the libraries already; the changed source is handed to the import, so that no file is touched.
"""

from __future__ import annotations

import argparse
import importlib.abc
import importlib.util
import os
import random
import signal
import sys
import time
from collections import Counter
from pathlib import Path

import cv2  # noqa: F401 - what every mutant would import anew
import numba  # noqa: F401
import pytest
import scipy.ndimage
import scipy.spatial  # noqa: F401

from tests.experiments.mutation.mutants import Mutant, mutants
from tests.experiments.mutation.targets import Coverage, modules

_MOST_S = 600.0
"""after which a mutant is killed: it hangs"""


class _Handed(importlib.abc.SourceLoader, importlib.abc.MetaPathFinder):
    """Gives one module another source."""

    def __init__(self, module: str, file: Path, source: str):
        self.module, self.file, self.source = module, file, source

    def find_spec(self, fullname, path=None, target=None):
        if fullname == self.module:
            return importlib.util.spec_from_loader(fullname, self)
        return None

    def get_filename(self, fullname):
        return str(self.file)

    def get_data(self, path):
        return self.source.encode()


class _First:
    """Writes the first test that fails to a pipe."""

    def __init__(self, pipe: int):
        self._pipe = pipe

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.failed:
            os.write(self._pipe, report.nodeid.encode())


def failure(module: str, file: Path, source: str, tests: list[str]) -> str | None:
    """Run tests with a module's source in place of its file, in a process of its own.

    Returns None if all pass; else the first that failed, or what happened instead.
    """
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        code = 3
        try:
            silent = os.open(os.devnull, os.O_WRONLY)
            os.dup2(silent, 1)
            os.dup2(silent, 2)
            sys.meta_path.insert(0, _Handed(module, file, source))
            options = ["-x", "-q", "-p", "no:cacheprovider"]
            code = int(pytest.main([*options, *tests], plugins=[_First(writing)]))
        finally:
            os._exit(code)
    os.close(writing)
    began, status = time.monotonic(), None
    while status is None and time.monotonic() - began < _MOST_S:
        done, waited = os.waitpid(child, os.WNOHANG)
        status = os.waitstatus_to_exitcode(waited) if done else None
        time.sleep(0.02)
    if status is None:
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
    with os.fdopen(reading, "rb") as pipe:
        first = pipe.read().decode()
    if status is None:
        return "out of time"
    return None if status == 0 else first or "not imported"


def outcome(module: str, file: Path, mutant: Mutant, coverage: Coverage, most: int) -> str:
    """Return `killed`, `SURVIVED`, `NOT RUN` by any test, or `left out` where a test fails without the change too."""
    source = file.read_text("utf-8")
    tests = coverage.tests(file, source, mutant.line, most)
    if not tests:
        return "NOT RUN"
    first = failure(module, file, mutant.source, tests)
    if first is None:
        return "SURVIVED"
    again = [first] if "::" in first else tests[:1]
    return "killed" if failure(module, file, source, again) is None else "left out"


def main() -> None:
    parser = argparse.ArgumentParser(
        prog="python -m tests.experiments.mutation", description=__doc__
    )
    parser.add_argument("--module", default="", help="only modules whose name contains this")
    parser.add_argument("--draw", type=int, default=0, help="number of modules (all)")
    parser.add_argument("--max", type=int, default=1, help="mutants per module (1)")
    parser.add_argument("--tests", type=int, default=40, help="most tests a mutant is tried on")
    parser.add_argument("--coverage", type=Path, default=Path(".coverage"), help="data file")
    parser.add_argument("--seed", type=int, default=0)
    chosen = parser.parse_args()
    coverage = Coverage(chosen.coverage)
    known = {name: file for name, file in modules().items() if chosen.module in name}
    drawn = random.Random(chosen.seed).sample(
        list(known), min(chosen.draw or len(known), len(known))
    )
    outcomes = Counter()
    for module in drawn:
        every = mutants(known[module].read_text("utf-8"))
        rng = random.Random(f"{module} {chosen.seed}")
        for mutant in rng.sample(every, min(chosen.max, len(every))):
            found = outcome(module, known[module], mutant, coverage, chosen.tests)
            outcomes[found] += 1
            print(f"{found:8s} {module}:{mutant.line} {mutant.change}", flush=True)
    tried = sum(outcomes.values()) - outcomes["left out"]
    print(f"{outcomes['killed']} of {tried} mutants noticed")


if __name__ == "__main__":
    main()
