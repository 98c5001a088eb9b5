"""docs/reliability.md has a row for every fault of the review, and the tests that it names exist and carry the numbers."""

from __future__ import annotations

import ast
import re
from functools import cache

import pytest

from tests.conftest import REPOSITORY

PAGE = (REPOSITORY / "docs" / "reliability.md").read_text(encoding="utf-8")
FAULTS = [*(f"A{n}" for n in range(1, 24)), "A5b", *(f"C{n}" for n in range(1, 68))]
DOES_NOT_APPLY = {"C37", "C63"}


def rows(text: str) -> list[list[str]]:
    """Return the cells of the rows of a page's tables, without their heads."""
    found = [line.strip("| ").split(" | ") for line in text.splitlines() if line.startswith("| ")]
    return [cells for cells in found if cells[0] != "fault"]


def faults(cell: str) -> list[str]:
    """Return the numbers before a row's colon; `A3 to A5` are three."""
    numbers = cell.partition(":")[0]
    for first, last in re.findall(r"A(\d+) to A(\d+)", numbers):
        numbers += "".join(f" A{n}" for n in range(int(first), int(last)))
    return re.findall(r"\b[AC]\d+b?\b", numbers)


def named_tests(cell: str) -> list[str]:
    return re.findall(r"`(test_\w+…?)`", cell)


def is_meant(name: str, test: str) -> bool:
    """Return whether a name of the table is a test's: whole, its beginning before …, or a number in it: `test_c47_…`."""
    if not name.endswith("…"):
        return test == name
    return test.startswith(name[:-1]) or f"_{name.removeprefix('test_')[:-1]}" in test


MENDED, OPEN = (rows(part) for part in PAGE.split("## Open"))


@cache
def all_tests() -> dict[str, str]:
    """Return the docstring of every test, by name."""
    return {
        node.name: ast.get_docstring(node) or ""
        for path in (REPOSITORY / "tests").rglob("test_*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.FunctionDef) and node.name.startswith("test_")
    }


def test_every_fault_has_a_row() -> None:
    told = {fault for cells in MENDED + OPEN for fault in faults(cells[0])}
    assert sorted(set(FAULTS) - told) == []
    assert sorted(told - set(FAULTS)) == []


@pytest.mark.parametrize("cells", MENDED, ids=lambda cells: cells[0].partition(":")[0])
def test_a_row_names_tests_that_exist(cells: list[str]) -> None:
    named = named_tests(cells[2])
    assert named or set(faults(cells[0])) <= DOES_NOT_APPLY
    for name in named:
        assert any(is_meant(name, test) for test in all_tests()), name


@pytest.mark.parametrize("fault", [f for f in FAULTS if f[0] == "C"])
def test_a_test_carries_the_number(fault: str) -> None:
    if fault in DOES_NOT_APPLY or not any(fault in faults(cells[0]) for cells in MENDED):
        return
    name, text = re.compile(rf"_{fault.lower()}(_|$)"), re.compile(rf"\b{fault}\b")
    assert any(name.search(test) or text.search(told) for test, told in all_tests().items())
