"""Figures of README and tutorial, each from docs/figures.toml, which says by what commands and at what commit it was measured.

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
from datetime import date
from pathlib import Path
from typing import Any

import tomlkit

ROOT = Path(__file__).resolve().parents[1]
TABLE = ROOT / "docs" / "figures.toml"
PAGES = (ROOT / "README.md", ROOT / "docs" / "tutorial.md")
_PLACE = re.compile(r"<!-- (\w+)\.(\w+):([.\w]+) -->.*?<!-- / -->")
_ALIKE = 0.01  # of a value: machines differ in the last digits, and tracking carries that on


def printed(text: str, table: dict[str, Any]) -> str:
    """Return a page with the table's figures at their places."""

    def figure(place: re.Match[str]) -> str:
        name, key, form = place.groups()
        value = format(table[name]["values"][key], form)
        return f"<!-- {name}.{key}:{form} -->{value}<!-- / -->"

    return _PLACE.sub(figure, text)


def measured(entry: dict[str, Any]) -> dict[str, float]:
    """Return the entry's keys of what the last of its commands prints as JSON."""
    data = Path(os.environ.get("HANDTRACK_DATA", ROOT.parent / "shared" / "data"))
    with tempfile.TemporaryDirectory() as out:
        session = Path(out) / "session"
        shutil.copytree(data / "sessions" / entry["session"], session)
        said = ""
        for command in entry["commands"]:
            words = command.format(session=session, out=out).split()
            run = [sys.executable, "-m", "handtrack_app.cli", *words]
            said = subprocess.run(run, check=True, stdout=subprocess.PIPE, text=True).stdout
    found = json.loads(said)
    return {key: found[key] for key in entry["keys"]}


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
