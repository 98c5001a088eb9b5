"""`handtrack track --init auto`, and first poses as joints in images."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from handtrack import Session, Status, read_npz
from handtrack.session.first_pose.first_pose_search import find_first_poses
from handtrack_app.commands.terminal import track_options
from handtrack_app.commands.terminal.track_options import percent


@pytest.fixture
def session(recorded, tmp_path):
    """A small recording without a first pose."""
    folder = Path(shutil.copytree(recorded, tmp_path / "session"))
    (folder / "init.json").unlink()
    return folder


@pytest.fixture(autouse=True, scope="module")
def searched_once():
    """The recording is searched once; it costs far more than all else here."""
    found = []

    def remembered(*given):
        return found or found.extend(find_first_poses(*given)) or found

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(track_options, "find_first_poses", remembered)
        yield


def worst_error_mm(poses, folder):
    truth, found = Session.open(folder).truth, read_npz(poses)
    assert found.keypoints21 is not None
    rows = np.searchsorted(truth.frame, found.frame)
    off = np.linalg.norm(found.keypoints21 - truth.keypoints21[rows], axis=2)
    return 1e3 * float(off.mean(axis=1).max())


def test_a_recording_without_a_first_pose(handtrack, session, tmp_path):
    refused = handtrack("track", session)
    assert refused.code == 2
    out = tmp_path / "poses.npz"
    ended = handtrack.does("track", session, "--init", "auto", "--frames", "0:3", "--out", out)
    assert "\n  or: " in ended.err
    assert worst_error_mm(out, session) < 1.0  # measured 0.1 mm
    assert (read_npz(out).start_confidence or 0.0) > 0.85


def test_a_start_that_is_not_sure_is_taken_where_frames_confirm_it_or_its_user_says_so(
    handtrack, session, tmp_path, monkeypatch
):
    searched = track_options.find_first_poses

    def unsure(*given):
        return [replace(one, confidence=0.5) for one in searched(*given)]

    monkeypatch.setattr(track_options, "find_first_poses", unsure)
    out = tmp_path / "poses.npz"
    asked = ("track", session, "--init", "auto", "--out", out, "--frames")
    refused = handtrack(*asked, "0:2")
    assert refused.code == 2, "too few to confirm it"
    assert "--yes" in refused.err
    assert not out.exists()
    ended = handtrack.does(*asked, "0:2", "--yes")
    assert read_npz(out).start_confidence == 0.5
    assert f"from a first pose that was {percent(0.5)} sure" in ended.out
    handtrack.does(*asked, "0:5")
    assert (read_npz(out).status == Status.TRACKED).all()
