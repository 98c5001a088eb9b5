"""Joints in HDF5: DeepLabCut's tables and SLEAP's analysis files, by h5py, and SLEAP's own .slp, by sleap-io: both optional.

Pandas writes the names of columns as a pickle. It is read by an unpickler that knows lists, tuples, texts and numbers only.
"""

from __future__ import annotations

import io
import pickle
from pathlib import Path
from typing import Any

import numpy as np

from handtrack.capture.joints.csv_joints import Names, bodies_of_table, renamed, table_joints
from handtrack.capture.joints.given_joints import ImportedJoints
from handtrack.capture.joints.point_tables import IN_IMAGES, points_of_columns
from handtrack.errors import HandtrackError

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
            table = _table(file, h5py)
            return None if table is None else _deeplabcut(table, path, names)
    except (HandtrackError, MemoryError):
        raise
    except Exception as error:  # h5py and pickle fail in many ways on damaged bytes
        raise HandtrackError(
            f"{path}: not readable as DeepLabCut or SLEAP write it ({str(error)[:120]})."
        ) from None


def _table(file: Any, h5py: Any) -> Any:
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
    sure = np.ones(0) if scores is None else _array(scores, str(path)).astype(float)
    if sure.shape != tracks[:, 0].shape:
        sure = np.ones_like(tracks[:, 0])
    names = renamed(names, known, str(path))
    return _by_names(
        names, tracks.transpose(0, 3, 2, 1), sure.transpose(0, 2, 1), path, "SLEAP's analysis file"
    )


def _by_names(
    names: list[str], places: np.ndarray, sure: np.ndarray, path: Path, family: str
) -> ImportedJoints:
    """places: (tracks, frames, nodes, 2). sure: (tracks, frames, nodes)."""
    every = np.concatenate([places, np.nan_to_num(sure, nan=1.0)[..., None]], axis=-1)
    bodies = bodies_of_table(names, every.transpose(1, 0, 2, 3), range(every.shape[1]), str(path))
    if bodies is not None:
        return ImportedJoints(family, {}, bodies=bodies)
    seen = np.isfinite(places).all(axis=-1).sum(axis=(1, 2))
    if (seen > 0).sum() > 1:
        raise HandtrackError(
            f"{path}: {int((seen > 0).sum())} animals or hands (tracks); export one, or name its points by side."
        )
    columns = every[int(np.argmax(seen))]
    return table_joints(family, names, columns, range(len(columns)), str(path))


def _slp(path: Path, known: Names) -> ImportedJoints:
    try:
        import sleap_io  # pyright: ignore[reportMissingImports]
    except ImportError:
        raise HandtrackError(
            f"{path} is SLEAP's own file, which needs sleap-io: pip install sleap-io, or export an analysis file (.h5) in SLEAP."
        ) from None
    labels = sleap_io.load_slp(str(path), open_videos=False)
    places = np.asarray(labels.numpy(return_confidence=True), dtype=float).transpose(1, 0, 2, 3)
    names = [str(name) for name in labels.skeletons[0].node_names]
    names = renamed(names, known, str(path))
    return _by_names(names, places[..., :2], places[..., 2], path, "SLEAP's .slp")


class _Plain(pickle.Unpickler):
    def find_class(self, module: str, name: str) -> Any:
        raise pickle.UnpicklingError(f"it asks for {module}.{name}")


def _deeplabcut(group: Any, path: Path, known: Names) -> ImportedJoints:
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
    single = {name[1] for name in names if len(name) > 3}
    if len(single - {"single"}) > 1:
        raise HandtrackError(
            f"{path}: several individuals ({', '.join(sorted(single))}); export one."
        )
    heads = {i: (name[-2], name[-1]) for i, name in enumerate(names)}
    points, columns = points_of_columns(heads, values, IN_IMAGES, str(path))
    index = rows["index"] if "index" in rows.dtype.names else np.zeros(0)
    frames = list(map(int, index)) if index.dtype.kind in "iu" else range(len(rows))
    points = renamed(points, known, str(path))
    return table_joints("DeepLabCut's HDF5", points, columns, frames, str(path))
