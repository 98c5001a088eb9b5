"""Ground truth: our own file, and as motion capture writes it; the same joints in metres, or refused in a sentence."""

import os

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from handtrack import HandtrackError
from handtrack.arrays import D3, D21, F, Floats
from handtrack.capture.joints.given_joints import JOINTS
from handtrack.session.truth import import_truth, read_truth
from handtrack.session.truth import write_truth as write_given
from tests.capture.sample_files import forms, sample
from tests.conftest import refused
from tests.session.small_session import keypoints, write_truth

NOT_FINITE = np.zeros((4, 21, 3))
NOT_FINITE[2, 5, 1] = np.inf
BAD = {
    "nothing": (
        {"keypoints21": None, "joint_positions": None},
        "no keypoints21 and no joint_positions; expected at least one. Found: joint_names, time_s",
    ),
    "20 keypoints": (
        {"keypoints21": np.zeros((4, 20, 3))},
        r"shape \(4, 20, 3\); expected \(4, 21, 3\)",
    ),
    "infinite": ({"keypoints21": NOT_FINITE}, "keypoints21 .*first in row 2"),
    "no names": (
        {"joint_names": None},
        "joint_positions without joint_names; expected a name for each",
    ),
    "names are numbers": (
        {"joint_names": np.arange(2)},
        "joint_names holds int64; expected text",
    ),
    "frame twice": ({"frame": np.array([0, 1, 1, 2])}, "frame has negative or repeated numbers"),
    "time": ({"time_s": np.array([0, 1, 2, np.inf])}, "time_s .*expected finite seconds"),
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


@pytest.mark.parametrize("form", [form for form in forms("truth") if "inch" not in form])
def test_every_form_gives_the_same_joints(form, tmp_path):
    truth, note = import_truth(*sample(form, tmp_path), "right")
    write_given(tmp_path / "truth.npz", truth)
    read = read_truth(tmp_path / "truth.npz")
    assert_allclose(read.keypoints21, moving(), rtol=0, atol=1e-7)
    assert read.frame.tolist() == [0, 1, 2]
    assert (note == "") == (form != "truth/trc")
    if form in ("truth/trc", "truth/c3d"):
        assert_allclose(read.time_s, [0, 0.01, 0.02], atol=1e-9)


GAPS = [(1, "wrist"), (2, "wrist"), (1, "ring_pip")]


def with_gaps(form, path):
    """Write the three frames without some points."""
    (path,) = sample(f"truth/{form}", path)
    if form == "long_csv":
        lines = path.read_text().splitlines()
        gaps = tuple(f"{frame},{name}," for frame, name in GAPS)
        path.write_text("\n".join(line for line in lines if not line.startswith(gaps)))
        return path
    rows = [line.split("\t") for line in path.read_text().splitlines()]
    for frame, name in GAPS:
        at = 2 + 3 * JOINTS.index(name)
        rows[6 + frame][at : at + 3] = ["", "", ""]
    path.write_text("\n".join("\t".join(row) for row in rows) + "\n")
    return path


@pytest.mark.parametrize("form", ["long_csv", "trc"])
def test_a_gap_is_one_points_and_not_the_frames(form, tmp_path):
    truth, note = import_truth(with_gaps(form, tmp_path), "right")
    expected = moving()
    for frame, name in GAPS:
        expected[frame, JOINTS.index(name)] = np.nan
    assert truth.frame.tolist() == [0, 1, 2]
    assert_allclose(truth.keypoints21, expected, rtol=0, atol=1e-7)
    assert "3 of 63" in note
    write_given(tmp_path / "truth.npz", truth)
    assert_array_equal(read_truth(tmp_path / "truth.npz").keypoints21, truth.keypoints21)


def test_what_is_made_to_do_harm_is_refused(tmp_path):
    os.mkfifo(tmp_path / "pipe.trc")
    refused("is a pipe", import_truth, tmp_path / "pipe.trc", "right")
    with (tmp_path / "huge.trc").open("wb") as file:
        file.truncate(1 << 34)
    refused("is not read", import_truth, tmp_path / "huge.trc", "right")
    refused("span .*which is no hand", import_truth, *sample("truth/inch_csv", tmp_path), "right")
    refused("left.*right", import_truth, *sample("truth/cm_csv", tmp_path), "left")
    (tmp_path / "bad.c3d").write_bytes(b"\x02\x50" + bytes(2000))
    unread = "needs c3d|not readable as C3D|announces|frames in"
    refused(unread, import_truth, tmp_path / "bad.c3d", "right")
