"""Which tests run which lines, as coverage has measured it. Compiled code is left out: Numba's cache gives the function as it
was, and a plain implementation stands beside each.
"""

from __future__ import annotations

import ast
import re
from collections import Counter
from pathlib import Path

from coverage import CoverageData

_ROOT = Path(__file__).parents[3]


def modules() -> dict[str, Path]:
    """Return the files of library and application by module, without those that hold compiled functions."""
    files = {
        ".".join(path.relative_to(base).with_suffix("").parts): path
        for base, package in ((_ROOT, "handtrack"), (_ROOT / "app", "handtrack_app"))
        for path in sorted((base / package).rglob("*.py"))
        if path.name != "__init__.py"
    }
    return {
        name: path
        for name, path in files.items()
        if not re.search(
            r"^(from|import) (numba|handtrack\.compiled)", path.read_text("utf-8"), re.M
        )
    }


class Coverage:
    """What each test ran, by the data file that `pytest --cov --cov-context=test` leaves. Raises FileNotFoundError."""

    def __init__(self, path: Path):
        if not path.is_file():
            raise FileNotFoundError(f"{path}: first run pytest --cov --cov-context=test")
        data = CoverageData(str(path))
        data.read()
        self._lines = {
            file: {
                line: {name.partition("|")[0] for name in contexts if name}
                for line, contexts in data.contexts_by_lineno(file).items()
            }
            for file in data.measured_files()
        }
        self._sizes = Counter(
            test for lines in self._lines.values() for tests in lines.values() for test in tests
        )

    def tests(self, file: Path, source: str, line: int, most: int) -> list[str]:
        """Return at most `most` tests that run a line of a file, those first that run the fewest lines in all, and then those of whole
        results; of a line that only an import runs, those that run any line of the file.
        """
        statements = [
            node.lineno
            for node in ast.walk(ast.parse(source))
            if isinstance(node, ast.stmt) and node.lineno <= line <= (node.end_lineno or line)
        ]
        lines = self._lines.get(str(file), {})
        if (at := max(statements)) not in lines:
            return []
        tests = lines[at] or set().union(*lines.values())
        ranked = sorted(tests, key=lambda test: (self._sizes[test], test))
        return ranked[:most] + [t for t in ranked[most:] if t.startswith("tests/golden/")]
