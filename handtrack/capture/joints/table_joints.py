"""Joints in tables, CSV and HDF5: DeepLabCut's, SLEAP's, and dumps with a column a number or a row a point."""

from __future__ import annotations

import io
import pickle
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from handtrack.arrays import D3, F, Floats, Ints, M, N
from handtrack.capture.images.frames import frame_number
from handtrack.capture.joints.given_joints import (
    HANDS_IN,
    JOINTS,
    NAMED,
    BodyPoints,
    Hand,
    ImportedBodies,
    ImportedJoints,
    body_of,
    checked_bodies,
    cleaned,
    frame_of,
    hand_of,
    is_numbered,
    named_bodies,
    named_points,
    side_in,
)
from handtrack.errors import HandtrackError
from handtrack.files.text_files import UNITS_M, column_of, number_in, read_rows

# ---- Tables of points by name and frame, in images or in space: a row a frame with a column for each number, or a row a point


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


# ---- Joints in such tables, and in DeepLabCut's


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
        rows = _deeplabcut(rows, heads, where)
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
    layout = "mediapipe21" if own else None  # its own names, or bare numbers
    family = "Caliscope's xy.csv" if "img_loc_x" in head else "a CSV of points"
    if "coords" in heads:
        family, layout = "DeepLabCut's CSV", None
    found = table_joints(family, points, values[None], table.frames, where, layout)
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
    tracks: Floats[M, F, N, D3],
    frames: Iterable[int],
    where: str,
    layout: str | None = None,
) -> ImportedJoints:
    """Return joints from points by name: a hand's, bodies', or both; of several tracks all bodies, and no hand.

    Parameters
    ----------
    tracks
        Of each hand or person column, row [px], confidence.

    Raises
    ------
    HandtrackError
        Where they are neither's, and for several hands.
    """
    frames = [int(frame) for frame in frames]
    bodies, unknown, sides = _bodies(names, tracks, frames, where), (), {}
    filled = [points for points in tracks if np.isfinite(points[..., :2]).all(axis=-1).any()]
    if bodies is not None and bodies.layout is None:  # numbered, and not as a hand's are
        sides, layout = HANDS_IN.get(len(names), {}), None
    elif bodies is None and len(filled) > 1:
        raise HandtrackError(
            f"{where}: {len(filled)} animals or hands (tracks); export one, or name its points by side."
        )
    else:
        try:
            sides, unknown = named_points(names, where)
        except HandtrackError:
            if bodies is None:
                raise
    hands: dict[str, dict[int, Hand]] = {}
    for side, chosen in sides.items() if len(filled) <= 1 else ():
        points, ours = list(chosen), list(chosen.values())
        hands[side] = {
            frame: hand_of(ours, row[points, :2], row[points, 2])
            for frame, row in zip(frames, (filled or tracks)[0], strict=True)
            if (np.isfinite(row[points, :2]).all(axis=1) & (row[points, 2] > 0)).any()
        }
    if layout is not None and len(hands) == 1:  # MediaPipe's sides are as in a mirror, or not
        hands = {"": next(iter(hands.values()))}
    return ImportedJoints(family, hands, layout, unknown, bodies=bodies)


def _bodies(
    names: Sequence[str], tracks: Floats[M, F, N, D3], frames: Sequence[int], where: str
) -> ImportedBodies | None:
    """Return the bodies of tracks' points by name; None where the names are no body's. Raises HandtrackError.

    Points that are but numbered from 0 are some detector's, as many as there are.
    """
    places = named_bodies(names)
    if places is None and not is_numbered(names):
        return None

    def body(points: Floats[N, D3]) -> BodyPoints:
        return cleaned(points) if places is None else body_of(points, places)

    people = {
        frame: [one for one in map(body, tracks[:, row]) if (one[:, 2] > 0).any()]
        for row, frame in enumerate(frames)
    }
    unknown = tuple(name for i, name in enumerate(names) if places and i not in places)
    return checked_bodies(people, where, NAMED if places else None, unknown)


def _deeplabcut(rows: list[list[str]], heads: list[str], where: str) -> list[list[str]]:
    """Return DeepLabCut's table with one header in place of its three or four, and one column of frames."""
    above = dict(zip(heads, rows))
    _check_single(above.get("individuals", [])[1:], where)
    columns = [*zip(above["bodyparts"], (kind.strip().lower() for kind in above["coords"]))]
    first = next((i for i, (_, kind) in enumerate(columns) if kind == "x"), 1)
    body = ([row[first - 1] or row[0], *row[first:]] for row in rows[heads.index("coords") + 1 :])
    return [["frame", *map("_".join, columns[first:])], *body]


def _check_single(individuals: Iterable[str], where: str) -> None:
    several = dict.fromkeys(name for name in individuals if name not in ("", "single"))
    if len(several) > 1:
        raise HandtrackError(f"{where}: several individuals ({', '.join(several)}); export one.")


# ---- HDF5: DeepLabCut's tables and SLEAP's analysis files, by h5py, and SLEAP's own .slp, by sleap-io: both optional. Pandas writes the
# names of columns as a pickle, which is read by an unpickler that knows lists, tuples, texts and numbers only


_MOST_BYTES = 1 << 30  # of one array
_MOST_NAMES = 1 << 20  # bytes


