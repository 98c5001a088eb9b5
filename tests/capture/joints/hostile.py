"""Files of 2D joints that cannot be taken: made to do harm, of other things, or that leave something open."""

import json
import os
import pickle
from collections.abc import Callable
from pathlib import Path

import numpy as np

from handtrack.capture.joints.given_joints import JOINTS
from tests.capture.sample_files import sample


def _text(text):
    def write(folder):
        (folder / "j.txt").write_text(text)
        return folder / "j.txt"

    return write


def _empty_folder(folder):
    (folder / "joints").mkdir()
    return folder / "joints"


def _changed(form, change):
    """Return what writes a sample in HDF5 with something changed."""

    def write(folder):
        import h5py  # pyright: ignore[reportMissingImports]

        (path,) = sample(f"hands/{form}", folder)
        with h5py.File(path, "a") as file:
            change(file)
        return path

    return write


def _other_tracks(*shape, **options):
    def change(file):
        del file["tracks"]
        file.create_dataset("tracks", shape, "f8", **options)

    return _changed("sleap_h5", change)


def _pickled(file):
    harm = pickle.dumps([(1, [_Harm()])], protocol=0)
    file["df_with_missing"].attrs["non_index_axes"] = np.bytes_(harm)


def _cut_off(folder):
    (path,) = sample("hands/sleap_h5", folder)
    path.write_bytes(path.read_bytes()[:900])
    return path


class _Harm:
    def __reduce__(self) -> tuple:
        return (os.system, ("touch harmed",))


_HEAD = "frame," + ",".join(f"{name}_{axis}" for name in JOINTS for axis in "xy") + "\n"
HOSTILE: dict[str, tuple[Callable[[Path], Path], list[str]]] = {
    "nothing": (_text(""), ["no joints that are known here"]),
    "an empty folder": (_empty_folder, ["nothing matches", "one JSON file a frame"]),
    "JSON of others": (_text('{"a": [1, 2]}'), ["no joints that are known here"]),
    "no numbers": (_text('[{"hand_landmarks": [[{"x": "a", "y": 1}]]}]'), ["frame 0", "no numbers"]),
    "19 points": (_text(json.dumps([{"keypoints": [[1, 2]] * 19, "keypoint_scores": [1] * 19}])), ["people of 19 points", "halpe26 (26)"]),
    "a negative frame": (_text('[{"frame": -1, "hand_landmarks": []}]'), ["frame -1"]),
    "a frame far off": (_text(_HEAD + "1e15" + ",5" * 42), ["expected a whole number from 0"]),
    "a formula": (_text(_HEAD + "0,=1+1" + ",5" * 41), ["'=1+1'", "expected a number"]),
    "a frame twice": (_text(_HEAD + ("0" + ",5" * 42 + "\n") * 2), ["a frame stands in two rows"]),
    "a mouse": (_text("frame,nose_x,nose_y,tail_x,tail_y,ear_x,ear_y\n0,1,2,3,4,5,6\n"), ["(nose, tail, ear, …)", "no hand's"]),
    "a joint twice": (_text(_HEAD.replace("index_pip", "INDEX_FINGER_MCP") + "0" + ",5" * 42), ["are both index_mcp"]),
}  # fmt: skip
HDF5: dict[str, tuple[Callable[[Path], Path], list[str]]] = {
    "a pickle": (
        _changed("deeplabcut_h5", _pickled),
        ["not readable as DeepLabCut", "it asks for"],
    ),
    "another file's bytes": (
        _other_tracks(1, 2, 21, 3, external=[("/etc/passwd", 0, 1008)]),
        ["lies in another file"],
    ),
    "terabytes": (
        _other_tracks(1, 2, 21, 1 << 40, chunks=(1, 2, 21, 64), compression="gzip"),
        ["would take", "expected at most 1"],
    ),
    "cut off": (_cut_off, ["not readable as DeepLabCut or SLEAP"]),
}
