"""The energy's parts on the timeline: every term that the tracker can name has words and a colour."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

import handtrack
from handtrack.store.current_track import CurrentTrack, TakeFrames
from handtrack.tracking.frame.result import FrameResult
from handtrack_app.engine.document_snapshots import TERM_WORDS, energy_parts, timeline_snapshot
from handtrack_app.engine.timeline import TrackedRows, WholeFrame
from handtrack_app.protocol.palette import TERMS
from tests.app.fake_run import fake_document
from tests.app.opened import show_results

CORE = Path(handtrack.__file__).parent
PRIORS = ("GaussianPrior", "LinearPrior", "CorrelatedPrior")


def term_names() -> set[str]:
    """Return the names that terms have by themselves, and those that priors are given."""
    found: set[str] = set()
    for layer in ("terms", "tracking"):
        for path in (CORE / layer).rglob("*.py"):
            tree = ast.parse(path.read_text(encoding="utf-8"))
            found.update(_given_names(tree))
            if layer == "terms":
                found.update(_own_names(tree))
    return found


def _own_names(tree: ast.Module) -> Iterator[str]:
    """Yield the values that a field or an argument `name` has unless another is given."""
    for node in ast.walk(tree):
        if isinstance(node, ast.AnnAssign) and ast.unparse(node.target) == "name":
            yield from _words([node.value])
        elif isinstance(node, ast.arguments):
            names = [*node.posonlyargs, *node.args][::-1]
            usual = dict(zip([a.arg for a in names], node.defaults[::-1], strict=False))
            yield from _words([usual.get("name")])


def _given_names(tree: ast.Module) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and ast.unparse(node.func) in (*PRIORS, "super().__init__"):
            yield from _words([*node.args, *(k.value for k in node.keywords)])


def _words(nodes: list[ast.expr | None]) -> Iterator[str]:
    for node in nodes:
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.value


def test_every_term_has_words_and_a_colour() -> None:
    names = term_names()
    assert {"coverage", "conic_field", "cloud_rays", "edges", "rest", "stabilise"} <= names
    assert names <= set(TERM_WORDS)
    assert set(TERM_WORDS.values()) <= set(TERMS)


def test_parts_with_the_same_words_are_summed(tmp_path: Path) -> None:
    document = fake_document(tmp_path)
    (result,) = document.run.track(range(4, 5), 4, document.model.rest_params())
    costs = {"cloud_rays": 3.0, "rest": 1.0, "motion": 0.5}
    show_results(document, [replace(result, energies=costs)])
    parts = timeline_snapshot(document).terms
    assert set(parts) == {"lines of sight", "priors"}
    np.testing.assert_array_equal(parts["lines of sight"][3:6], [np.nan, 3.0, np.nan])
    np.testing.assert_array_equal(parts["priors"][3:6], [np.nan, 1.5, np.nan])


def test_a_frame_is_looked_at_again_only_where_it_changed(tmp_path: Path) -> None:
    document = fake_document(tmp_path)
    results = list(document.run.track(range(3, 6), 3, document.model.rest_params()))
    rows, asked = TrackedRows(document.frames), []

    def read(frame: int) -> WholeFrame:
        asked.append(frame)
        return WholeFrame(1.0, np.zeros(2), np.zeros(2))

    def look(found: list[FrameResult]) -> list[int]:
        asked.clear()
        take = TakeFrames((), {r.frame: r for r in found})
        rows.follow(CurrentTrack([(document.frames, take)]), read, energy_parts)
        return sorted(asked)

    assert look(results) == [3, 4, 5]
    changed = [replace(results[0], energies={"rest": 2.0}), *results[1:]]
    assert look(changed) == [3]
    assert rows.terms["priors"][3] == 2.0
    assert look(results[1:]) == []
    assert rows.status[3] == -1 and np.isnan([rows.error_mm[3], rows.terms["priors"][3]]).all()
