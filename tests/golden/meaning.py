"""What a file says, whatever its bytes: texts and numbers by name, for formats that are no text; and how two of them differ."""

from __future__ import annotations

import json
import math
import re
import zipfile
from collections.abc import Callable, Iterator
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
    known = {
        ".npz": _npz, ".glb": _glb, ".c3d": _c3d, ".mcap": _mcap, ".nc": _netcdf, ".nwb": _nwb, ".mp4": _film, ".zip": _zip, ".pose": _pose, ".html": _page, "": _log,
    }  # fmt: skip
    read: Callable[[Path], Any] = known.get(path.suffix, _text)
    return json.loads(json.dumps(read(path)).replace(VERSION, "VERSION"))


def _zip(path: Path) -> Any:
    with zipfile.ZipFile(path) as archive:
        return {name: json.loads(archive.read(name)) for name in archive.namelist()}


def _pose(path: Path) -> Any:
    from pose_format import Pose  # type: ignore[import]

    pose = Pose.read(path.read_bytes())
    parts = {part.name: part.points for part in pose.header.components}
    data, sure = pose.body.data.filled(0.0), pose.body.confidence
    return {
        "parts": parts,
        "fps": pose.body.fps,
        "data": array_told(data),
        "confidence": array_told(sure),
    }


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


def _glb(path: Path) -> dict[str, Any]:
    data = path.read_bytes()
    length = int.from_bytes(data[12:16], "little")
    tree, body = json.loads(data[20 : 20 + length]), data[28 + length :]
    kinds = {5121: np.uint8, 5125: np.uint32, 5126: np.float32}
    arrays = []
    for accessor in tree["accessors"]:
        view = tree["bufferViews"][accessor["bufferView"]]
        part = body[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]
        arrays.append(array_told(np.frombuffer(part, kinds[accessor["componentType"]])))
    return {"tree": tree, "arrays": arrays}


def _c3d(path: Path) -> dict[str, Any]:
    import ezc3d  # pyright: ignore[reportMissingImports]

    file = ezc3d.c3d(str(path))
    told = {
        f"{group}:{name}": array_told(entry["value"])
        for group, entries in file["parameters"].items()
        for name, entry in entries.items()
        if name != "__METADATA__" and group != "EZC3D"
    }
    points, residuals = file["data"]["points"], file["data"]["meta_points"]["residuals"]
    first = int(file["header"]["points"]["first_frame"])
    return told | {"first": first, "points": array_told(points), "residuals": array_told(residuals)}


def _mcap(path: Path) -> list[Any]:
    from mcap_ros2.reader import read_ros2_messages  # pyright: ignore[reportMissingImports]

    return [
        [m.schema.name, m.schema.data.decode(), m.channel.topic, m.log_time_ns, _ros(m.ros_msg)]
        for m in read_ros2_messages(str(path))
    ]


def _ros(message: Any) -> Any:
    """Return a ROS message as a tree."""
    if hasattr(message, "__slots__"):
        return {name: _ros(getattr(message, name)) for name in message.__slots__}
    return message if isinstance(message, str | int | float) else [_ros(part) for part in message]


def _netcdf(path: Path) -> dict[str, Any]:
    from scipy.io import netcdf_file

    with netcdf_file(path, mmap=False) as file:
        told = {n: v.decode() if isinstance(v, bytes) else v for n, v in file._attributes.items()}
        variables = {
            name: [list(v.dimensions), getattr(v, "units", b"").decode(), array_told(_words(v[:]))]
            for name, v in file.variables.items()
        }
    return {"attributes": {n: array_told(v) for n, v in told.items()}, "variables": variables}


def _words(values: Any) -> Any:
    """Return an array; rows of letters as words."""
    if values.dtype.kind != "S":
        return values.copy()
    return np.array([b"".join(row).decode() for row in values.reshape(-1, values.shape[-1])])


def _nwb(path: Path) -> dict[str, Any]:
    import h5py  # pyright: ignore[reportMissingImports]

    found: dict[str, Any] = {}
    with h5py.File(path) as file:
        file.visititems(lambda name, node: found.update({name: _hdf5(node)}))
    # the writer's own version, when it was written, and what is another one each time
    stamped = ("specifications", "file_create_date", "identifier", "session_start_time", "timestamps_reference_time")  # fmt: skip
    return {name: value for name, value in found.items() if not name.startswith(stamped)}


def _hdf5(node: Any) -> Any:
    own = {n: str(v) for n, v in node.attrs.items() if n in ("unit", "neurodata_type", "description")}  # fmt: skip
    if not hasattr(node, "shape"):
        return own
    values = np.asarray(node[()])
    if values.dtype.kind == "O":
        values = np.array([str(x) for x in values.ravel()]) if values.dtype.names is None else None
    return own | ({} if values is None or values.dtype.names else {"data": array_told(values)})


def _film(path: Path) -> dict[str, Any]:
    import cv2

    film = cv2.VideoCapture(str(path))
    count = 0
    while film.read()[0]:
        count += 1
    size = [int(film.get(k)) for k in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT)]
    return {"frames": count, "size": size, "fps": film.get(cv2.CAP_PROP_FPS)}
