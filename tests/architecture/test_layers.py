"""Imports go only to the left: capture → … → session, and the core knows no viewer."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.conftest import REPOSITORY

LAYERS = (
    "capture",
    "observation",
    "model",
    "terms",
    "solver",
    "sampling",
    "tracker",
    "diagnostics",
    "session",
    "bench",
)
FOR_ALL = ("geometry", "errors", "arrays")
VIEWERS = ("handtrack_app", "viser", "rerun")
CORE = REPOSITORY / "handtrack"


def core_files() -> list[Path]:
    return sorted(path for path in CORE.rglob("*.py") if path != CORE / "__init__.py")


def imported(path: Path) -> Iterator[tuple[int, str]]:
    """Yield line and full module name of every import of a file, inside functions too."""
    package = list(path.relative_to(REPOSITORY).parts[:-1])
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, name.name) for name in node.names)
        elif isinstance(node, ast.ImportFrom):
            start = package[: len(package) - node.level + 1] if node.level else []
            base = ".".join([*start, *([node.module] if node.module else [])])
            yield node.lineno, base
            yield from ((node.lineno, f"{base}.{name.name}") for name in node.names)


def layer(module: str) -> str | None:
    """Return the layer of a module of the core, None for other modules."""
    parts = module.split(".")
    return parts[1] if parts[0] == "handtrack" and len(parts) > 1 else None


def broken_rules(path: Path) -> list[str]:
    own = layer(".".join(path.relative_to(REPOSITORY).with_suffix("").parts))
    allowed = (*FOR_ALL, *LAYERS[: LAYERS.index(own) + 1]) if own in LAYERS else FOR_ALL
    where = path.relative_to(REPOSITORY)
    found = []
    for line, module in imported(path):
        if module.split(".")[0] in VIEWERS:
            found.append(f"{where}:{line} imports {module}: the core knows no viewer")
        theirs = layer(module)
        if theirs in (*LAYERS, *FOR_ALL) and theirs not in allowed:
            found.append(f"{where}:{line} ({own}) imports {module}, which lies to its right")
    return found


def test_every_file_is_in_a_known_layer():
    names = {path.relative_to(CORE).parts[0].removesuffix(".py") for path in core_files()}
    assert names <= {*LAYERS, *FOR_ALL}


def test_imports_go_left_only():
    broken = [rule for path in core_files() for rule in broken_rules(path)]
    assert not broken, "\n".join(broken)


@pytest.mark.parametrize(
    ("statement", "rule"),
    [
        ("from handtrack.tracker.result import Status", "lies to its right"),
        ("def f():\n    import rerun", "knows no viewer"),
        ("from ..session import run", "lies to its right"),
    ],
)
def test_the_walk_finds_what_is_forbidden(tmp_path, monkeypatch, statement, rule):
    monkeypatch.setattr("tests.architecture.test_layers.REPOSITORY", tmp_path)
    path = tmp_path / "handtrack" / "model" / "wrong.py"
    path.parent.mkdir(parents=True)
    path.write_text(statement)
    assert rule in broken_rules(path)[0]
