"""A track as arrays with named axes, as `movement` names them: what `to_xarray` returns and NetCDF files hold."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from handtrack.arrays import Array, Axes, F, Floats, J
from handtrack.model.articulated import JOINT_CENTRES
from handtrack.tracking.frame.result import COLUMNS, FIELDS, Status, TrackResult, is_length
from handtrack.tracking.frame.result_fields import per_frame

_USUAL_FPS = 30.0  # of a single frame, which says nothing of the rate
_XYZ = ("x", "y", "z")
_BEFORE_OTHERS = ("p_off_25mm", "p_off_10mm", "reason")
"""in this order after the joints, since scripts may read columns by position; what is declared later comes after them"""


def labelled(
    track: TrackResult,
) -> tuple[
    dict[str, Sequence[str] | Array[F]],
    dict[str, tuple[tuple[str, ...], Array[*Axes], str]],
    dict[str, str | float],
]:
    """Return what stands along each axis: `time` [s], else words; the axes, values and unit of a track's arrays, positions of lost frames
    being NaN; and attributes.

    The arrays are `position`, `position_std`, `position_covariance` and `confidence` by keypoint, `angle` and
    `angle_std` by parameter, `T_world_bone` by bone, `frame`, `status`, `energy`, and where they are known those of `per_frame`,
    such as `views`, `p_off_25mm`, `p_off_10mm` by part, `reason`.
    """
    time, angles = ("time",), ("time", "parameter")
    points = (*time, "space", "keypoints", "individuals")
    covariance = track.joint_covariance
    std = np.sqrt(np.maximum(np.diagonal(covariance, axis1=2, axis2=3), 0.0))
    lost = track.status == Status.LOST

    def shown(values: Array[*Axes]) -> Array:
        """(F, J, …) → (F, …, J, 1)."""
        hidden = lost.reshape(-1, *[1] * (values.ndim - 1))
        return np.moveaxis(np.where(hidden, np.nan, values), 1, -1)[..., None]

    coordinates: dict[str, Sequence[str] | Array[F]] = {
        "time": track.time_s,
        "space": _XYZ,
        "space_2": _XYZ,
        "keypoints": track.joint_names,
        "individuals": (track.side if track.keypoints21 is not None else track.model,),
        "parameter": track.parameter_names,
        "bone": track.bone_names,
    }
    named = {
        "position": (points, shown(track.joint_positions), "joint_positions"),
        "position_std": (points, shown(std), "joint_positions"),
        "position_covariance": (
            (*points[:2], "space_2", *points[2:]),
            shown(covariance),
            "joint_covariance",
        ),
        "confidence": (("time", *points[2:]), joint_confidence(track)[..., None], "p_off_25mm"),
        "angle": (angles, track.parameters, "parameters"),
        "angle_std": (angles, track.parameter_std, "parameter_std"),
        "T_world_bone": (("time", "bone", "row", "column"), track.T_world_bone, "T_world_bone"),
        **{name: (time, getattr(track, name), name) for name in ("frame", "status", "energy")},
    }
    arrays = {name: (*array, COLUMNS[of].unit) for name, (*array, of) in named.items()}
    for name, column in per_frame(FIELDS):
        if (values := getattr(track, name)) is not None:
            axes = (column.names.removesuffix("_names"),) if column.names else ()
            coordinates |= {axis: getattr(track, column.names) for axis in axes}
            arrays[name] = ((*time, *axes), values, column.unit)
    attributes = {
        "source_software": "handtrack",
        "ds_type": "poses",
        "fps": frame_rate(track),
        "time_unit": "seconds",
        "session": track.session,
        "model": track.model,
        "side": track.side,
        "keypoint_definition": track.keypoint_definition or JOINT_CENTRES,
    }
    return coordinates, arrays, attributes


def frame_columns(
    track: TrackResult, with_std: bool = False
) -> Iterator[tuple[str, Array[F], str]]:
    """Yield the columns of a table with a row for each frame: name, values and meaning.

    Angles in degrees, lengths in metres.

    Parameters
    ----------
    with_std
        Each parameter's standard deviation after it.
    """
    for name in ("frame", "time_s", "status", "energy"):
        yield name, getattr(track, name), COLUMNS[name].meaning
    for row, name in enumerate(track.parameter_names):
        unit, factor, meaning = "deg", 180.0 / np.pi, "angle [°]"
        if is_length(name):
            unit, factor, meaning = "m", 1.0, "position of the root in the world [m]"
        elif name.startswith("root_r"):
            meaning = "rotation of the root in the world: a rotation vector's component [°]"
        yield f"{name}_{unit}", factor * track.parameters[:, row], meaning
        if with_std:
            std = factor * track.parameter_std[:, row]
            yield f"{name}_std_{unit}", std, f"its standard deviation: {meaning}"
    for row, name in enumerate(track.joint_names):
        for axis, values in zip(_XYZ, track.joint_positions[:, row].T, strict=True):
            yield f"{name}_{axis}_m", values, f"{axis} of {name} in the world [m]"
    later = dict(per_frame(FIELDS))
    for name, column in ({name: later[name] for name in _BEFORE_OTHERS} | later).items():
        if (values := getattr(track, name)) is not None:
            along = getattr(track, column.names) if column.names else ("",)
            for thing, own in zip(along, values.reshape(len(track), -1).T, strict=True):
                yield f"{name}_{thing}".rstrip("_"), own, column.meaning.format(thing)


def frame_rate(track: TrackResult) -> float:
    """Return the frames a second of the recording; of its times where it was not kept."""
    if track.fps is not None:
        return track.fps
    steps = np.diff(track.time_s) / np.diff(track.frame)
    return float(1.0 / np.median(steps)) if len(steps) else _USUAL_FPS


def joint_confidence(track: TrackResult) -> Floats[F, J]:
    """Return how far each joint can be trusted, 0 to 1: 0 in lost frames; else 1 − P (its finger is more than 10 mm off), 1 −
    P (some joint is more than 25 mm off) where that alone is known, 1 where nothing is.
    """
    sure = np.ones((len(track), len(track.joint_names)))
    if track.p_off_25mm is not None:
        sure[:] = 1.0 - np.nan_to_num(track.p_off_25mm)[:, None]
    if track.p_off_10mm is not None and track.part_names is not None:
        parts = track.part_names
        for column, part in zip(track.p_off_10mm.T, parts, strict=True):
            own = np.array([_part(name, parts) == part for name in track.joint_names])
            known = np.isfinite(column)
            sure[np.ix_(known, own)] = 1.0 - column[known, None]
    sure[track.status == Status.LOST] = 0.0
    return sure


def _part(joint: str, parts: tuple[str, ...]) -> str:
    """Return the part of a hand that a joint belongs to: its finger, else the palm, which comes first."""
    finger = joint.split("_", maxsplit=1)[0]
    return finger if finger in parts else parts[0]
