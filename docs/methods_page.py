"""Print into docs/methods.md what each method sets, from the methods themselves: `python docs/methods_page.py`. A test holds it so."""

from __future__ import annotations

import re
from pathlib import Path

from handtrack.tracking.frame.methods import METHODS, table

PAGE = Path(__file__).resolve().with_name("methods.md")


def with_tables(text: str) -> str:
    """Return the page with the table of each method between its marks."""
    for method in METHODS.values():
        mark = f"<!-- {method.name} -->"
        text = re.sub(
            rf"{mark}\n.*?<!-- end -->",
            lambda _, mark=mark, method=method: f"{mark}\n{table(method)}<!-- end -->",
            text,
            flags=re.DOTALL,
        )
    return text


if __name__ == "__main__":
    PAGE.write_text(with_tables(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
