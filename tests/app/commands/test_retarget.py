"""`handtrack retarget` and `handtrack simulate --motion FILE`: a motion file to a session, and from there to exports."""

import json

import pytest
from numpy.testing import assert_allclose

from handtrack import Session
from tests.capture.joints.people import places
from tests.capture.sample_files import sample


@pytest.fixture
def file(tmp_path):
    """A person of 1.58 m, z up, in millimetres; one joint is missing for a while."""
    (path,) = sample("motion/walk", tmp_path)
    return path


def test_a_motion_becomes_a_session_that_is_exported(handtrack, file, tmp_path):
    made = tmp_path / "made"
    ended = handtrack.does("retarget", file, "--out", made, "--json")
    assert "18 joints" in ended.err
    told = json.loads(ended.out)
    assert (told["model"], told["frames"], told["fps"]) == ("body34", len(places()), 25.0)
    assert told["median_mm"] < 5
    assert len(told["joints_mm"]) == 18
    assert told["scale"] == pytest.approx(0.9, abs=0.02)
    session = Session.open(made)
    assert session.frame_count == len(places())
    assert session.file.hand.model == "body34"
    scored = handtrack(
        "evaluate", made / "tracks/poses.npz", "--truth", made / "truth.npz", "--json"
    )
    assert json.loads(scored.out)["mpjpe_mm"] < 8
    measured = handtrack("evaluate", made / "tracks/poses.npz", "--truth", file, "--json")
    assert json.loads(measured.out)["mpjpe_mm"] < 8  # points of the file itself, by their names
    for form in ("csv", "bvh", "trc", "glb"):
        handtrack.does("export", made / "tracks/poses.npz", "--to", form)


def test_a_hand_s_motion(handtrack, tmp_path):
    (file,) = sample("motion/left_hand", tmp_path)
    ended = handtrack.does("retarget", file, "--out", tmp_path / "made", "--side", "left", "--json")
    told = json.loads(ended.out)
    assert (told["model"], told["median_mm"] < 1.0) == ("hand26", True)
    assert Session.open(tmp_path / "made").file.hand.side == "left"


def test_a_recording_is_rendered_of_a_motion_file(handtrack, file, tmp_path):
    made = tmp_path / "made"
    handtrack.does(
        "simulate", "--out", made, "--motion", file, "--frames", 4, "--cameras", 2, "--size", 160, 120, "--no-images",
        "--joints-px", 0, "--clouds",
    )  # fmt: skip
    session = Session.open(made)
    assert (session.frame_count, session.file.hand.model) == (4, "body34")
    truth = session.truth
    assert abs(truth.joint_positions.mean(axis=(0, 1))).max() < 0.5  # about the origin
    seen = session.view("cam1").keypoints(2, 1.0)[0]
    pixels = session.rig["cam1"].project(truth.joint_positions[2])
    assert_allclose(
        seen.pixels, pixels[[truth.joint_names.index(n) for n in seen.names]], atol=1e-3
    )
    assert len(session.observation(2).cloud) > 50
