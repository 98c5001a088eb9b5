"""`handtrack track --init auto`, and first poses as joints in images."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from handtrack.session.first_pose.first_pose_candidate import FirstPoseCandidate
from handtrack.session.first_pose.first_pose_search import find_first_poses
from handtrack.session.formats.tables import read_npz
from handtrack.session.session import Session
from handtrack.tracking.frame.result import Status
from handtrack_app.commands.terminal import first_pose
from handtrack_app.commands.terminal.first_pose import described, percent
from tests.app.command_line import CommandLine


@pytest.fixture
def session(recorded: Path, tmp_path: Path) -> Path:
    """A small recording without a first pose."""
    folder = Path(shutil.copytree(recorded, tmp_path / "session"))
    (folder / "init.json").unlink()
    return folder


def worst_error_mm(poses: Path, folder: Path) -> float:
    truth, found = Session.open(folder).truth, read_npz(poses)
    assert truth is not None
    assert truth.keypoints21 is not None
    assert found.keypoints21 is not None
    rows = np.searchsorted(truth.frame, found.frame)
    off = np.linalg.norm(found.keypoints21 - truth.keypoints21[rows], axis=2)
    return 1e3 * float(off.mean(axis=1).max())


def test_a_recording_without_a_first_pose(
    handtrack: CommandLine, session: Path, tmp_path: Path
) -> None:
    refused = handtrack("track", session)
    assert refused.code == 2
    assert "--init auto" in refused.err
    out = tmp_path / "poses.npz"
    ended = handtrack("track", session, "--init", "auto", "--frames", "0:3", "--out", out)
    assert ended.code == 0
    assert "first pose: frame " in ended.err
    assert "% sure (no forearm in view)." in ended.err
    assert "\n  or: " in ended.err
    assert worst_error_mm(out, session) < 1.0  # measured 0.1 mm
    assert (read_npz(out).start_confidence or 0.0) > 0.85


def test_a_start_that_is_not_sure_is_not_tracked_from_in_silence(
    handtrack: CommandLine, session: Path, tmp_path: Path
) -> None:
    """One camera cannot tell a large hand from a near one: such a start is a few per cent sure."""
    text = (session / "session.toml").read_text().split("[[camera]]")
    (session / "session.toml").write_text("[[camera]]".join(text[:2]))
    out = tmp_path / "poses.npz"
    asked = ("track", session, "--init", "auto", "--frames", "0:5", "--out", out)
    refused = handtrack(*asked)
    assert refused.code == 2
    assert "nothing was tracked" in refused.err
    assert "--yes" in refused.err
    assert not out.exists()
    ended = handtrack(*asked, "--yes")
    assert ended.code == 0
    sure = read_npz(out).start_confidence
    assert sure is not None
    assert 0.0 < sure < 0.85
    assert f"from a first pose that was {percent(sure)} sure" in ended.out


def test_a_start_that_is_not_sure_is_taken_where_the_next_frames_confirm_it(
    handtrack: CommandLine, session: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def unsure(*given: Any) -> list[FirstPoseCandidate]:
        return [replace(one, confidence=0.5) for one in find_first_poses(*given)]

    monkeypatch.setattr(first_pose, "find_first_poses", unsure)
    asked = ("track", session, "--init", "auto", "--out", tmp_path / "poses.npz", "--frames")
    assert handtrack(*asked, "0:4").code == 2, "too few to confirm it"
    ended = handtrack(*asked, "0:5")
    assert ended.code == 0
    assert "% sure" in ended.err
    assert (read_npz(tmp_path / "poses.npz").status == Status.TRACKED).all()


def test_joints_in_images_as_the_first_pose(
    handtrack: CommandLine, session: Path, tmp_path: Path
) -> None:
    opened = Session.open(session)
    assert opened.truth is not None
    assert opened.truth.keypoints21 is not None
    points = opened.truth.keypoints21[0]
    pixels = {name: opened.rig[name].project(points).tolist() for name in ("cam0", "cam1")}
    given = {"frame": 0, "convention": "openpose21", "unit": "px", "cameras": pixels}
    (session / "init.json").write_text(json.dumps(given))
    ended = handtrack("doctor", session)
    assert "keypoints in the images of 2 cameras at frame 0" in ended.out
    out = tmp_path / "poses.npz"
    ended = handtrack("track", session, "--frames", "0:2", "--out", out)
    assert ended.code == 0
    assert "first pose: frame 0, 99 % sure (2 cameras agree on 21 of 21 joints)." in ended.err
    assert worst_error_mm(out, session) < 1.0


def test_a_doubtful_pose_is_told_as_such() -> None:
    rows = [
        SimpleNamespace(frame=7, confidence=0.41, note="with a forearm"),
        SimpleNamespace(frame=7, confidence=0.004, note="turned by 180°"),
    ]
    lines = described(rows)  # type: ignore[arg-type]
    assert lines[0] == "first pose: frame 7, 41 % sure (with a forearm)."
    assert lines[1] == "  or: below 1 %, turned by 180°"
    assert lines[2].startswith("note: the confidence is low.")
    assert len(described(rows[:1])) == 2  # type: ignore[arg-type]