def read_h5_joints(path: Path, names: Names) -> ImportedJoints | None:
    """Return the joints of a file, some of them named by a table; None for other HDF5. Raises HandtrackError, also where h5py is not installed."""
    try:
        import h5py  # pyright: ignore[reportMissingImports]
    except ImportError:
        raise HandtrackError(
            f"{path} is HDF5, which needs h5py: pip install handtrack3d[joints], or export CSV."
        ) from None
    try:
        with h5py.File(path, "r") as file:
            if "pose_links" in file or "instances" in file:
                return _slp(path, names)
            if "tracks" in file and "node_names" in file:
                return _sleap(file, path, names)
            table = _pandas_table(file, h5py)
            return None if table is None else _deeplabcut_h5(table, path, names)
    except (HandtrackError, MemoryError):
        raise
    except Exception as error:  # h5py and pickle fail in many ways on damaged bytes
        raise HandtrackError(
            f"{path}: not readable as DeepLabCut or SLEAP write it ({str(error)[:120]})."
        ) from None


def _pandas_table(file: Any, h5py: Any) -> Any:
    """Return pandas's table of the first group that has one."""
    for name in file:
        link = file.get(name, getlink=True)
        if (
            isinstance(link, h5py.HardLink)
            and isinstance(file[name], h5py.Group)
            and "table" in file[name]
        ):
            return file[name]
    return None


def _array(dataset: Any, where: str) -> np.ndarray[Any, Any]:
    """Return an array that lies in the file itself and is not too large."""
    if dataset.is_virtual or dataset.external:
        raise HandtrackError(f"{where}: {dataset.name} lies in another file, which is not read.")
    size = dataset.dtype.itemsize * int(np.prod(dataset.shape, dtype=object))
    if size > _MOST_BYTES:
        raise HandtrackError(
            f"{where}: {dataset.name} would take {size / 1e9:.0f} GB; expected at most {_MOST_BYTES / 1e9:.0f}."
        )
    return dataset[...]


def _sleap(file: Any, path: Path, known: Names) -> ImportedJoints:
    tracks = _array(file["tracks"], str(path)).astype(float)  # tracks, x y, nodes, frames
    names = [
        name.decode() if isinstance(name, bytes) else str(name)
        for name in _array(file["node_names"], str(path))
    ]
    if tracks.ndim != 4 or tracks.shape[1] != 2 or tracks.shape[2] != len(names):
        raise HandtrackError(
            f"{path}: tracks of the shape {tracks.shape}; expected (tracks, 2, {len(names)}, frames)."
        )
    scores = file.get("point_scores")
    sure = np.zeros(0) if scores is None else _array(scores, str(path)).astype(float)
    if sure.shape != tracks[:, 0].shape:
        sure = np.ones_like(tracks[:, 0])
    seen = np.concatenate([tracks, sure[:, None]], axis=1).transpose(0, 3, 2, 1)
    return _of_tracks("SLEAP's analysis file", names, seen, path, known)


def _slp(path: Path, known: Names) -> ImportedJoints:
    try:
        import sleap_io  # pyright: ignore[reportMissingImports]
    except ImportError:
        raise HandtrackError(
            f"{path} is SLEAP's own file, which needs sleap-io: pip install sleap-io, or export an analysis file (.h5) in SLEAP."
        ) from None
    labels = sleap_io.load_slp(str(path), open_videos=False)
    seen = np.array(labels.numpy(return_confidence=True), dtype=float).swapaxes(0, 1)
    names = [str(name) for name in labels.skeletons[0].node_names]
    return _of_tracks("SLEAP's .slp", names, seen, path, known)


def _of_tracks(
    family: str, names: list[str], seen: Floats[M, F, N, D3], path: Path, known: Names
) -> ImportedJoints:
    """seen: column, row and confidence, 1 where unknown, of each track."""
    seen[..., 2] = np.nan_to_num(seen[..., 2], nan=1.0)
    points = renamed(names, known, str(path))
    return table_joints(family, points, seen, range(seen.shape[1]), str(path))


class _Plain(pickle.Unpickler):
    def find_class(self, module: str, name: str) -> Any:
        raise pickle.UnpicklingError(f"it asks for {module}.{name}")


def _deeplabcut_h5(group: Any, path: Path, known: Names) -> ImportedJoints:
    packed = bytes(np.asarray(group.attrs["non_index_axes"]).item())
    if len(packed) > _MOST_NAMES:
        raise HandtrackError(
            f"{path}: names of {len(packed) / 1e6:.0f} MB; expected those of some points."
        )
    axes = _Plain(io.BytesIO(packed), encoding="utf-8").load()
    names = [tuple(map(str, name)) for name in axes[0][1]]
    rows = _array(group["table"], str(path))
    if "values_block_0" not in (rows.dtype.names or ()):
        raise HandtrackError(f"{path}: no table of numbers as pandas writes it.")
    values = rows["values_block_0"].astype(float)
    _check_single((name[1] for name in names if len(name) > 3), str(path))
    heads = {i: (name[-2], name[-1]) for i, name in enumerate(names)}
    points, columns = points_of_columns(heads, values, IN_IMAGES, str(path))
    index = rows["index"] if "index" in rows.dtype.names else np.zeros(0)
    frames = list(map(int, index)) if index.dtype.kind in "iu" else range(len(rows))
    points = renamed(points, known, str(path))
    return table_joints("DeepLabCut's HDF5", points, columns[None], frames, str(path))
