"""What a file says, whatever its bytes: texts and numbers by name; and how two of them differ."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from handtrack.store.log import read_log
from handtrack.version import VERSION

CLOSE = 1e-6
_WHOLE = 64
"""numbers of an array that are written out; of a larger one what follows from them"""
_NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")


def meaning(path: Path) -> Any:
    """Return what a file says, as JSON has it; of a folder, which is a log, its records."""
    read = {".npz": _npz, ".html": _page, "": _log}.get(path.suffix, _text)
    return json.loads(json.dumps(read(path)).replace(VERSION, "VERSION"))


def differences(before: Any, after: Any, where: str = "") -> Iterator[str]:
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
            yield f"{where}: {_shown(after)}, {_shown(before)} before"
        else:
            yield from differences(numbers, theirs, where)


def _apart(text: str) -> tuple[list[str], list[float]]:
    """Return what stands between a text's numbers, and the numbers."""
    return _NUMBER.split(text), [float(number) for number in _NUMBER.findall(text)]


def _shown(value: Any) -> str:
    text = repr(value)
    return text if len(text) < _WHOLE else f"{text[:_WHOLE]}…"


def array_told(values: Any) -> Any:
    """Return an array as JSON has it: a large one by its shape, its ends and sums that no change leaves as they are."""
    array = np.asarray(values)
    kind = {"f": "float", "i": "whole", "u": "whole"}.get(array.dtype.kind, "text")
    flat = array.ravel()
    if kind == "text":
        return {"text": [x.decode() if isinstance(x, bytes) else str(x) for x in flat]}
    told: dict[str, Any] = {"kind": kind, "shape": list(array.shape)}
    if flat.size <= _WHOLE:
        return told | {"values": flat.astype(float).tolist()}
    finite = np.where(np.isfinite(flat), flat, 0.0).astype(float)
    along = np.cos(np.arange(flat.size))
    return told | {
        "ends": [*finite[:4].tolist(), *finite[-4:].tolist()],
        "mean": float(finite.mean()),
        "spread": float(finite.std()),
        "order": float((finite * along).mean()),
        "not finite": int((~np.isfinite(flat.astype(float))).sum()),
    }


def _text(path: Path) -> list[str]:
    return path.read_text(encoding="utf-8").splitlines()


def _page(path: Path) -> dict[str, Any]:
    """Return what a page says, and the data that it draws."""
    text = path.read_text(encoding="utf-8")
    begin = text.find('{"session":')
    data = json.JSONDecoder().raw_decode(text[begin:])[0] if begin >= 0 else None
    shown = re.sub(r"<(style|script|svg)\b.*?</\1>|<[^>]*>", " ", text, flags=re.DOTALL)
    return {"shown": " ".join(shown.split()), "data": _in_short(data)}


def _in_short(tree: Any) -> Any:
    """Return a tree with long lists of numbers told in short."""
    if isinstance(tree, dict):
        return {name: _in_short(value) for name, value in tree.items()}
    if (
        isinstance(tree, list)
        and np.asarray(tree[:1]).dtype.kind in "fi"
        and np.size(tree) > _WHOLE
    ):
        return array_told(tree)
    return tree


def _npz(path: Path) -> dict[str, Any]:
    with np.load(path) as arrays:
        return {name: array_told(arrays[name]) for name in arrays.files}


def _log(path: Path) -> list[Any]:
    """Return the records of a log of the store."""
    damage: list[str] = []
    records = [
        {"kind": r.kind, "data": r.data, "payload": array_told(np.frombuffer(r.payload, "<f8"))}
        for r in read_log(path, damage)
    ]
    assert not damage, damage
    return records
