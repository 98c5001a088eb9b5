"""The figures that README and documentation state, in docs/figures.toml: each entry has its commands, commit, date and machine.

    python -m docs.figures measure [NAME…]   run the commands, and write what they print into the table and the pages
    python -m docs.figures check [NAME…]     run them, and report what differs from the table

Without names, all entries. Recordings are those of HANDTRACK_DATA; each is copied first. `$NAME` in a command is an environment variable;
MAKEHUMAN and LEAP are copies of repositories. A relative difference of more than 1 % is reported, 50 % for times.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from datetime import date
from pathlib import Path
from typing import Any

import tomlkit

from docs import generate
from docs.generate import FIGURES, ROOT

PROGRAMS = {"handtrack": [sys.executable, "-m", "handtrack_app.cli"], "python": [sys.executable]}
_TOLERANCE, _TOLERANCE_OF_TIMES = 0.01, 0.5
_TIMES = ("_ms", "_s", "ratio", "_ms_a_frame", "_mb")


def measured(entry: dict[str, Any]) -> dict[str, float]:
    """Run an entry's commands in an empty folder beside a copy of its recording; return the figures that they print as JSON."""
    data = Path(os.environ.get("HANDTRACK_DATA", ROOT.parent / "shared" / "data"))
    found: dict[str, float] = {}
    with tempfile.TemporaryDirectory() as folder:
        if "session" in entry:
            shutil.copytree(data / "sessions" / entry["session"], Path(folder) / "session")
        # HANDTRACK_HOME: an installed detector would choose the hand's side and the masks
        own = {"PYTHONPATH": str(ROOT), "HANDTRACK_HOME": folder, "HANDTRACK_DATA": str(data)}
        environment = os.environ | own
        for command in entry["commands"]:
            program, *words = shlex.split(_expanded(command, environment))
            run = [*PROGRAMS.get(program, [program]), *words]
            done = subprocess.run(run, cwd=folder, env=environment, check=True, stdout=subprocess.PIPE, text=True)  # fmt: skip
            if "--json" in words:
                found |= dict(_flat(json.loads(done.stdout)))
    return {key: found[key] for key in entry["values"] if key in found}


def _expanded(command: str, environment: dict[str, str]) -> str:
    """Return a command with the values of its variables."""
    for name in re.findall(r"\$(\w+)", command):
        if name not in environment:
            raise LookupError(f"set the environment variable {name}")
        command = command.replace(f"${name}", environment[name])
    return command


def _flat(printed: Any, before: str = "") -> Iterator[tuple[str, Any]]:
    """Yield a JSON object's values; those of inner objects and lists by names and numbers with dots."""
    for name, value in enumerate(printed) if isinstance(printed, list) else printed.items():
        if isinstance(value, dict | list):
            yield from _flat(value, f"{before}{name}.")
        else:
            yield f"{before}{name}", value


def drift(name: str, known: dict[str, float], found: dict[str, float]) -> list[str]:
    """Return a line for each figure that differs, or is not printed any more."""
    lines = [f"{name}.{key}: no longer printed" for key in known if key not in found]
    for key, value in found.items():
        allowed = _TOLERANCE_OF_TIMES if key.endswith(_TIMES) else _TOLERANCE
        if abs(value - known[key]) > allowed * max(abs(known[key]), 1e-9):
            lines.append(f"{name}.{key}: {known[key]:g} in the table, {value:g} measured")
    return lines


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m docs.figures", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)  # fmt: skip
    parser.add_argument("action", choices=("measure", "check"))
    parser.add_argument("names", nargs="*", metavar="NAME")
    chosen = parser.parse_args()
    table = tomlkit.parse(FIGURES.read_text(encoding="utf-8"))
    differs = False
    for name in chosen.names or list(table):
        entry: Any = table[name]
        try:
            found = measured(entry)
            lines = drift(name, entry["values"], found) if chosen.action == "check" else []
        except (OSError, LookupError, subprocess.CalledProcessError) as error:
            found, lines = None, [f"{name}: {error}"]
        differs |= bool(lines)
        print("\n".join(lines) or f"{name}: done", flush=True)
        if found is None or chosen.action == "check":
            continue
        head = ["git", "rev-parse", "--short=8", "HEAD"]
        entry["commit"] = subprocess.check_output(head, cwd=ROOT, text=True).strip()
        entry["date"] = date.today().isoformat()
        entry["machine"] = f"{platform.machine()}, {os.cpu_count()} cores"
        entry["values"] = found
        FIGURES.write_text(tomlkit.dumps(table), encoding="utf-8")
    if chosen.action == "measure":
        generate.main()
    return 1 if differs else 0


if __name__ == "__main__":
    sys.exit(main())
