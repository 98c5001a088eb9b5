"""The other hand was tracked: `track` and `doctor` say so, where no joints were given that would tell (fault C31)."""

import json
import shutil
from pathlib import Path

import pytest

from handtrack import load_model, read_npz
from handtrack.model.pose_library import named_pose

DOUBT = "a left hand fits decisively better"


@pytest.fixture
def asked(monkeypatch):
    """The frames of each time that the side is asked for; it is always doubted."""
    times = []

    def doubted(*given):
        times.append(sorted(given[3]))  # type: ignore[call-overload]
        return DOUBT

    for place in ("handtrack.session.track_session", "handtrack.session.doctor.check_hand"):
        monkeypatch.setattr(f"{place}.wrong_side_warning", doubted)
    return times


def test_c31_track_and_doctor_name_the_other_side(handtrack, tracked, tmp_path, asked):
    session = Path(shutil.copytree(tracked, tmp_path / "session"))
    handtrack.does("track", session, "--frames", "0:2")
    assert DOUBT not in handtrack("doctor", session).out
    assert asked == []  # its first pose says where each joint is
    poses = read_npz(session / "tracks/poses.npz")
    row = dict(zip(poses.parameter_names, map(float, poses.parameters[0]), strict=True))
    (session / "init.json").write_text(json.dumps({"frame": 0, "parameters": row}))
    ended = handtrack.does("track", session, "--frames", "0:2", "--json", "--restart")
    assert asked == [[0, 1]]
    assert DOUBT in json.loads(ended.out)["warnings"]
    assert f"note: {DOUBT}" in ended.err
    assert f"warning: tracks/poses.npz: {DOUBT}" in handtrack("doctor", session).out


def test_joints_of_the_other_hand_are_asked_about_before_anything_is_tracked(
    handtrack, recorded, tmp_path
):
    session = Path(shutil.copytree(recorded, tmp_path / "session"))
    left = load_model(side="left")
    points = left.keypoints21(left.bones(named_pose(left, "pinch")))
    given = {"frame": 0, "convention": "openpose21", "unit": "m", "xyz": points.tolist()}
    (session / "init.json").write_text(json.dumps(given))
    out = tmp_path / "poses.npz"
    tracked = ("track", session, "--frames", "0:1", "--out", out)
    for asked in (tracked, (*tracked, "--init", session / "init.json"), ("size", session)):
        refused = handtrack(*asked)
        assert refused.code == 2
        assert "--yes" in refused.err
        assert not out.exists()
    handtrack.does(*tracked, "--yes")
    assert out.exists()
