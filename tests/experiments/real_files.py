"""Feeds real calibrations and joints of public repositories to the importer: `python -m tests.experiments.real_files --cache DIR`.

The files are other people's, so only their addresses are kept, in real_files.toml; what is not in DIR is fetched from GitHub.
Outcomes: `read`; `asks` for a unit or a lens model that the file does not say; `refused` with what is wrong in this file, or what
to do; `general`, the list of all forms. Ends with 1 where a file's outcome is not the recorded one.
"""

from __future__ import annotations

import argparse
import tomllib
from collections import Counter
from pathlib import Path
from urllib.parse import quote
from urllib.request import urlopen

from handtrack import HandtrackError
from handtrack.capture.calibration.formats.imported_rig import with_names
from handtrack.capture.calibration.formats.read_calibration import (
    pinholes,
    read_calibration,
    sized,
    unit_of,
    with_lens,
)
from handtrack.capture.joints.read_joints import read_joints

TABLE = Path(__file__).with_suffix(".toml")
_SIZE = (1920, 1080)  # of images, where the calibration says none


def outcome(kind: str, paths: list[Path]) -> tuple[str, str]:
    """Return what became of a file, and the sentence or the cameras' names."""
    try:
        if kind == "joints":
            return "read", read_joints(str(paths[0]), str(paths[0])).family
        given = read_calibration(paths)
        names = [camera.name or f"cam{i}" for i, camera in enumerate(given.cameras)]
        given = with_names(given, names)
        try:
            given = with_lens(given, None, "it")
        except HandtrackError as error:
            return "asks", str(error)
        given, _ = pinholes(sized(given, dict.fromkeys(names, _SIZE), "it")[0], {})
        unit = unit_of(given)
        given.rig(1.0)
        return ("read", f"{given.family}: {', '.join(names)}") if unit.sure else ("asks", unit.why)
    except HandtrackError as error:
        return ("general" if "Accepted:" in str(error) else "refused"), str(error)


def fetched(cache: Path, repository: str, commit: str, name: str) -> Path:
    """Return a file of a public repository, from the cache where it is there."""
    path = cache / repository / name
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        address = f"https://raw.githubusercontent.com/{repository}/{commit}/{quote(name)}"
        with urlopen(address, timeout=60) as answer:
            path.write_bytes(answer.read())
    return path


def main() -> int:
    """Print each file's outcome, and how many there are of each."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cache", type=Path, required=True)
    cache = parser.parse_args().cache
    counts, changed = Counter[tuple[str, str]](), 0
    for file in tomllib.loads(TABLE.read_text(encoding="utf-8"))["file"]:
        paths = [fetched(cache, file["repository"], file["commit"], name) for name in file["paths"]]
        found, words = outcome(file["kind"], paths)
        counts[file["kind"], found] += 1
        changed += found != file["outcome"]
        mark = "" if found == file["outcome"] else f" (was {file['outcome']})"
        words = words.replace(f"{cache}/", "")
        print(f"{found}{mark}\t{file['repository']} {', '.join(file['paths'])}\t{words[:200]}")
    for (kind, found), count in sorted(counts.items()):
        print(f"{kind}\t{found}\t{count}")
    return int(changed > 0)


if __name__ == "__main__":
    raise SystemExit(main())
