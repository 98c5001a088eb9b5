"""docs/parts.md names each part once, with tests and files that exist."""

from __future__ import annotations

import re

from tests.conftest import REPOSITORY

ROWS = [
    [cell.strip() for cell in line.split(" | ")]
    for line in (REPOSITORY / "docs" / "parts.md").read_text(encoding="utf-8").splitlines()
    if re.match(r"\| [A-D]\d", line)
]
COUNTS = {"A": 14, "B": 14, "C": 9, "D": 9}


def test_every_part_has_one_row():
    expected = [f"{letter}{n}" for letter, count in COUNTS.items() for n in range(1, count + 1)]
    assert [row[0].lstrip("| ") for row in ROWS] == expected


def test_the_tests_that_are_named_exist():
    for row in ROWS:
        tests = re.findall(r"`(tests/[\w/]+\.py)::(\w+)`", row[-1])
        assert tests, row[0]
        for file, name in tests:
            text = (REPOSITORY / file).read_text(encoding="utf-8")
            assert re.search(rf"^def {name}\(", text, re.MULTILINE), f"{row[0]}: {file}::{name}"


def test_the_files_that_are_named_exist():
    for row in ROWS:
        where = [name for name in re.findall(r"`([^`]+)`", row[2]) if "/" in name]
        assert where, row[0]
        for name in where:
            assert any((REPOSITORY / top / name).exists() for top in ("", "handtrack")), (
                row[0],
                name,
            )
