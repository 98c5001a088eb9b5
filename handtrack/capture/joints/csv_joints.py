"""Joints in CSV: DeepLabCut's tables, and dumps with a column a number or a row a point."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from handtrack.arrays import D3, F, Floats, M, N
from handtrack.capture.images.frames import frame_number
from handtrack.capture.joints.given_joints import (
    BodyPoints,
    Hand,
    ImportedBodies,
    ImportedJoints,
    body_of,
    checked_bodies,
    cleaned,
    frame_of,
    hand_of,
    named_points,
    side_in,
)
from handtrack.capture.joints.joint_names import JOINTS, NAMED, is_numbered, named_bodies
from handtrack.capture.joints.json_joints import read_json_joints
from handtrack.errors import HandtrackError
from handtrack.files.text_files import column_of, number_in, read_rows

Names = Mapping[str, str]
"""our names of a file's own points, with their side where it has both hands, as `right index_tip`"""
_CALISCOPE_COUNTS = (21, 26, 133)  # points of a hand, of Halpe and of COCO-WholeBody
_TIME = "timestamp time time_s timestamp_s timestamp_ms t"
_SURE = "likelihood confidence conf score visibility presence c p prob probability"
_FRAME = "frame frame_id frame_index frame_number frameindex image framenumber idx index "
"""ends in the empty name that pandas gives its index"""
_POINT = "landmark landmark_id landmark_index joint keypoint bodypart point joint_name landmark_name node name"
_HAND = "hand handedness side hand_label label"
KINDS = ("x", "y", "likelihood")
_Places = Sequence[int | None]
_NUMBER = re.compile(
    r"(.*?)[_. ]?(x|y|z|" + "|".join(s for s in _SURE.split() if len(s) > 1) + r"|c|p)[_.]?(\d*)",
    re.IGNORECASE,
)


def read_csv_joints(text: str, where: str, names: Names, camera: str) -> ImportedJoints | None:
    """Return the joints of a table; None for one without a header of points.

    Parameters
    ----------
    names
        Our names of the file's own.
    camera
        Whose joints they are, where a file has those of all cameras.

    Raises
    ------
    HandtrackError
    """
    rows = [row for row in read_rows(text, where) if any(row)]
    if len(rows) < 2:
        return None
    heads = [row[0].strip().lower() for row in rows[:4]]
    if "bodyparts" in heads and "coords" in heads:
        return _deeplabcut(rows, heads, where, names)
    head = [name.strip().lower() for name in rows[0]]
    if "img_loc_x" in head and "img_loc_y" in head:
        return _caliscope(rows, head, where, camera)
    if {"x", "y"} <= set(head):
        if column_of(head, _TIME) is not None and column_of(head, _FRAME) is None:
            return _rows_in_order(rows, head, where)
        if column_of(head, _POINT) is not None:
            return _a_row_a_point(rows, head, where, names)
    return _a_row_a_frame(rows, where, names)


def renamed(names: Sequence[str], known: Names, where: str) -> list[str]:
    """Return points' names with ours for those that a table gives. Raises HandtrackError for one that is not there."""
    missing = next((name for name in known if name not in names), None)
    if missing is not None:
        raise HandtrackError(
            f"{where}: no point '{missing}', which the table of names gives; its points: {', '.join(names[:30])}."
        )
    return [known.get(name, name) for name in names]


