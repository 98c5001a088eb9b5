"""docs/parts.md names each part once, with tests and files that exist."""

from __future__ import annotations

import re
from collections import Counter

from tests.conftest import REPOSITORY
from tests.mutation.broken_parts import breaks, named_tests

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
    for part, tests in named_tests().items():
        assert tests, part
        for file, name in (test.split("::") for test in tests):
            text = (REPOSITORY / file).read_text(encoding="utf-8")
            assert re.search(rf"^def {name}\(", text, re.MULTILINE), f"{part}: {file}::{name}"


def test_the_files_that_are_named_exist():
    for row in ROWS:
        where = [name for name in re.findall(r"`([^`]+)`", row[2]) if "/" in name]
        assert where, row[0]
        for name in where:
            assert any((REPOSITORY / top / name).exists() for top in ("", "handtrack")), (
                row[0],
                name,
            )


def test_each_part_can_still_be_broken_in_two_ways_or_more():
    """The changes of tests/mutation/parts/*.toml: what they replace stands in its file, once."""
    listed = breaks()
    for broken in listed:
        text = (REPOSITORY / broken.file).read_text(encoding="utf-8")
        assert text.count(broken.old) == 1, f"{broken.part}, {broken.what}: {broken.file}"
        assert broken.new != broken.old, broken.what
    parts = [row[0].lstrip("| ") for row in ROWS]
    ways = Counter(broken.part for broken in listed)
    assert set(ways) == set(parts) == set(named_tests())
    assert min(ways.values()) >= 2
