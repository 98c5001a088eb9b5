"""Reports of the benchmarks: how figures become a page, and that each benchmark has one."""

from __future__ import annotations

import datetime

import pytest

from handtrack.bench.registry import BENCHMARKS
from handtrack.errors import HandtrackError
from tests.experiments.report import REPORTS, main, report

OTHERS = {
    "recordings",
    "workbench_by_hand",
    "capture",
    "ellipsoid_distances",
    "mutations",
    "seeded_masks",
}
"""pages of figures that other commands give, named there"""


def test_a_report_has_every_figure():
    page = report("jumps", {"median_mm": 0.123456, "seeds": 7}, "Jumps.", datetime.date(2026, 1, 2))
    assert page.splitlines()[:3] == ["# jumps", "", "Jumps."]
    assert "`handtrack bench jumps`, 2026-01-02, version " in page
    assert page.splitlines()[-2:] == ["| median_mm | 0.1235 |", "| seeds | 7 |"]


def test_an_unknown_benchmark_is_refused():
    with pytest.raises(HandtrackError, match="no benchmark 'jump'"):
        main(["jump"])


def test_every_benchmark_has_a_report():
    assert {path.stem for path in REPORTS.glob("*.md")} - OTHERS == set(BENCHMARKS)


@pytest.mark.parametrize("name", sorted(BENCHMARKS))
def test_reports_name_their_command(name):
    assert f"`handtrack bench {name}`" in (REPORTS / f"{name}.md").read_text(encoding="utf-8")
