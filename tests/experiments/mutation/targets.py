"""Which tests are to notice a change of which module. Compiled code is left out: Numba's cache gives the function as it
was, and a plain implementation stands beside each.
"""

from __future__ import annotations

import ast
import re
from functools import cache
from pathlib import Path

from docs.generate import public_names

_ROOT = Path(__file__).parents[3]
_FILES = 3  # of tests that a drawn mutant is tried on


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
        name: path
        for name, path in files.items()
        if not re.search(
            r"^(from|import) (numba|handtrack\.compiled)", path.read_text("utf-8"), re.M
        )
    }


def near_tests(module: str) -> tuple[str, ...]:
    """Return the tests that are to notice a change of a module: the files that import it, or what imports it, by as few steps as any; of
    several those that import least else.
    """
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
    public = public_names().items()
    found |= {at.rpartition(".")[0] for name, at in public if f"handtrack.{name}" in found}
    return frozenset(found)
