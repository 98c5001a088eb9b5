"""truth.npz: read, and refused when it is malformed."""

from typing import Any

import numpy as np
import pytest

from handtrack.errors import HandtrackError
from handtrack.session.formats.truth import read_truth
from tests.session.small_session import write_truth


def test_reads_all_arrays(tmp_path):
    write_truth(tmp_path)
    truth = read_truth(tmp_path / "truth.npz")
    assert truth.frame.tolist() == [0, 1, 2, 3]
    assert truth.keypoints21 is not None
    assert truth.keypoints21.shape == (4, 21, 3)
    assert truth.joint_names == ("wrist", "palm")
    assert truth.time_s is not None
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