def table_joints(
    family: str,
    names: Sequence[str],
    columns: Floats[F, N, D3],
    frames: Sequence[int],
    where: str,
    layout: str | None = None,
) -> ImportedJoints:
    """Return joints from points by name: a hand's, a body's, or both.

    Parameters
    ----------
    columns
        (F, N, 3), column, row [px], confidence.

    Raises
    ------
    HandtrackError
        Where they are neither's.
    """
    bodies = bodies_of_table(names, columns[:, None], frames, where)
    if bodies is not None and bodies.layout is None:  # numbered, and not as a hand's are
        return ImportedJoints(family, {}, layout=layout, bodies=bodies)
    try:
        sides, unknown = named_points(names, where)
    except HandtrackError:
        if bodies is None:
            raise
        return ImportedJoints(family, {}, layout=layout, bodies=bodies)
    hands: dict[str, dict[int, Hand]] = {}
    for side, chosen in sides.items():
        points, ours = list(chosen), list(chosen.values())
        hands[side] = {
            frame: hand_of(ours, row[points, :2], row[points, 2])
            for frame, row in zip(frames, columns, strict=True)
            if (np.isfinite(row[points, :2]).all(axis=1) & (row[points, 2] > 0)).any()
        }
    if layout is not None and len(hands) == 1:  # MediaPipe's sides are as in a mirror, or not
        hands = {"": next(iter(hands.values()))}
    return ImportedJoints(family, hands, layout, unknown, bodies=bodies)


def bodies_of_table(
    names: Sequence[str], columns: Floats[F, M, N, D3], frames: Sequence[int], where: str
) -> ImportedBodies | None:
    """Return the bodies of several tracks' points by name; None where the names are no body's. Raises HandtrackError.

    Points that are but numbered from 0 are some detector's, as many as there are.
    """
    places = named_bodies(names)
    if places is None and not is_numbered(names):
        return None

    def body(points: Floats[N, D3]) -> BodyPoints:
        return cleaned(points) if places is None else body_of(points, places)

    people = {
        frame: [one for one in map(body, tracks) if (one[:, 2] > 0).any()]
        for frame, tracks in zip(frames, columns, strict=True)
    }
    unknown = tuple(name for i, name in enumerate(names) if places and i not in places)
    return checked_bodies(people, where, NAMED if places else None, unknown)


def _deeplabcut(
    rows: list[list[str]], heads: list[str], where: str, known: Names
) -> ImportedJoints:
    parts, coords = rows[heads.index("bodyparts")], rows[heads.index("coords")]
    single = rows[heads.index("individuals")] if "individuals" in heads else [""] * len(parts)
    if len({name for name in single[1:] if name and name != "single"}) > 1:
        raise HandtrackError(
            f"{where}: several individuals ({', '.join(dict.fromkeys(single[1:]))}); export one."
        )
    body = rows[heads.index("coords") + 1 :]
    kinds = [name.strip().lower() for name in coords]
    first = kinds.index("x") if "x" in kinds else 1
    places = {pair: i for i, pair in enumerate(zip(parts, kinds)) if i >= first}
    names = list(dict.fromkeys(parts[first:]))
    columns = _columns(body, [[places.get((n, kind)) for kind in KINDS] for n in names], where)
    frames = [
        _frame((row + [""] * first)[max(first - 1, 0)] or row[0], i, where)
        for i, row in enumerate(body)
    ]
    return table_joints("DeepLabCut's CSV", renamed(names, known, where), columns, frames, where)


def _caliscope(rows: list[list[str]], head: list[str], where: str, camera: str) -> ImportedJoints:
    """Return the joints of one camera, known by its number, from Caliscope's xy.csv, which has those of all cameras."""
    places = [column_of(head, n) for n in ("port cam_id", "point_id keypoint_id", "frame_index")]
    if None in places:
        raise HandtrackError(
            f"{where}: columns {', '.join(head)}; expected Caliscope's cam_id, frame_index and keypoint_id."
        )
    port, point, at_frame = (at for at in places if at is not None)
    x, y = head.index("img_loc_x"), head.index("img_loc_y")
    _check_columns(rows, head, where)
    if "obj_loc_x" in head and rows[1][head.index("obj_loc_x")].strip():
        raise HandtrackError(f"{where}: corners of a calibration board, and no joints.")
    number = re.search(r"\d+", camera)
    ports = sorted({row[port] for row in rows[1:]})
    if number is None or str(int(number[0])) not in ports:
        raise HandtrackError(
            f"{where}: cameras {', '.join(ports)} are in it, and none has the number of '{camera}'."
        )
    found: dict[int, dict[int, tuple[float, float]]] = {}
    for i, row in enumerate(rows[1:]):
        if row[port] == str(int(number[0])):
            frame = _frame(row[at_frame], i, where)
            number_of_point = frame_of(number_in(row[point], where), where)
            found.setdefault(frame, {})[number_of_point] = (
                number_in(row[x], where),
                number_in(row[y], where),
            )
    count = 1 + max(max(points) for points in found.values())
    count = next((n for n in _CALISCOPE_COUNTS if n >= count), count)
    columns = np.full((len(found), count, 3), (math.nan, math.nan, 0.0))
    for one, points in zip(columns, found.values(), strict=True):
        one[list(points)] = [(*place, 1.0) for place in points.values()]
    tree = {
        frame: [{"keypoints": one[:, :2].tolist(), "keypoint_scores": one[:, 2].tolist()}]
        for frame, one in zip(found, columns, strict=True)
    }
    given = read_json_joints(tree, where)
    if given is None or (count == len(JOINTS) and not given.has_hand):
        names = list(map(str, range(count)))
        given = table_joints("", names, columns, list(found), where, "mediapipe21")
    return replace(given, family="Caliscope's xy.csv")


