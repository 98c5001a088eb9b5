"""Ground truth from whatever it was measured with: a hand's or a body's joints by their names, in metres."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from handtrack.arrays import D3, F, Floats, N
from handtrack.capture.joints.given_joints import named_points
from handtrack.capture.joints.joint_names import BODY_LAYOUTS, JOINTS, NAMED, named_bodies
from handtrack.errors import HandtrackError
from handtrack.files.given_files import first_bytes
from handtrack.session.formats.markers import Markers, read_markers
from handtrack.session.formats.truth import Truth, read_truth

_HAND_M = (
    0.06,
    0.25,
)  # between the two points furthest apart: a small child's fist to a large man's flat hand
_BODY_M = (0.5, 3.0)  # likewise: of a crouching child to a tall man with raised arms
_BODY = tuple(BODY_LAYOUTS[NAMED].points)
_UNITS_M = (
    1.0,
    0.01,
    0.001,
)  # each ten times the next, and a hand's range is four: at most one fits


def read_given_truth(path: Path, side: str) -> tuple[Truth, str]:
    """Return the truth of truth.npz, TRC, C3D or CSV, and what was left out, in a sentence or none.

    side: of the hand, where the file has both. Raises HandtrackError where the unit cannot be known, or no hand is in it.
    """
    if path.is_file() and first_bytes(path)[:4] == b"PK\3\4":
        return read_truth(path), ""
    markers = read_markers(path)
    try:
        sides, unknown = named_points(markers.names, str(path))
    except HandtrackError:
        rows = named_bodies(markers.names)
        if rows is None:
            raise
        sides = {"": {i: _BODY[row] for i, row in rows.items()}}
        unknown = tuple(name for i, name in enumerate(markers.names) if i not in rows)
    chosen = sides.get(side) or (
        next(iter(sides.values())) if len(sides) == 1 and "" in sides else {}
    )
    spans = _HAND_M if set(chosen.values()) <= set(JOINTS) else _BODY_M
    if not chosen:
        raise HandtrackError(
            f"{path}: no {side} hand; there is a {' and a '.join(filter(None, sides))} one. Say which with --side."
        )
    finite = np.isfinite(markers.positions[:, list(chosen)])
    known = np.asarray(finite.all(axis=2))
    columns = [
        column for column, there in zip(chosen, np.asarray(known.any(axis=0)), strict=True) if there
    ]
    rows = np.asarray(known.any(axis=1))
    if not columns:
        raise HandtrackError(f"{path}: no frame has a point of the hand.")
    positions = markers.positions[rows][:, columns]
    positions[np.isnan(positions).any(axis=2)] = np.nan
    positions *= _unit(markers, positions, path, spans)
    names = tuple(chosen[c] for c in columns)
    missing = [chosen[c] for c in chosen if c not in columns]
    gaps = int(np.isnan(positions[..., 0]).sum())
    notes = [f"{gaps} of {positions[..., 0].size} points are not known"] if gaps else []
    notes += [f"{int((~rows).sum())} frames without any are left out"] if not rows.all() else []
    notes += [f"left out: {', '.join((*missing, *unknown)[:8])}"] if missing or unknown else []
    ordered = positions[:, [names.index(j) for j in JOINTS]] if set(names) == set(JOINTS) else None
    times = None if markers.times_s is None else markers.times_s[rows]
    truth = Truth(markers.frames[rows], times, ordered, names, positions)
    return truth, f"{path}: {'; '.join(notes)}." if notes else ""


def _unit(
    markers: Markers, positions: Floats[F, N, D3], path: Path, spans: tuple[float, float]
) -> float:
    """Return metres in one unit: what the file says, else what makes a hand, or a body, of its points."""
    if markers.unit_m is not None:
        return markers.unit_m
    count = np.isfinite(positions[..., 0]).sum(axis=1)
    fullest = positions[count == count.max()]  # frames with gaps span less
    span = np.nanmax(fullest, axis=1) - np.nanmin(fullest, axis=1)
    size = float(np.median(np.linalg.norm(span, axis=1)))
    fits = [unit for unit in _UNITS_M if spans[0] <= size * unit <= spans[1]]
    if len(fits) != 1:
        raise HandtrackError(
            f"{path}: its points span {size:.3g}, which is no hand or body in metres, centimetres or millimetres. Write the unit in the "
            "names of the columns, such as wrist_x_mm."
        )
    return fits[0]


def write_truth(path: Path, truth: Truth) -> None:
    """Write truth.npz."""
    arrays: dict[str, np.ndarray] = {"frame": truth.frame}
    if truth.time_s is not None:
        arrays["time_s"] = truth.time_s
    if truth.keypoint_definition is not None:
        arrays["keypoint_definition"] = np.array(truth.keypoint_definition)
    if truth.keypoints21 is not None:
        arrays["keypoints21"] = truth.keypoints21
    if truth.joint_positions is not None:
        arrays |= {
            "joint_names": np.array(truth.joint_names),
            "joint_positions": truth.joint_positions,
        }
    np.savez(path, **arrays)  # pyright: ignore[reportArgumentType]
