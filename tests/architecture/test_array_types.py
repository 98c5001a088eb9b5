"""Types of public signatures say the axes of arrays, and arrays have them."""

from __future__ import annotations

import ast
from collections.abc import Iterator

import numpy as np
import pytest

from handtrack.diagnostics.residual_image import outline_polygons
from handtrack.simulation.scenes.simulated_clouds import Sensor, depth_views
from handtrack.tracking.frame.settings import TrackerSettings
from handtrack.tracking.state import TrackerState
from handtrack.tracking.tracker import Tracker
from tests.architecture.test_glossary import PACKAGES
from tests.conftest import REPOSITORY
from tests.experiments.silhouettes.binary_fist import scene
from tests.shapes import ARRAYS, ShapeWatch, fits

WITHOUT_AXES = {*ARRAYS, "ndarray", "NDArray"}


def public_types(body: list[ast.stmt], owner: str = "") -> Iterator[tuple[str, ast.expr]]:
    """Yield name and type of every public argument, result and field, and what types are short for."""
    for node in body:
        if isinstance(node, ast.ClassDef) and node.name[0] != "_":
            yield from public_types(node.body, f"{owner}{node.name}.")
        elif isinstance(node, ast.AnnAssign) and ast.unparse(node.target)[0] != "_":
            yield f"{owner}{ast.unparse(node.target)}", node.annotation
        elif isinstance(node, ast.Assign) and isinstance(node.value, ast.Subscript):
            yield owner + ast.unparse(node.targets[0]), node.value
        elif isinstance(node, ast.FunctionDef) and (node.name[0] != "_" or node.name[:2] == "__"):
            given = [a for a in ast.walk(node.args) if isinstance(a, ast.arg)]
            types = [(a.arg, a.annotation) for a in given] + [("result", node.returns)]
            yield from ((f"{owner}{node.name}: {name}", kind) for name, kind in types if kind)


def lacks_axes(kind: ast.expr) -> bool:
    """Return whether a type has an array in it that does not say its axes."""
    said = {id(node.value) for node in ast.walk(kind) if isinstance(node, ast.Subscript)}
    named = [
        n for n in ast.walk(kind) if isinstance(n, ast.Name | ast.Attribute) and id(n) not in said
    ]
    return any(getattr(n, "attr", getattr(n, "id", "")) in WITHOUT_AXES for n in named)


def test_public_types_of_arrays_say_their_axes():
    """Not those of compiled kernels (`*_kernels.py`): the compiler finds types by itself."""
    files = [f for p in PACKAGES for f in p.rglob("*.py") if not f.stem.endswith("_kernels")]
    types = [
        (f"{file.relative_to(REPOSITORY)} {name}", kind)
        for file in files
        for name, kind in public_types(ast.parse(file.read_text(encoding="utf-8")).body)
    ]
    assert len(types) > 3000
    assert [name for name, kind in types if lacks_axes(kind)] == [], (
        "say `Floats[N, D3]`: handtrack/arrays.py"
    )


def test_arrays_have_the_axes_that_types_say():
    """In a frame tracked by silhouettes, and one by a cloud, and what is shown of them."""
    seen = scene(2, 100, (160, 120), range(8, 9))
    model, settings = (
        seen.model,
        TrackerSettings().with_values(
            {"solver.iterations": 2, "tracker.escape": False, "tracker.recovery": False}
        ),
    )
    tracker, start = Tracker(model, settings), model.transform.solver_params(seen.joint_params[0])
    tracker.step(
        TrackerState.beginning_at(start), seen.observations[0]
    )  # compiled unwatched, which is quicker
    with ShapeWatch("handtrack") as watch:
        cloud = next(
            depth_views(model, seen.joint_params, Sensor((160, 120)), np.random.default_rng(0))
        )
        for observation in (seen.observations[0], cloud):
            _, result = tracker.step(TrackerState.beginning_at(start), observation)
            bones = model.bones(model.transform.solver_params(result.parameters))
            outline_polygons(
                seen.observations[0].silhouettes[0].camera, model.flesh["fine"].posed(bones)
            )
    assert watch.misfits == {}
    assert len(watch.met) > 60


@pytest.mark.parametrize(
    "kind, value, expected",
    [
        ("Floats[N, D3]", np.zeros((5, 3)), True),
        ("Floats[N, D3]", np.zeros((3, 5)), False),
        ("Floats[N, D3]", np.zeros((5, 3), int), False),
        ("tuple[Floats[N], Ints[N]]", (np.zeros(4), np.zeros(4, int)), True),
        ("tuple[Floats[N], Ints[N]]", (np.zeros(4), np.zeros(5, int)), False),
        ("Floats[*Axes, D2] | None", np.zeros((4, 5, 2)), True),
        ("Floats[*Axes, D2] | None", np.zeros(3), False),
        ("list[Floats[N]]", [np.zeros(4), np.zeros(5)], True),
        ("dict[str, Bytes[H, W]]", {"cam0": np.zeros(4, np.uint8)}, False),
    ],
)  # fmt: skip
def test_what_fits(kind, value, expected):
    assert fits(ast.parse(kind, mode="eval").body, value, {}) is expected


@pytest.mark.parametrize(
    "kind, expected", [("Floats", True), ("list[np.ndarray]", True), ("Floats[N] | None", False)]
)
def test_types_without_axes_are_found(kind, expected):
    assert lacks_axes(ast.parse(kind, mode="eval").body) is expected
