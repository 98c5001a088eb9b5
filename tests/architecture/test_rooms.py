"""The rooms of the house and the arrows between them: what a room may import stands in one table."""

import ast
from graphlib import TopologicalSorter

from tests.conftest import REPOSITORY

CORE = REPOSITORY / "handtrack"
GROUND = {"errors", "arrays", "compiled", "setting", "parallel", "version"}
"""what every room may import"""
VIEWERS = ("handtrack_app", "viser", "rerun")
APP = REPOSITORY / "app" / "handtrack_app"

SOLVING = {"geometry", "observation", "model", "terms", "solver"}
FRAMES = SOLVING | {"sampling", "tracking.frame"}
ARROWS = {
    "files": set(),
    "geometry": set(),
    "capture": {"files", "geometry"},
    "observation": {"geometry", "capture"},
    "model": {"files", "geometry"},
    "terms": {"geometry", "observation", "model"},
    "solver": {"model", "terms"},
    "sampling": SOLVING,
    "tracking.frame": SOLVING | {"sampling"},
    "tracking.size": SOLVING | {"tracking.frame"},
    "tracking.hypotheses": FRAMES | {"tracking.search"},
    "tracking.search": FRAMES | {"capture", "tracking.size"},
    "tracking.whole": FRAMES | {"tracking.search", "tracking.size"},
    "tracking": FRAMES | {"tracking.search", "tracking.hypotheses", "tracking.size", "tracking.whole"},
    "detector": {"files", "geometry"},
    "diagnostics": {"geometry", "model", "observation", "terms", "tracking.frame"},
    "store": {"files", "tracking", "tracking.frame", "tracking.hypotheses"},
    "session": {
        "files", "geometry", "capture", "observation", "model", "detector", "tracking", "tracking.frame",
        "tracking.size", "tracking.search", "tracking.whole", "store",
    },
    "export": {"files", "geometry", "capture", "model", "diagnostics", "session", "tracking.frame"},
    "simulation": FRAMES | {
        "files", "capture", "diagnostics", "session", "tracking", "tracking.search", "tracking.size",
    },
}  # fmt: skip
"""room → the rooms it imports; `bench` alone may import all of them"""


def core_files():
    return sorted(path for path in CORE.rglob("*.py") if path != CORE / "__init__.py")


def imported(path):
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


def room(module):
    """Return the room of a module of the core, None for other modules."""
    parts = module.split(".")
    if parts[0] != "handtrack" or len(parts) < 2:
        return None
    inner = ".".join(parts[1:3])
    return inner if inner in ARROWS else parts[1]


def broken_rules(path):
    own = room(".".join(path.relative_to(REPOSITORY).with_suffix("").parts))
    allowed = GROUND if own not in ARROWS else GROUND | ARROWS[own] | {own}
    where = path.relative_to(REPOSITORY)
    found = []
    for line, module in imported(path):
        if module.split(".")[0] in VIEWERS:
            found.append(f"{where}:{line} imports {module}: the core knows no viewer")
        theirs = room(module)
        if (
            own != "bench"
            and theirs in ARROWS.keys() | GROUND | {"bench"}
            and theirs not in allowed
        ):
            found.append(f"{where}:{line}: '{own}' may not import '{theirs}' ({module})")
    return found


def test_only_allowed_arrows_are_drawn():
    broken = [rule for path in core_files() for rule in broken_rules(path)]
    assert not broken, "\n".join(broken)


def test_page_and_engine_do_not_import_each_other():
    """They meet in the messages between the two processes; the engine knows no viewer."""
    forbidden = {"page": ("handtrack_app.engine",), "engine": ("handtrack_app.page", "viser")}
    crossing = [
        f"{path.relative_to(REPOSITORY)}:{line} {module}"
        for room, others in forbidden.items()
        for path in (APP / room).rglob("*.py")
        for line, module in imported(path)
        if module.startswith(others)
    ]
    assert crossing == []


def test_arrows_make_no_circle():
    TopologicalSorter(ARROWS).prepare()
