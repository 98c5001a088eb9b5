"""Tables of points by name and frame, in images or in space: a row a frame with a column for each number, or a row a point."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from handtrack.arrays import D3, F, Floats, Ints, M, N
from handtrack.capture.images.frames import frame_number
from handtrack.capture.joints.given_joints import frame_of, side_in
from handtrack.capture.joints.joint_names import JOINTS
from handtrack.errors import HandtrackError
from handtrack.files.text_files import UNITS_M, column_of, number_in

IN_IMAGES, IN_SPACE = ("x", "y", "sure"), ("x", "y", "z")
"""numbers of a point; sure: its confidence"""
_MOST_POINTS = 2000
_CALISCOPE_COUNTS = (21, 26, 133)  # points of a hand, of Halpe and of COCO-WholeBody
_SURE = "likelihood confidence conf score visibility presence c p prob probability"
_WORDS = {
    "frame": "frame frame# frame_id frame_index frame_number frameindex image framenumber idx index ",
    "time": "time_s time t timestamp timestamp_s timestamp_ms",
    "point": "landmark landmark_id landmark_index joint keypoint bodypart point joint_name landmark_name marker node name point_id "
    "keypoint_id",
    "hand": "hand handedness side hand_label label",
    "camera": "port cam_id",
    "x": "x img_loc_x",
    "y": "y img_loc_y",
    "z": "z",
    "sure": _SURE,
}
"""names of columns; that of frames ends in the empty one, which pandas gives its index"""
_COLUMN = re.compile(
    rf"(.*?)[_. ]?(x|y|z|{_SURE.replace(' ', '|')})[_. ]?(\d*|mm|cm|m)", re.IGNORECASE
)


@dataclass(frozen=True)
class PointTable:
    """Points by frame, as a file gives them."""

    names: tuple[str, ...]
    """with the side before them where a column says that"""
    frames: Ints[F]
    values: Floats[F, N, D3]
    """x, y [px] and confidence, or x, y, z in the file's unit; NaN where a point is missing"""
    times_s: Floats[F] | None = None
    unit_m: float | None = None
    """metres in one unit, where the file says it"""
    notes: tuple[str, ...] = ()


def read_points(
    rows: list[list[str]], where: str, kinds: Sequence[str], camera: str = ""
) -> PointTable | None:
    """Return the points of a table; None for one whose first row names none.

    Parameters
    ----------
    kinds
        IN_IMAGES or IN_SPACE.
    camera
        Whose points they are, by the number in its name, where a file has those of all cameras.

    Raises
    ------
    HandtrackError
    """
    head = [name.strip().lower() for name in rows[0]]
    found = {what: column_of(head, words) for what, words in _WORDS.items()}
    at = {what: column for what, column in found.items() if column is not None}
    in_order = "time" in at and "frame" not in at
    if not {"x", "y", kinds[2]} <= at.keys() | {"sure"} or not ("point" in at or in_order):
        return _a_row_a_frame(rows, at, where, kinds)
    if not in_order and "frame" not in at:
        raise HandtrackError(f"{where}: no column `frame` beside {', '.join(head)}.")
    for i, row in enumerate(rows[1:], 2):
        if len(row) < len(head):
            raise HandtrackError(f"{where}: row {i} has {len(row)} of {len(head)} columns.")
    return _a_row_a_point(rows[1:], at, where, kinds, camera)


def _a_row_a_frame(
    rows: list[list[str]], at: Mapping[str, int], where: str, kinds: Sequence[str]
) -> PointTable | None:
    heads, units = dict[int, tuple[str, str]](), set[str]()
    for i, column in enumerate(rows[0]):
        match = _COLUMN.fullmatch(column.strip())
        if match and (match[1] or match[3].isdecimal()):
            point, kind, last = match[1], match[2].lower(), match[3].lower()
            if last in UNITS_M:
                units.add(last)
            elif last:  # x0, or h0_x0: which of the hands, which of its points
                point += (
                    "_" if re.fullmatch(r"(h|hand)_?\d+", point, re.IGNORECASE) else ""
                ) + last
            heads[i] = point.strip("_. "), kind
    body = rows[1:]
    names, values = points_of_columns(heads, cells(body, heads, where), kinds, where)
    if not names or len(units) > 1:
        return None
    frames = [
        frame_in("".join(row[at["frame"] :][:1]) if "frame" in at else "", i, where)
        for i, row in enumerate(body)
    ]
    if len(set(frames)) < len(frames):
        raise HandtrackError(f"{where}: a frame stands in two rows; expected one row a frame.")
    times = cells(body, [at["time"]], where)[:, -1] if "time" in at else np.array([np.nan])
    return PointTable(
        tuple(names),
        np.array(frames, int),
        values,
        times if np.isfinite(times).all() else None,
        UNITS_M[units.pop()] if units else None,
    )


