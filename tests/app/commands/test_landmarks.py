"""`export --landmarks` and `evaluate --landmarks`: like is compared with like."""

import json
from dataclasses import replace

import pytest

from handtrack import evaluate, read_npz, write_npz
from handtrack.model.model_file import scale_table
from handtrack.session.formats.truth import read_truth
from tests.export.sequences import sample_sequence

OFFSETS = {"thumb_mcp": (0.0, 8.0, 0.0)}


@pytest.fixture
def poses(tmp_path):
    """Tracked frames of a hand whose thumb a detector sees elsewhere."""
    model, track = sample_sequence("left")
    seen = replace(model.scale, offsets_mm=OFFSETS, landmark_definition="mediapipe21")
    write_npz(tmp_path / "poses.npz", replace(track, scale=json.dumps(scale_table(seen))))
    return tmp_path / "poses.npz"


def errors(handtrack, poses, truth, *more):
    ended = handtrack.does("evaluate", poses, "--truth", truth, "--json", *more)
    found = json.loads(ended.out)
    return found["mpjpe_mm"], found["keypoint_definition"]


def test_what_is_compared_is_what_the_truth_says_or_what_is_asked_for(handtrack, poses, tmp_path):
    theirs, ours = tmp_path / "theirs.npz", tmp_path / "ours.npz"
    for out, definition in ((theirs, "mediapipe21"), (ours, "joints")):
        handtrack.does(
            "export", poses, "--to", "keypoints", "--out", out, "--landmarks", definition
        )
    assert errors(handtrack, poses, theirs) == (pytest.approx(0.0, abs=1e-6), "mediapipe21")
    assert errors(handtrack, poses, ours) == (pytest.approx(0.0, abs=1e-6), "joints")
    off, definition = errors(handtrack, poses, theirs, "--landmarks", "joints")
    assert (off, definition) == (pytest.approx(8.0 * 0.94 * 1.04 / 21, rel=1e-3), "joints")
    track, truth = read_npz(poses), read_truth(theirs)
    assert evaluate(track, truth)["mpjpe_mm"] == pytest.approx(0.0, abs=1e-6)
    assert evaluate(track, truth, "joints")["mpjpe_mm"] == pytest.approx(off)
