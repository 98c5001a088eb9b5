"""Run benchmarks and write each one's figures to docs/reports/NAME.md: python -m tests.experiments.report NAME…"""

from __future__ import annotations

import datetime
import sys
from collections.abc import Mapping

from handtrack.bench.registry import REPOSITORY, benchmark
from handtrack.version import VERSION

REPORTS = REPOSITORY / "docs" / "reports"


def report(name: str, figures: Mapping[str, object], title: str, measured: datetime.date) -> str:
    """Return the Markdown page of a benchmark's figures. title: the first line of its module."""
    lines = [
        f"# {name}",
        "",
        title,
        "",
        f"`handtrack bench {name}`, {measured:%Y-%m-%d}, version {VERSION}.",
        "",
        "| figure | value |",
        "|---|---|",
    ]
    for key, value in figures.items():
        shown = f"{value:.4g}" if isinstance(value, float) else value
        lines.append(f"| {key} | {shown} |")
    return "\n".join(lines) + "\n"


def main(names: list[str]) -> int:
    """Run the benchmarks of these names one after the other and replace their reports."""
    for name in names:
        measure = benchmark(name)
        title = (
            (sys.modules[measure.__module__].__doc__ or "")
            .partition("\n")[0]
            .removeprefix("Benchmark: ")
        )
        page = report(name, measure(), title[:1].upper() + title[1:], datetime.date.today())
        (REPORTS / f"{name}.md").write_text(page, encoding="utf-8")
    return 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