def _rows_in_order(rows: list[list[str]], head: list[str], where: str) -> ImportedJoints:
    """Return hands of 21 rows each, in MediaPipe's order, by time stamp and hand; frames are counted by their usual distance."""
    at_time, at_hand = (column_of(head, names) for names in (_TIME, _HAND))
    assert at_time is not None
    x, y = head.index("x"), head.index("y")
    groups: dict[tuple[float, str], list[tuple[float, float]]] = {}
    _check_columns(rows, head, where)
    for row in rows[1:]:
        key = number_in(row[at_time], where), "" if at_hand is None else side_in(row[at_hand])
        groups.setdefault(key, []).append((number_in(row[x], where), number_in(row[y], where)))
    wrong = next((key for key, points in groups.items() if len(points) != len(JOINTS)), None)
    if wrong is not None:
        raise HandtrackError(
            f"{where}: {len(groups[wrong])} rows at the time {wrong[0]:g}; expected a hand's {len(JOINTS)}, in MediaPipe's order."
        )
    times = sorted({time for time, _ in groups})
    usual = float(np.median(np.diff(times))) if len(times) > 1 else 1.0
    hands: dict[str, dict[int, Hand]] = {}
    for (time, side), points in groups.items():
        frame = round((time - times[0]) / usual)
        hands.setdefault(side, {})[frame] = hand_of(JOINTS, np.array(points), np.ones(len(JOINTS)))
    note = f"{where}: frames are counted from the first time stamp, {usual:g} apart, as the file has no frame numbers."
    return ImportedJoints("a CSV of time stamps", hands, "mediapipe21", notes=(note,))


def _a_row_a_point(
    rows: list[list[str]], head: list[str], where: str, known: Names
) -> ImportedJoints:
    at_frame, at_point, at_hand, at_sure = (
        column_of(head, names) for names in (_FRAME, _POINT, _HAND, _SURE)
    )
    assert at_point is not None
    if at_frame is None:
        raise HandtrackError(f"{where}: no column `frame` beside {', '.join(head)}.")
    x, y = head.index("x"), head.index("y")
    cells: dict[tuple[int, str], tuple[float, float, float]] = {}
    _check_columns(rows, head, where)
    for i, row in enumerate(rows[1:]):
        hand = "" if at_hand is None else side_in(row[at_hand])
        sure = 1.0 if at_sure is None else number_in(row[at_sure], where)
        key = _frame(row[at_frame], i, where), f"{hand} {row[at_point]}".strip()
        cells.setdefault(key, (number_in(row[x], where), number_in(row[y], where), sure))
    names = list(dict.fromkeys(name for _, name in cells))
    frames = sorted({frame for frame, _ in cells})
    if len(names) > 200:
        raise HandtrackError(f"{where}: {len(names)} different points; expected a hand's 21.")
    missing = (math.nan, math.nan, 0.0)
    columns = np.array([[cells.get((frame, name), missing) for name in names] for frame in frames])
    names = renamed(names, known, where)
    return table_joints("a CSV with a row a point", names, columns, frames, where, _layout(names))


