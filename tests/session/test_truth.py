"""Ground truth: our own file, and as motion capture writes it; the same joints in metres, or refused in a sentence."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from handtrack.arrays import D3, D21, F, Floats
from handtrack.capture.joints.joint_names import JOINTS
from handtrack.errors import HandtrackError
from handtrack.session.formats.given_truth import read_given_truth
from handtrack.session.formats.given_truth import write_truth as write_given
from handtrack.session.formats.truth import read_truth
from tests.session.small_session import keypoints, write_truth


def test_reads_all_arrays(tmp_path):
    write_truth(tmp_path)
    truth = read_truth(tmp_path / "truth.npz")
    assert truth.frame.tolist() == [0, 1, 2, 3]
    assert truth.keypoints21.shape == (4, 21, 3)
    assert truth.joint_names == ("wrist", "palm")
    assert truth.time_s[3] == pytest.approx(0.3)


NOT_FINITE = np.zeros((4, 21, 3))
NOT_FINITE[2, 5, 1] = np.inf
BAD: dict[str, tuple[dict[str, Any], str]] = {
    "nothing": (
        {"keypoints21": None, "joint_positions": None},
        "no keypoints21 and no joint_positions; expected at least one. Found: joint_names, time_s",
    ),
    "20 keypoints": (
        {"keypoints21": np.zeros((4, 20, 3))},
        r"shape \(4, 20, 3\); expected \(F, 21, 3\)",
    ),
    "two axes": (
        {"keypoints21": np.zeros((21, 3))},
        r"keypoints21 has the shape \(21, 3\) of float64",
    ),
    "infinite": ({"keypoints21": NOT_FINITE}, "keypoints21 .*first in row 2"),
    "names": (
        {"joint_names": np.array(["wrist"])},
        r"has 2 joints, .* as many texts; found shape \(1,\)",
    ),
    "no names": ({"joint_names": None}, "joint_names must be as many texts; found none"),
    "names are numbers": (
        {"joint_names": np.arange(2)},
        "must be as many texts; found shape .* of int64",
    ),
    "counts": (
        {"joint_positions": np.zeros((3, 2, 3))},
        r"differ in their number of frames: \[3, 4\]",
    ),
    "frame count": (
        {"frame": np.arange(3)},
        r"frame has the shape \(3,\) of int64; expected \(4,\) int",
    ),
    "frame kind": ({"frame": np.arange(4.0)}, "frame has the shape .* of float64; expected"),
    "frame twice": ({"frame": np.array([0, 1, 1, 2])}, "frame has negative or repeated numbers"),
    "time": ({"time_s": np.array([0, 1, 2, np.inf])}, r"time_s .*expected \(4,\) finite seconds"),
    "pickled": (
        {"joint_names": np.array(["a", None], object)},
        "not a readable .npz of plain arrays",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_malformed_truth_is_refused(case, tmp_path):
    changes, message = BAD[case]
    write_truth(tmp_path, **changes)
    with pytest.raises(HandtrackError, match=message) as caught:
        read_truth(tmp_path / "truth.npz")
    assert "truth.npz" in str(caught.value)


FRAMES = 3


def moving() -> Floats[F, D21, D3]:
    """Return a hand's points in three frames [m]."""
    return keypoints() + 0.01 * np.arange(FRAMES)[:, None, None] + [0.1, -0.2, 0.5]


def trc(path: Path) -> Path:
    """In millimetres, counted from 1, with a marker that is no joint."""
    names = [*JOINTS, "Elbow"]
    lines = [
        f"PathFileType\t4\t(X/Y/Z)\t{path.name}",
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames",
        f"100.00\t100.00\t{FRAMES}\t{len(names)}\tmm\t100.00\t1\t{FRAMES}",
        "Frame#\tTime\t" + "\t\t\t".join(names) + "\t\t",
        "\t\t" + "\t".join(f"{axis}{i + 1}" for i in range(len(names)) for axis in "XYZ"),
        "",
    ]
    for i, rows in enumerate(moving()):
        lines.append("\t".join(map(str, [i + 1, i / 100, *(1000 * rows).ravel(), 1, 2, 3])))
    path.write_text("\n".join(lines) + "\n")
    return path


def wide_csv(path: Path, factor: float = 100.0, unit: str = "") -> Path:
    head = [
        "frame",
        "time_s",
        *(f"R_{name.upper()}_{axis}{unit}" for name in JOINTS for axis in "xyz"),
    ]
    rows = [[i, i / 100, *(factor * points).ravel()] for i, points in enumerate(moving())]
    path.write_text("\n".join(",".join(map(str, row)) for row in [head, *rows]))
    return path


