"""Figures of README, tutorial and the report of recordings, each from docs/figures.toml, which says by what commands and at what commit it was measured.

    python -m docs.figures                      print the table's figures into the pages
    python -m docs.figures --measure [NAME…]    run the commands and write what they say into the table
    python -m docs.figures --check [NAME…]      run them and name what differs from the table, or a page from the table

The recordings are those of HANDTRACK_DATA; each is copied first. A figure that differs by more than a percent is named.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from datetime import date
from pathlib import Path
from typing import Any

import tomlkit

ROOT = Path(__file__).resolve().parents[1]
TABLE = ROOT / "docs" / "figures.toml"
PAGES = tuple(
    ROOT / page
    for page in (
        "README.md",
        "docs/tutorial.md",
        "docs/reports/recordings.md",
        "sessions/another_hand/README.md",
    )
)
PROGRAMS = {"handtrack": [sys.executable, "-m", "handtrack_app.cli"], "python": [sys.executable]}
ENVIRONMENT = os.environ | {"PYTHONPATH": str(ROOT)}  # for commands of tests.benchmarks
_PLACE = re.compile(r"<!-- (\w+)\.([\w.]+):([.%\w]+) -->.*?<!-- / -->")
_ALIKE = 0.01  # of a value: machines differ in the last digits, and tracking carries that on


def printed(text: str, table: dict[str, Any]) -> str:
    """Return a page with the table's figures at their places."""

    def figure(place: re.Match[str]) -> str:
        name, key, form = place.groups()
        value = format(table[name]["values"][key], form)
        return f"<!-- {name}.{key}:{form} -->{value}<!-- / -->"

    return _PLACE.sub(figure, text)


def measured(entry: dict[str, Any]) -> dict[str, float]:
    """Return the entry's keys of what its commands print as JSON; they run in an empty folder, beside a copy of its recording."""
    data = Path(os.environ.get("HANDTRACK_DATA", ROOT.parent / "shared" / "data"))
    found: dict[str, float] = {}
    with tempfile.TemporaryDirectory() as folder:
        if "session" in entry:
            shutil.copytree(data / "sessions" / entry["session"], Path(folder) / "session")
        for command in entry["commands"]:
            program, *words = command.split()
            run = [*PROGRAMS.get(program, [program]), *words]
            alone = ENVIRONMENT | {
                "HANDTRACK_HOME": folder
            }  # with a detector the side of a hand would be looked for
            said = subprocess.run(run, cwd=folder, env=alone, check=True, stdout=subprocess.PIPE, text=True).stdout  # fmt: skip
            if "--json" in words:
                found |= dict(_flat(json.loads(said)))
    return {key: found[key] for key in entry["keys"]}


def _flat(said: dict[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    """Yield a JSON object's values; those of objects within it by names with dots."""
    for name, value in said.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{before}{name}.")
        else:
            yield f"{before}{name}", value


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m docs.figures", description=__doc__)
    parser.add_argument("names", nargs="*", help="entries of the table (all)")
    parser.add_argument("--measure", action="store_true")
    parser.add_argument("--check", action="store_true")
    chosen = parser.parse_args()
    table = tomlkit.parse(TABLE.read_text(encoding="utf-8"))
    wrong = []
    for name in chosen.names or list(table):
        entry: Any = table[name]
        if chosen.measure:
            commit = subprocess.check_output(
                ["git", "rev-parse", "--short", "HEAD"], cwd=ROOT, text=True
            )
            entry["commit"], entry["date"] = commit.strip(), date.today().isoformat()
            entry["values"] = measured(entry)
            TABLE.write_text(tomlkit.dumps(table), encoding="utf-8")
        if chosen.check:
            known = entry["values"]
            wrong += [
                f"{name}.{key}: {known[key]:g} in the table, {value:g} measured"
                for key, value in measured(entry).items()
                if abs(value - known[key]) > _ALIKE * max(abs(known[key]), 1e-9)
            ]
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        if chosen.check and printed(text, table) != text:
            wrong.append(f"{page.name} has other figures than the table: python -m docs.figures")
        elif not chosen.check:
            page.write_text(printed(text, table), encoding="utf-8")
    print("\n".join(wrong) or "all figures hold" if chosen.check else "printed")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