def _a_row_a_frame(rows: list[list[str]], where: str, known: Names) -> ImportedJoints | None:
    places: dict[str, dict[str, int]] = {}
    for i, column in enumerate(rows[0]):
        match = _NUMBER.fullmatch(column.strip())
        if match and (match[1] or match[3]):
            between = "_" if re.fullmatch(r"(?:h|hand)_?\d+", match[1], re.IGNORECASE) else ""
            name = f"{match[1]}{between}{match[3]}".strip("_. ")
            kind = match[2].lower()
            places.setdefault(name, {}).setdefault(kind if kind in "xyz" else "sure", i)
    names = [name for name, kinds in places.items() if "x" in kinds and "y" in kinds]
    if len(names) < 3:
        return None
    head = [name.strip().lower() for name in rows[0]]
    at = column_of(head, _FRAME)
    columns = _columns(
        rows[1:], [[places[n].get(k) for k in ("x", "y", "sure")] for n in names], where
    )
    frames = [
        i if at is None else _frame(row[at] if at < len(row) else "", i, where)
        for i, row in enumerate(rows[1:])
    ]
    if len(set(frames)) < len(frames):
        raise HandtrackError(f"{where}: a frame stands in two rows; expected one row a frame.")
    numbered = [re.fullmatch(r"(?:h|hand)_?(\d+)[_ ](\d+)", name.lower()) for name in names]
    if all(numbered):  # h0_x0: which of the hands, which of its points
        there = np.asarray(np.isfinite(columns[..., :2]).all(axis=(0, 2)))
        hands = {match[1] for match, seen in zip(numbered, there, strict=True) if match and seen}
        if len(hands) > 1:
            raise HandtrackError(
                f"{where}: hands {', '.join(sorted(hands))} without a side; expected one, or columns named by side."
            )
        kept = [i for i, match in enumerate(numbered) if match and match[1] in hands]
        names, columns = [str(numbered[i][2]) for i in kept], columns[:, kept]  # type: ignore[index]
    names = renamed(names, known, where)
    return table_joints("a CSV with a row a frame", names, columns, frames, where, _layout(names))


def _layout(names: Sequence[str]) -> str | None:
    """Return MediaPipe's layout where its own names, or bare numbers, stand there."""
    words = " ".join(names).upper()
    return (
        "mediapipe21"
        if "_FINGER_MCP" in words
        or not re.search(r"[A-Z]{4}", re.sub("RIGHT|LEFT|HAND|LANDMARK", "", words))
        else None
    )


def _columns(rows: list[list[str]], places: Sequence[_Places], where: str) -> Floats[F, N, D3]:
    used = {at for triple in places for at in triple if at is not None}
    width = max(used) + 1
    every = [
        [number_in(row[i], where) if i in used and i < len(row) else math.nan for i in range(width)]
        for row in rows
    ]
    return columns_of(np.reshape(every, (len(rows), width)), places)


def columns_of(values: Floats[F, M], places: Sequence[_Places]) -> Floats[F, N, D3]:
    """Return column, row [px] and confidence of points, from a table's numbers.

    Parameters
    ----------
    places
        In which of its columns those of each point are; without one the confidence is 1, in an
        empty cell 0.
    """
    count = len(values)
    padded = np.column_stack([values, np.ones(count), np.full(count, np.nan)])
    missing = -1, -1, -2
    chosen = [[m if at is None else at for at, m in zip(triple, missing)] for triple in places]
    columns = padded[:, chosen]
    columns[..., 2] = np.nan_to_num(columns[..., 2])
    return columns


def _check_columns(rows: list[list[str]], head: list[str], where: str) -> None:
    """Raise HandtrackError where a row lacks columns."""
    for i, row in enumerate(rows[1:], 2):
        if len(row) < len(head):
            raise HandtrackError(f"{where}: row {i} has {len(row)} of {len(head)} columns.")


def _frame(text: str, otherwise: int, where: str) -> int:
    try:
        return frame_of(float(text), where) if text.strip() else otherwise
    except ValueError:
        return frame_number(text)