def long_csv(path: Path) -> Path:
    rows = [[i, name, *moving()[i, k]] for i in range(FRAMES) for k, name in enumerate(JOINTS)]
    path.write_text(
        "\n".join(",".join(map(str, row)) for row in [["frame", "joint", "x", "y", "z"], *rows])
    )
    return path


def c3d_file(path: Path) -> Path:
    """By ezc3d, which writes what the c3d library reads."""
    ezc3d = pytest.importorskip("ezc3d")
    pytest.importorskip("c3d")
    file = ezc3d.c3d()
    file["parameters"]["POINT"]["RATE"]["value"] = [100]
    file["parameters"]["POINT"]["UNITS"]["value"] = ["mm"]
    file["parameters"]["POINT"]["LABELS"]["value"] = list(JOINTS)
    file["data"]["points"] = np.concatenate(
        [1000 * moving().transpose(2, 1, 0), np.ones((1, 21, FRAMES))]
    )
    file.write(str(path))
    return path


WRITERS: dict[str, Callable[[Path], Path]] = {
    "trc": trc, "cm.csv": wide_csv, "mm.csv": lambda path: wide_csv(path, 1000.0, "_mm"), "long.csv": long_csv, "c3d": c3d_file,
}  # fmt: skip


@pytest.mark.parametrize("form", WRITERS)
def test_every_form_gives_the_same_joints(form, tmp_path):
    truth, note = read_given_truth(WRITERS[form](tmp_path / f"truth.{form}"), "right")
    write_given(tmp_path / "truth.npz", truth)
    read = read_truth(tmp_path / "truth.npz")
    np.testing.assert_allclose(read.keypoints21, moving(), rtol=0, atol=1e-7)
    assert read.frame.tolist() == [0, 1, 2]
    assert (note == "") == (form != "trc")
    if form in ("trc", "c3d"):
        np.testing.assert_allclose(read.time_s, [0, 0.01, 0.02], atol=1e-9)


GAPS = [(1, "wrist"), (2, "wrist"), (1, "ring_pip")]


def with_gaps(form: str, path: Path) -> Path:
    """Write the three frames without some points."""
    if form == "long.csv":
        lines = long_csv(path).read_text().splitlines()
        gaps = tuple(f"{frame},{name}," for frame, name in GAPS)
        path.write_text("\n".join(line for line in lines if not line.startswith(gaps)))
        return path
    rows = [line.split("\t") for line in trc(path).read_text().splitlines()]
    for frame, name in GAPS:
        at = 2 + 3 * JOINTS.index(name)
        rows[6 + frame][at : at + 3] = ["", "", ""]
    path.write_text("\n".join("\t".join(row) for row in rows) + "\n")
    return path


@pytest.mark.parametrize("form", ["long.csv", "trc"])
def test_a_gap_is_one_points_and_not_the_frames(form, tmp_path):
    truth, note = read_given_truth(with_gaps(form, tmp_path / f"t.{form}"), "right")
    expected = moving()
    for frame, name in GAPS:
        expected[frame, JOINTS.index(name)] = np.nan
    assert truth.frame.tolist() == [0, 1, 2]
    np.testing.assert_allclose(truth.keypoints21, expected, rtol=0, atol=1e-7)
    assert "3 of 63" in note
    write_given(tmp_path / "truth.npz", truth)
    np.testing.assert_array_equal(read_truth(tmp_path / "truth.npz").keypoints21, truth.keypoints21)


def test_what_is_made_to_do_harm_is_refused(tmp_path):
    os.mkfifo(tmp_path / "pipe.trc")
    with pytest.raises(HandtrackError, match="is a pipe"):
        read_given_truth(tmp_path / "pipe.trc", "right")
    with (tmp_path / "huge.trc").open("wb") as file:
        file.truncate(1 << 34)
    with pytest.raises(HandtrackError, match="is not read"):
        read_given_truth(tmp_path / "huge.trc", "right")
    with pytest.raises(HandtrackError, match="span .*which is no hand"):
        read_given_truth(wide_csv(tmp_path / "inch.csv", 5.0), "right")
    with pytest.raises(HandtrackError, match="no left hand; there is a right one"):
        read_given_truth(wide_csv(tmp_path / "side.csv"), "left")
    (tmp_path / "bad.c3d").write_bytes(b"\x02\x50" + bytes(2000))
    with pytest.raises(HandtrackError, match=r"needs c3d|not readable as C3D|announces|frames in"):
        read_given_truth(tmp_path / "bad.c3d", "right")