def _a_row_a_point(
    rows: list[list[str]], at: Mapping[str, int], where: str, kinds: Sequence[str], camera: str
) -> PointTable:
    """Return points that are named or, without names, a hand's in MediaPipe's order; without frame numbers these are counted by the
    usual distance of time stamps.
    """
    notes = ()
    if "camera" in at:
        ports = sorted({row[at["camera"]] for row in rows})
        number = re.search(r"\d+", camera)
        if number is None or str(int(number[0])) not in ports:
            raise HandtrackError(
                f"{where}: cameras {', '.join(ports)} are in it, and none has the number of '{camera}'."
            )
        rows = [row for row in rows if row[at["camera"]] == str(int(number[0]))]
    if "frame" in at:
        frames = [frame_in(row[at["frame"]], i, where) for i, row in enumerate(rows)]
    else:
        times = cells(rows, [at["time"]], where)[:, -1]
        steps = np.diff(np.unique(times))
        usual = float(np.median(steps)) if len(steps) else 1.0
        frames = [frame_of(n, where) for n in np.round((times - times.min()) / usual)]
        notes = (
            f"{where}: frames are counted from the first time stamp, {usual:g} apart, as the file has no frame numbers.",
        )
    hands = [side_in(row[at["hand"]]) if "hand" in at else "" for row in rows]
    if "point" in at:
        points = [row[at["point"]] for row in rows]
    else:
        points, counts = list[str](), Counter[tuple[int, str]]()
        for key in zip(frames, hands):
            points.append(str(counts[key]))
            counts[key] += 1
        for (frame, _), count in counts.items():
            if count != len(JOINTS):
                raise HandtrackError(
                    f"{where}: {count} rows of frame {frame}; expected a hand's {len(JOINTS)}, in MediaPipe's order."
                )
    names = [f"{hand} {point}".strip() for hand, point in zip(hands, points)]
    order = list(dict.fromkeys(names))
    if "camera" in at and all(name.isdecimal() for name in order):
        count = 1 + max(map(int, order))
        order = [str(i) for i in range(next((n for n in _CALISCOPE_COUNTS if n >= count), count))]
    if len(order) > _MOST_POINTS:
        raise HandtrackError(f"{where}: {len(order)} different points; expected those of a hand.")
    heads = {at[kind]: ("", kind) for kind in kinds if kind in at}
    _, given = points_of_columns(heads, cells(rows, heads, where), kinds, where)
    there, row = np.unique(frames, return_inverse=True)
    place = {name: i for i, name in enumerate(order)}
    column = [place[name] for name in names]
    values = np.full((len(there), len(order), 3), np.nan)
    values[row[::-1], column[::-1]] = given[::-1, 0]  # of two the first counts
    return PointTable(tuple(order), there, values, notes=notes)


def points_of_columns(
    heads: Mapping[int, tuple[str, str]], numbers: Floats[F, M], kinds: Sequence[str], where: str
) -> tuple[list[str], Floats[F, N, D3]]:
    """Return the names and values of points, each number of which has a column; a confidence without one is 1.

    Parameters
    ----------
    heads
        By column, which point's number it is, and which.
    """
    places: dict[str, dict[str, int]] = {}
    for i, (point, kind) in heads.items():
        kind = "sure" if kind.lower() in _SURE.split() else kind.lower()
        places.setdefault(point, {}).setdefault(kind, i)
    places = {point: own for point, own in places.items() if own.keys() | {"sure"} >= set(kinds)}
    if len(places) > _MOST_POINTS:
        raise HandtrackError(f"{where}: {len(places)} points; expected those of a hand.")
    chosen = [[own.get(kind, -1) for kind in kinds] for own in places.values()]
    padded = np.column_stack([numbers, np.ones(len(numbers))])
    return list(places), padded[:, np.reshape(chosen, (-1, 3)).astype(int)]


def cells(rows: list[list[str]], columns: Iterable[int], where: str) -> Floats[F, M]:
    """Return the numbers in some columns of a table, NaN in empty cells and all others. Raises HandtrackError."""
    columns = list(columns)
    found = np.full((len(rows), max(columns, default=-1) + 1), np.nan)
    for numbers, row in zip(found, rows, strict=True):
        for i in columns:
            numbers[i] = number_in(row[i], where) if i < len(row) else np.nan
    return found


def frame_in(text: str, otherwise: int, where: str) -> int:
    """Return the frame that a cell says, as a number or in a file's name; another one for an empty cell. Raises HandtrackError."""
    try:
        return frame_of(float(text), where) if text.strip() else otherwise
    except ValueError:
        return frame_number(text)
