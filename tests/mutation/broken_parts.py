"""Every part of docs/parts.md broken on purpose: python -m tests.mutation.broken_parts [PART…]. Outcomes go to docs/reports/mutations.md.

tests/mutation/parts/*.toml say what is broken and how; the tests that must notice are those which docs/parts.md names for that part.
They run in a copy of the tree, in processes of their own, so that also programs which a test starts are the broken ones.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
LIST = Path(__file__).parent / "parts"
PAGE = ROOT / "docs" / "reports" / "mutations.md"
BEGIN, END = "<!-- parts -->", "<!-- /parts -->"
_TREE = ("handtrack", "app", "tests", "docs", "sessions", "pyproject.toml", "README.md")
_MOST_S = 900.0
"""tests of a part take seconds; a hundred where all kernels are compiled anew on a loaded machine"""


@dataclass(frozen=True)
class Break:
    """One mutation: a text of a file that stands there once, and what it is replaced by."""

    part: str
    what: str
    file: str
    old: str
    new: str


def breaks() -> list[Break]:
    """Return every mutation of tests/mutation/parts/*.toml, in the parts' order."""
    files = sorted(LIST.glob("*.toml"))
    return [
        Break(**entry)
        for file in files
        for entry in tomllib.loads(file.read_text(encoding="utf-8"))["break"]
    ]


def named_tests() -> dict[str, tuple[str, ...]]:
    """Return the tests, as pytest takes them, that docs/parts.md names for each part."""
    text = (ROOT / "docs" / "parts.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| ([A-D]\d+) \|.*\| ([^|]*) \|$", text, re.MULTILINE)
    found = {part: re.findall(r"`(tests/[\w/]+\.py)?::(\w+)`", tests) for part, tests in rows}
    return {part: tuple(_in_full(pairs)) for part, pairs in found.items()}


def _in_full(pairs: list[tuple[str, str]]) -> Iterator[str]:
    """Yield `file::test` of pairs in which a test without a file is of the file before."""
    file = ""
    for given, name in pairs:
        file = given or file
        yield f"{file}::{name}"


@contextmanager
def copied_tree() -> Iterator[Path]:
    """Give a copy of the tree; compiled kernels come along, their files' times being kept."""
    with tempfile.TemporaryDirectory(prefix="handtrack_mutation_") as folder:
        copy = Path(folder) / "tree"
        copy.mkdir()
        for name in _TREE:
            if (ROOT / name).is_dir():
                shutil.copytree(ROOT / name, copy / name, ignore=shutil.ignore_patterns("*.pyc"))
            else:
                shutil.copy2(ROOT / name, copy / name)
        yield copy


def notice(tree: Path, tests: tuple[str, ...]) -> str:
    """Return the first test that fails in the tree, or nothing if all pass.

    Raises SystemExit where pytest could not run them or where all were skipped: then nothing was shown.
    """
    data = os.environ.get("HANDTRACK_DATA", str(ROOT.parent / "shared" / "data"))
    environment = os.environ | {
        "PYTHONPATH": f"{tree}{os.pathsep}{tree / 'app'}",
        "PYTHONDONTWRITEBYTECODE": "1",
        "OPENBLAS_NUM_THREADS": "1",
        "HANDTRACK_DATA": data,
    }
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", *tests]
    options = {"cwd": tree, "env": environment, "capture_output": True, "text": True}
    try:
        ran = subprocess.run(command, check=False, timeout=_MOST_S, **options)
    except subprocess.TimeoutExpired:
        return "(ran out of time)"
    failed = re.search(r"^(?:FAILED|ERROR) (\S+)", ran.stdout, re.MULTILINE)
    if failed:
        return failed[1].rpartition("::")[2] or failed[1]
    if ran.returncode < 0:
        return "(the tests' program died)"
    if ran.returncode or " passed" not in ran.stdout:
        sys.exit(
            f"pytest {' '.join(tests)} shows nothing:\n{ran.stdout[-2000:]}{ran.stderr[-2000:]}"
        )
    return ""


def outcome(tree: Path, broken: Break, tests: tuple[str, ...]) -> str:
    """Return which test notices a mutation; the tree is afterwards as it was."""
    file = tree / broken.file
    text, times = file.read_text(encoding="utf-8"), file.stat()
    assert text.count(broken.old) == 1, (broken.part, broken.what)
    file.write_text(text.replace(broken.old, broken.new), encoding="utf-8")
    stale = compiled_with(tree, file)
    drop_kernels(stale)
    try:
        return notice(tree, tests)
    finally:
        file.write_text(text, encoding="utf-8")
        os.utime(file, ns=(times.st_atime_ns, times.st_mtime_ns))
        drop_kernels(stale)


def compiled_with(tree: Path, file: Path) -> set[Path]:
    """Return the modules whose compiled code has a file's in it: its own, and those that import it, and so on.

    numba's cache knows only whether a function's own file has changed.
    """
    texts = {path: path.read_text(encoding="utf-8") for path in tree.glob("handtrack/**/*.py")}
    compiled = {path: text for path, text in texts.items() if "numba" in text}
    found, more = set(), {file} & set(compiled)
    while more:
        found |= more
        names = [".".join(path.relative_to(tree).with_suffix("").parts) for path in more]
        using = {
            path for path, text in compiled.items() if any(f"{n} import" in text for n in names)
        }
        more = using - found
    return found


def drop_kernels(modules: set[Path]) -> None:
    """Have modules compiled anew when they are next imported."""
    for path in modules:
        for cached in (path.parent / "__pycache__").glob(f"{path.stem}.*.nb?"):
            cached.unlink()


def written(rows: dict[tuple[str, str], str]) -> None:
    """Put outcomes into the page; those of parts that were not run stay as long as their mutation is in the list."""
    page = PAGE.read_text(encoding="utf-8")
    before, _, rest = page.partition(BEGIN)
    old, _, after = rest.partition(END)
    known = {
        (part, what): by
        for part, what, by in re.findall(r"^\| (\w+) \| (.*) \| (.*) \|$", old, re.MULTILINE)
    }
    known |= rows
    listed = [(b.part, b.what, known.get((b.part, b.what), "not run")) for b in breaks()]
    killed = sum(by.startswith("`") for *_, by in listed)
    table = [
        f"{killed} of {len(listed)} noticed.\n",
        "| part | broken | noticed by |",
        "|---|---|---|",
    ]
    table += [f"| {part} | {what} | {by} |" for part, what, by in listed]
    PAGE.write_text(before + BEGIN + "\n" + "\n".join(table) + "\n" + END + after, encoding="utf-8")


def main() -> None:
    parser = argparse.ArgumentParser(
        prog="python -m tests.mutation.broken_parts", description=__doc__.partition("\n")[0]
    )
    parser.add_argument("part", nargs="*", help="only these, such as A4 B2")
    chosen, tests = parser.parse_args().part, named_tests()
    listed = [broken for broken in breaks() if not chosen or broken.part in chosen]
    with copied_tree() as tree:
        asked = dict.fromkeys(test for broken in listed for test in tests[broken.part])
        if by := notice(tree, tuple(asked)):
            sys.exit(f"{by} fails without any mutation")
        for broken in listed:
            by = outcome(tree, broken, tests[broken.part])
            print(f"{broken.part} {broken.what}: {by or 'SURVIVED'}", flush=True)
            written({(broken.part, broken.what): f"`{by}`" if by else "**nobody**"})


if __name__ == "__main__":
    main()
