"""The rooms of the application: which may import which, page and engine meeting in the protocol only; types that hold."""

from __future__ import annotations

import ast
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

from tests.architecture.test_rooms import MOST_FILES, imported
from tests.conftest import REPOSITORY

APP = REPOSITORY / "app" / "handtrack_app"
ARROWS: dict[str, set[str]] = {
    "protocol": set(),
    "viser_internals": set(),
    "door": {"viser_internals"},
    "engine": {"protocol"},
    "process": {"protocol", "engine", "rerun"},
    "page": {"protocol", "viser_internals"},
    "rerun": {"protocol", "engine"},
    "start": {"protocol", "door", "page"},
    "workbench": {"protocol", "door", "engine", "page", "process"},
    "commands": {"protocol", "door", "engine", "process", "rerun", "start", "workbench"},
    "cli": set(),
}
"""room → the rooms it imports; `cli` finds the commands by their names"""
VIEWERS = {"viser": {"door", "page", "start", "viser_internals", "workbench"}, "rerun": {"rerun"}}
"""library → the rooms that may import it"""


def files() -> list[Path]:
    return sorted(path for path in APP.rglob("*.py") if path.name != "__init__.py")


def module_of(path: Path) -> str:
    return ".".join(path.relative_to(APP.parent).with_suffix("").parts)


def room(module: str) -> str | None:
    """Return the room of a module of the application, None for other modules."""
    package, *inner = module.split(".")
    return inner[0] if package == APP.name and inner else None


def broken_rules(module: str, imports: list[tuple[int, str]]) -> list[str]:
    own, found = room(module), []
    assert own is not None
    for line, other in imports:
        theirs, library = room(other), other.split(".", maxsplit=1)[0]
        if theirs is not None and theirs not in ARROWS[own] | {own}:
            found.append(f"{module}:{line}: '{own}' may not import '{theirs}' ({other})")
        if own not in VIEWERS.get(library, {own}):
            found.append(f"{module}:{line}: '{own}' may not import {library}")
    return found


def test_every_file_is_in_a_known_room():
    assert {room(module_of(path)) for path in files()} == ARROWS.keys()


def test_only_allowed_arrows_are_drawn():
    broken = [r for p in files() for r in broken_rules(module_of(p), list(imported_by(p)))]
    assert not broken, "\n".join(broken)


def test_every_allowed_arrow_is_drawn():
    drawn: dict[str, set[str | None]] = {name: set() for name in ARROWS}
    for path in files():
        drawn[str(room(module_of(path)))] |= {room(other) for _, other in imported_by(path)}
    assert not {own: more for own in ARROWS if (more := ARROWS[own] - drawn[own])}


def test_arrows_make_no_circle():
    TopologicalSorter(ARROWS).prepare()


def test_files_make_no_circle():
    known = {module_of(path) for path in files()}
    TopologicalSorter(
        {module_of(p): {m for _, m in imported_by(p)} & known for p in files()}
    ).prepare()


def test_folders_are_small_enough_to_look_through():
    counts = {d: sum(p.parent == d for p in files()) for d in {p.parent for p in files()}}
    large = [f"{d.relative_to(APP)}: {n} files" for d, n in counts.items() if n > MOST_FILES]
    assert not large, "\n".join(large)


@pytest.mark.parametrize(
    ("module", "other", "rule"),
    [
        ("handtrack_app.page.layout", "handtrack_app.engine.worker", "may not import 'engine'"),
        ("handtrack_app.engine.worker", "handtrack_app.page.state", "may not import 'page'"),
        ("handtrack_app.engine.worker", "viser.transforms", "may not import viser"),
        ("handtrack_app.page.layout", "rerun", "may not import rerun"),
    ],
)
def test_what_is_forbidden_is_found(module: str, other: str, rule: str):
    assert rule in broken_rules(module, [(1, other)])[0]


# ---- types that hold


def test_runs_and_sessions_are_asked_for_what_they_have():
    """`getattr(session, "…", default)` hides from the type checker that a fake lacks something."""
    asked = [f"{module_of(p)}:{line}" for p in files() for line in guessing_lines(tree(p))]
    assert not asked, "\n".join(asked)


@pytest.mark.parametrize("target", ["session", "document.run.session", "self._run", "run"])
def test_guessing_is_found(target: str):
    assert guessing_lines(ast.parse(f'x = getattr({target}, "views", ())')) == [1]
    assert guessing_lines(ast.parse(f'x = getattr({target}_file, "views", ())')) == []


def tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def guessing_lines(module: ast.Module) -> list[int]:
    calls = [node for node in ast.walk(module) if isinstance(node, ast.Call)]
    named = [c for c in calls if ast.unparse(c.func) == "getattr" and len(c.args) == 3]
    words = (ast.unparse(c.args[0]).split(".")[-1].strip("_") for c in named)
    return [c.lineno for c, word in zip(named, words, strict=True) if word in ("run", "session")]


def imported_by(path: Path) -> list[tuple[int, str]]:
    return list(imported(path))
