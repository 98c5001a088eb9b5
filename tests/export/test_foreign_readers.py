"""Every format is read by somebody else's program, which finds each joint where the result has it."""

from __future__ import annotations

from pathlib import Path

import pytest

from handtrack.errors import HandtrackError
from handtrack.export.registry import export_format
from handtrack.export.table import ResultsTable
from tests.export.foreign import (
    BOUNDS_MM,
    OF_KNOWN_SKELETONS,
    PAGE,
    READERS,
    formats_table,
    section,
)
from tests.export.sequences import KINDS, sample_sequence


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", list(READERS))
def test_foreign_readers_find_the_joints(name: str, kind: str, tmp_path: Path) -> None:
    if name in OF_KNOWN_SKELETONS and kind == "claw":
        table = ResultsTable(sample_sequence(kind)[1])
        with pytest.raises(HandtrackError, match="neither a whole hand nor a body"):
            export_format(name).write(tmp_path / "x.json", table)
        return
    assert READERS[name](kind, tmp_path) < BOUNDS_MM[name]


def test_the_page_lists_the_formats_and_the_errors_of_each_reader():
    page = PAGE.read_text(encoding="utf-8")
    begin, end = section(page, "formats")
    assert page[begin:end].strip() == formats_table(), "run `python -m tests.export.foreign`"
    begin, end = section(page, "errors")
    rows = [line.split(" | ") for line in page[begin:end].splitlines() if line.startswith("| `")]
    assert [row[0].strip("|` ") for row in rows] == list(READERS)
    for name, row in zip(READERS, rows, strict=True):
        told = [cell.strip("| ") for cell in row[2:]]
        assert all(cell == "–" or float(cell) < BOUNDS_MM[name] for cell in told)
