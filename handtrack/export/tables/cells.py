"""CSV files: numbers as text, names that no spreadsheet takes for formulas; and the JSON beside them that says what columns mean."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from handtrack.errors import HandtrackError
from handtrack.export.table import ResultsTable
from handtrack.files.atomic import replace_text
from handtrack.files.versions import keep_version
from handtrack.session.formats.tables import AXES, anatomy_arrays
from handtrack.tracking.frame.result import Status, is_length

_BEGINS_A_FORMULA = ("=", "+", "-", "@", "\t", "\r")


def number(value: float | np.floating) -> str:
    """Return a number with nine digits; nothing for one that is not known."""
    return "" if np.isnan(value) else f"{float(value):.9g}"


def beside(path: Path) -> Path:
    """Return the path of a file that nobody asked for by its name; what stands there is kept in versions/."""
    keep_version(path)
    return path


def write_rows(path: Path, header: Sequence[str], rows: Iterable[Sequence[object]]) -> Path:
    """Write a CSV file whole or not at all; return its path."""
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([_harmless(cell) for cell in header])
    for row in rows:
        writer.writerow([_harmless(cell) for cell in row])
    replace_text(path, text.getvalue())
    return path


def _harmless(cell: object) -> object:
    """Return a cell that no spreadsheet takes for a formula: names come from files that others made; numbers stay."""
    if not isinstance(cell, str) or not cell.startswith(_BEGINS_A_FORMULA):
        return cell
    try:
        float(cell)
    except ValueError:
        return f"'{cell}"
    return cell


# ---- The JSON file beside a CSV: what its columns mean, and all that a table of numbers cannot hold


def write_sidecar(path: Path, table: ResultsTable, columns: dict[str, str]) -> Path:
    """Write the file that explains `path`, beside it with the suffix .json; return its path. columns: meaning by name."""
    side = beside(path.with_suffix(".json"))
    replace_text(side, json.dumps(about(table) | {"columns": columns}, indent=1) + "\n")
    return side


def about(table: ResultsTable) -> dict[str, Any]:
    """Return what is known of a sequence beside its frames, as JSON has it: numbers in metres and degrees, unknown ones null."""
    track = table.track
    return {
        "session": track.session,
        "model": track.model,
        "side": track.side,
        "person": _read(track.scale),
        "hand_length_mm": track.hand_length_mm,
        "hand_length_std_mm": track.hand_length_std_mm,
        "frames": [int(track.frame[0]), int(track.frame[-1])],
        "fps": table.fps,
        "unit": "m",
        "axes": AXES,
        "status": {str(int(status)): status.name.lower() for status in Status},
        "joints": list(track.joint_names),
        "keypoint_definition": table.keypoint_definition,
        "parameters": _parameters(table),
        **_bones(table),
        "cameras": _read(track.cameras),
        "pins": _read(track.pins),
        "refinement": _read(track.refinement),
        "settings": _read(track.settings),
        "handtrack": track.version,
    }


def _parameters(table: ResultsTable) -> list[dict[str, Any]]:
    names = table.track.parameter_names
    try:
        limits = table.model.limits.interval
    except HandtrackError:  # of a program that does not say how its model is built
        limits = np.full((len(names), 2), np.inf)
    return [
        {
            "name": name,
            "unit": "m" if is_length(name) else "deg",
            "limits": None
            if not np.isfinite(interval).all()
            else (interval if is_length(name) else np.rad2deg(interval)).tolist(),
        }
        for name, interval in zip(names, limits, strict=True)
    ]


def _bones(table: ResultsTable) -> dict[str, Any]:
    names = table.track.bone_names
    try:
        built = anatomy_arrays(table.model)
    except HandtrackError:
        return {"bones": [{"name": name} for name in names]}
    return {
        "bones": [
            {
                "name": name,
                "parent": None if parent < 0 else names[parent],
                "length_m": float(length),
                "rest_T_bone": rest.tolist(),
            }
            for name, parent, length, rest in zip(
                names, built["parents"], built["bone_length"], built["rest_T_bone"], strict=True
            )
        ]
    }


def _read(text: str | None) -> Any:
    """Return what a JSON text says; the text itself where another program wrote none."""
    try:
        return None if not text else json.loads(text)
    except ValueError:
        return text
