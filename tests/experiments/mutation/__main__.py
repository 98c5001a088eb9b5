"""Random mutation: python -m tests.experiments.mutation [--module PART] [--draw N] [--max N] [--seed S] prints each mutant and the score.

--draw: so many modules are drawn from library and application; --max: mutants of each (1). Every mutant is tried in a process of its own, forked from one that has imported the libraries already;
the changed source is handed to the import, so that no file is touched.
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
from pathlib import Path

import cv2  # noqa: F401 - what every mutant would import anew
import numba  # noqa: F401
import pytest
import scipy.ndimage
import scipy.spatial  # noqa: F401

from tests.experiments.mutation.mutants import mutants
from tests.experiments.mutation.targets import modules, near_tests

ROOT = Path(__file__).parents[3]
_OURS = ("handtrack", "handtrack_app", "docs")
_PATIENCE, _LEAST_S = 8.0, 30.0
"""times as long as the tests take; a mutant that runs longer is killed"""


class _Handed(importlib.abc.SourceLoader, importlib.abc.MetaPathFinder):
    """Gives one module another source."""

    def __init__(self, module: str, source: str):
        self.module, self.source = module, source

    def find_spec(self, fullname, path=None, target=None):
        if fullname == self.module:
            return importlib.util.spec_from_loader(fullname, self)
        return None

    def get_filename(self, fullname):
        return str(path_of(self.module))

    def get_data(self, path):
        return self.source.encode()


def path_of(module: str) -> Path:
    root = ROOT / "app" if module.startswith("handtrack_app") else ROOT
    return root.joinpath(*module.split(".")).with_suffix(".py")


def passes(module: str, source: str, tests: tuple[str, ...], most_s: float) -> bool:
    """Return whether the tests pass with a module's source, in a process of its own, within a time."""
    child = os.fork()
    if child == 0:
        code = 3
        try:
            silent = os.open(os.devnull, os.O_WRONLY)
            os.dup2(silent, 1)
            os.dup2(silent, 2)
            for name in [n for n in sys.modules if n.partition(".")[0] in _OURS]:
                del sys.modules[name]  # `docs.generate` has imported half of the program
            sys.meta_path.insert(0, _Handed(module, source))
            code = int(pytest.main(["-x", "-q", "-p", "no:cacheprovider", *tests]))
        finally:
            os._exit(code)
    began = time.monotonic()
    while time.monotonic() - began < most_s:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(status) == 0
        time.sleep(0.02)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return False


def killed(module: str, most: int, seed: int) -> tuple[int, int]:
    """Try at most `most` mutants of a module, drawn by seed; return how many its tests noticed, and how many were tried."""
    source, tests = path_of(module).read_text(encoding="utf-8"), near_tests(module)
    began = time.monotonic()
    if not (tests and passes(module, source, tests, 600.0)):
        print(f"left out {module}: no test is near, or they fail: pytest {' '.join(tests)}")
        return 0, 0
    most_s = max(_PATIENCE * (time.monotonic() - began), _LEAST_S)
    every = mutants(source)
    drawn = random.Random(f"{module} {seed}").sample(every, min(most, len(every)))
    noticed = 0
    for mutant in sorted(drawn, key=lambda m: m.line):
        lives = passes(module, mutant.source, tests, most_s)
        noticed += not lives
        print(f"{'SURVIVED' if lives else 'killed':8s} {module}:{mutant.line} {mutant.change}", flush=True)  # fmt: skip
    return noticed, len(drawn)


def main() -> None:
    parser = argparse.ArgumentParser(
        prog="python -m tests.experiments.mutation", description=__doc__
    )
    parser.add_argument("--module", default="", help="only modules whose name contains this")
    parser.add_argument("--draw", type=int, default=0, help="number of modules (all)")
    parser.add_argument("--max", type=int, default=1, help="mutants per module (1)")
    parser.add_argument("--seed", type=int, default=0)
    chosen = parser.parse_args()
    os.chdir(ROOT)
    known = [module for module in modules(ROOT) if chosen.module in module]
    if chosen.draw:
        known = random.Random(chosen.seed).sample(known, min(chosen.draw, len(known)))
    scores = [killed(module, chosen.max, chosen.seed) for module in known]
    print(f"{sum(n for n, _ in scores)} of {sum(m for _, m in scores)} mutants noticed")


if __name__ == "__main__":
    main()
