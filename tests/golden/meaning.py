"""What a file says, whatever its bytes: texts and numbers by name; and how two of them differ."""

from __future__ import annotations

import json
import math
import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from handtrack.store.log import read_log
from handtrack.version import VERSION

CLOSE = 1e-6
_NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")


def meaning(path: Path) -> Any:
    """Return what a file says, as JSON has it; of a folder, which is a log, its records; of a page its numbers."""
    read = {".npz": _npz, "": _log, ".html": _numbers_alone}.get(path.suffix, _text)
    return json.loads(json.dumps(read(path)).replace(VERSION, "VERSION"))


def differences(before: Any, after: Any, where: str) -> Iterator[str]:
    """Yield a sentence for each place where two meanings differ: a name, a word, or a number beyond the sixth digit."""
    if isinstance(before, dict) and isinstance(after, dict):
        for name in before.keys() | after.keys():
            if name not in after or name not in before:
                yield f"{where}: '{name}' {'is new' if name in after else 'is gone'}"
            else:
                yield from differences(before[name], after[name], f"{where}/{name}")
    elif isinstance(before, list) and isinstance(after, list):
        if len(before) != len(after):
            yield f"{where}: {len(after)} entries, {len(before)} before"
        for number, (one, other) in enumerate(zip(before, after)):
            yield from differences(one, other, f"{where}/{number}")
    elif isinstance(before, float | int) and isinstance(after, float | int):
        same = math.isclose(before, after, rel_tol=CLOSE, abs_tol=CLOSE)
        if not same and not (math.isnan(before) and math.isnan(after)):
            yield f"{where}: {after}, {before} before"
    elif before != after:
        (words, numbers), (others, theirs) = (_apart(str(text)) for text in (before, after))
        if words != others or not isinstance(after, type(before)):
            yield f"{where}: {after!r}, {before!r} before"
        else:
            yield from differences(numbers, theirs, where)


def _apart(text):
    """Return what stands between a text's numbers, and the numbers."""
    return _NUMBER.split(text), [float(number) for number in _NUMBER.findall(text)]


def _text(path):
    return path.read_text(encoding="utf-8").splitlines()


def _numbers_alone(path):
    """Return the numbers of a page for people, whose words may change."""
    return numbers(path.read_text(encoding="utf-8"))


def _npz(path):
    with np.load(path) as arrays:
        return {name: [arrays[name].dtype.kind, arrays[name].tolist()] for name in arrays.files}


def _log(path):
    """Return the records of a log of the store."""
    damage = []
    records = [
        {"kind": r.kind, "data": r.data, "payload": np.frombuffer(r.payload, "<f8").tolist()}
        for r in read_log(path, damage)
    ]
    assert not damage, damage
    return records


def numbers(told: str) -> list[str]:
    """Return the numbers and truth values in a text."""
    return re.findall(rf"true|false|{_NUMBER.pattern}", told)


def unlike_recorded(name: str, told: Any) -> list[str]:
    """Return where what is told differs from a file of tests/golden/told, which HANDTRACK_RECORD=1 writes anew."""
    path = Path(__file__).parent / "told" / f"{name}.json"
    if "HANDTRACK_RECORD" in os.environ:
        path.write_text(json.dumps(told), encoding="utf-8")
    before = json.loads(path.read_text(encoding="utf-8"))
    return list(differences(before, told, f"{name} (HANDTRACK_RECORD=1 writes it anew)"))
