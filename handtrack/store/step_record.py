"""A tracked frame ↔ what a record holds: numbers as JSON, arrays as bytes, nothing rounded."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, fields
from math import prod
from typing import Any

import numpy as np

from handtrack.arrays import Array
from handtrack.store.record import Record
from handtrack.tracking.frame.motion_belief import MotionBelief
from handtrack.tracking.frame.reason import Reason
from handtrack.tracking.frame.result import (
    COLUMNS,
    FIELDS,
    Alternative,
    FrameHead,
    FrameResult,
    Status,
    Step,
)

_STATE = ("belief", "hypothesis")
"""arrays that begin so are of the tracker's state"""
_Content = tuple[dict[str, Any], bytes]
"""data and payload of a record"""


def step_content(step: Step) -> _Content:
    """Return what a record of a tracked frame holds."""
    data, arrays = _of_result(step.result)
    arrays["belief"] = step.belief
    moving = step.result.alternatives[: len(step.beliefs)]
    data["hypotheses"] = [[float(one.energy), float(one.weight), one.origin] for one in moving]
    for number, belief in enumerate(step.beliefs):
        for name, field in _BELIEF.items():
            arrays[f"hypothesis{number}.{name}"] = getattr(belief, field)
    return _packed(data, arrays)


def result_content(result: FrameResult) -> _Content:
    """Return what a record of a frame holds that nothing is tracked on from."""
    return _packed(*_of_result(result))


def read_result(record: Record) -> FrameResult:
    """Return the frame of a record. Raises ValueError, KeyError or TypeError for one that holds none."""
    return _result(record.data, _arrays(record, passed_over=_STATE))


def read_step(record: Record) -> Step:
    """Return the frame of a record with what the next one needs. Raises as `read_result` does."""
    arrays, data = _arrays(record), record.data
    beliefs = tuple(
        MotionBelief(**{field: arrays[f"hypothesis{n}.{name}"] for name, field in _BELIEF.items()})
        for n in range(len(data.get("hypotheses", ())))
    )
    return Step(_result(data, arrays), arrays.get("belief"), beliefs)


def _packed(data: dict[str, Any], arrays: Mapping[str, Array | None]) -> _Content:
    """Return data with arrays of floats by name, one after another. Their order in memory is kept: sums depend on it."""
    heads, parts = list[list[object]](), list[bytes]()
    for name, array in arrays.items():
        if array is not None:
            columns = array.flags.f_contiguous and not array.flags.c_contiguous
            rows = array.T if columns else array
            heads.append([name, "F" if columns else "C", *array.shape])
            parts.append(np.ascontiguousarray(rows, dtype="<f8").tobytes())
    return data | {"arrays": heads}, b"".join(parts)


def _arrays(record: Record, passed_over: tuple[str, ...] = ()) -> dict[str, Array]:
    found, at = {}, 0
    for name, order, *shape in record.data["arrays"]:
        count = prod(shape)
        if not (passed_over and name.startswith(passed_over)):
            flat = np.frombuffer(record.payload, "<f8", count, at).astype(float)
            found[name] = flat.reshape(shape[::-1]).T if order == "F" else flat.reshape(shape)
        at += 8 * count
    return found


def _of_result(result: FrameResult) -> tuple[dict[str, Any], dict[str, Array | None]]:
    arrays = dict[str, Array | None]()
    data: dict[str, Any] = {
        "energies": {name: float(value) for name, value in result.energies.items()},
        "reason": None if result.reason is None else asdict(result.reason),
        "alternatives": [
            [float(a.energy), float(a.weight), int(a.parent), a.origin] for a in result.alternatives
        ],
    }
    for name in (name for name in FIELDS if name not in data):
        if COLUMNS[name].axes:
            arrays[name] = getattr(result, name)
        else:
            data[name] = COLUMNS[name].kind(getattr(result, name))
    for number, pose in enumerate(result.alternatives):
        arrays[f"alternative{number}"] = pose.parameters
    return data, arrays


def result_head(data: Mapping[str, Any], owner: type[FrameHead] = FrameHead) -> dict[str, Any]:
    """Return what a record's data says of a frame without its arrays, by the names of the owner's fields."""
    known = {entry.name: data[entry.name] for entry in fields(owner) if entry.name in data}
    reason = data["reason"] and Reason(**data["reason"])
    return known | {"status": Status(data["status"]), "reason": reason}


def _result(data: dict[str, Any], arrays: dict[str, Array]) -> FrameResult:
    known = result_head(data, FrameResult)
    known |= {name: array for name, array in arrays.items() if name in FIELDS}
    known["alternatives"] = tuple(
        Alternative(arrays[f"alternative{n}"], *numbers)
        for n, numbers in enumerate(data["alternatives"])
    )
    return FrameResult(**known)


_BELIEF = {"mean": "mean", "velocity": "velocity", "motion": "covariance"}
"""arrays of a hypothesis, and the fields of its belief"""
