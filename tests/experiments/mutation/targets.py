"""Which tests are to notice a change of which module. Compiled code is left out: a plain implementation stands beside each."""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path

_ROOT = Path(__file__).parents[3]
_FILES = 3  # of tests that a drawn mutant is tried on

TARGETS: dict[str, tuple[str, ...]] = {
    "handtrack.sampling.chains": ("tests/sampling/test_limbs.py",),
    "handtrack.sampling.suppression": ("tests/sampling/test_minima.py",),
    "handtrack.tracking.hypotheses.mixture": ("tests/tracking/decisions/test_mixture_weights.py",),
    "handtrack.tracking.hypotheses.mixture_search": (
        "tests/tracking/decisions/test_hypothesis_rounds.py",
        "tests/tracking/decisions/test_mixture_weights.py",
    ),
    "handtrack.tracking.frame.prediction": (
        "tests/tracking/decisions/test_prediction_span.py",
        "tests/tracking/test_prediction.py",
    ),
    "handtrack.tracking.frame.assessment": (
        "tests/tracking/decisions/test_status.py",
        "tests/tracking/test_assessment.py",
    ),
    "handtrack.tracking.frame.terms.cloud_terms": (
        "tests/tracking/decisions/test_cloud_balance.py",
        "tests/tracking/test_cloud_weight.py",
        "tests/tracking/test_methods.py",
    ),
    "handtrack.tracking.search.lost_finger": ("tests/tracking/decisions/test_finger_shift.py",),
    "handtrack.tracking.search.policy": (
        "tests/tracking/decisions/test_restart_choice.py",
        "tests/tracking/test_search_policy.py",
        "tests/tracking/decisions/test_status.py",
        "tests/test_docs.py::test_generated_parts_are_current",
    ),
    "handtrack.tracking.search.engine": (
        "tests/tracking/test_search_policy.py",
        "tests/tracking/decisions/test_hypothesis_rounds.py",
    ),
    "handtrack.tracking.search.frame_solve": (
        "tests/tracking/decisions/test_poor_cloud.py",
        "tests/tracking/test_fallback.py",
    ),
}


@cache
def modules(root: Path = _ROOT) -> dict[str, Path]:
    """Return the files of the core's and the application's modules by name, without those that hold compiled functions."""
    files = {
        ".".join(path.relative_to(base).with_suffix("").parts): path
        for base, package in ((root, "handtrack"), (root / "app", "handtrack_app"))
        for path in sorted((base / package).rglob("*.py"))
        if path.name != "__init__.py"
    }
    return {
        name: path for name, path in files.items() if "import numba" not in path.read_text("utf-8")
    }


def near_tests(module: str) -> tuple[str, ...]:
    """Return the tests that are to notice a change of a module: those chosen above, else the files that import it, or what
    imports it, by as few steps as any; of several those that import least else.
    """
    if module in TARGETS:
        return TARGETS[module]
    every, reached = modules(), {module}
    tests = {path: _imports(path) for path in sorted((_ROOT / "tests").rglob("test_*.py"))}
    while True:
        near = [path for path, names in tests.items() if names & reached]
        if near:
            near.sort(key=lambda path: (len(tests[path] & set(every)), path))
            return tuple(str(path.relative_to(_ROOT)) for path in near[:_FILES])
        wider = reached | {name for name, path in every.items() if _imports(path) & reached}
        if wider == reached:
            return _mentioning(module)
        reached = wider


def _mentioning(module: str) -> tuple[str, ...]:
    """Return the tests of a module's room that name it most: it is imported by its name in a table."""
    package, *rooms, name = module.split(".")
    room = _ROOT / "tests" / ("app" if package == "handtrack_app" else "") / "".join(rooms[:1])
    counts = {path: path.read_text("utf-8").count(name) for path in sorted(room.rglob("test_*.py"))}
    most = sorted((path for path, count in counts.items() if count), key=lambda p: -counts[p])
    return tuple(str(path.relative_to(_ROOT)) for path in most[:_FILES])


@cache
def _imports(path: Path) -> frozenset[str]:
    """Return every name that a file may have imported as a module."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return frozenset(found)
