"""Joints in CSV: DeepLabCut's tables, and dumps with a column a number or a row a point."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from handtrack.arrays import D3, F, Floats, M, N
from handtrack.capture.joints.given_joints import (
    HANDS_IN,
    BodyPoints,
    Hand,
    ImportedBodies,
    ImportedJoints,
    body_of,
    checked_bodies,
    cleaned,
    hand_of,
    named_points,
)
from handtrack.capture.joints.joint_names import NAMED, is_numbered, named_bodies
from handtrack.capture.joints.point_tables import (
    IN_IMAGES,
    cells,
    frame_in,
    points_of_columns,
    read_points,
)
from handtrack.errors import HandtrackError
from handtrack.files.text_files import read_rows

Names = Mapping[str, str]
"""our names of a file's own points, with their side where it has both hands, as `right index_tip`"""


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
    table = read_points(rows, where, IN_IMAGES, camera)
    if table is None:
        return None
    head = [name.strip().lower() for name in rows[0]]
    if "obj_loc_x" in head and rows[1][head.index("obj_loc_x")].strip():
        raise HandtrackError(f"{where}: corners of a calibration board, and no joints.")
    points, values = list(table.names), table.values
    numbered = [re.fullmatch(r"(?:h|hand)_?(\d+)[_ ](\d+)", name.lower()) for name in points]
    if all(numbered):  # h0_x0: which of the hands, which of its points
        there = np.asarray(np.isfinite(values[..., :2]).all(axis=(0, 2)))
        hands = {match[1] for match, seen in zip(numbered, there, strict=True) if match and seen}
        if len(hands) > 1:
            raise HandtrackError(
                f"{where}: hands {', '.join(sorted(hands))} without a side; expected one, or columns named by side."
            )
        kept = {i: match[2] for i, match in enumerate(numbered) if match and match[1] in hands}
        points, values = list(kept.values()), values[:, list(kept)]
    points = renamed(points, names, where)
    words = " ".join(points).upper()
    own = "_FINGER_MCP" in words or not re.search(
        r"[A-Z]{4}", re.sub("RIGHT|LEFT|HAND|LANDMARK", "", words)
    )
    family = "Caliscope's xy.csv" if "img_loc_x" in head else "a CSV of points"
    layout = "mediapipe21" if own else None  # its own names, or bare numbers
    found = table_joints(family, points, values, table.frames, where, layout)
    return replace(found, notes=table.notes)


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
    frames: Iterable[int],
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
    frames = [int(frame) for frame in frames]
    bodies, unknown = bodies_of_table(names, columns[:, None], frames, where), ()
    if bodies is not None and bodies.layout is None:  # numbered, and not as a hand's are
        sides, layout = HANDS_IN.get(len(names), {}), None
    else:
        try:
            sides, unknown = named_points(names, where)
        except HandtrackError:
            if bodies is None:
                raise
            sides = {}
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
    columns = {i: pair for i, pair in enumerate(zip(parts, kinds)) if i >= first}
    names, values = points_of_columns(columns, cells(body, columns, where), IN_IMAGES, where)
    frames = [frame_in("".join(row[:first][-1:]) or row[0], i, where) for i, row in enumerate(body)]
    return table_joints("DeepLabCut's CSV", renamed(names, known, where), values, frames, where)
