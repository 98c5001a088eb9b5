"""`handtrack track --use edges,intensity`: no masks needed, only images."""

import json
import shutil

import numpy as np
import pytest

from handtrack import Status, bundled_session, read_npz


@pytest.fixture
def filmed(session):
    """The small recording with its videos and without its masks."""
    source = bundled_session("open_fist_open")
    text = (session / "session.toml").read_text()
    for video in sorted(source.glob("*.mp4")):
        shutil.copyfile(video, session / video.name)
        text = text.replace(f'masks = "masks/{video.stem}/*.png"', f'images = "{video.name}"')
    assert "masks" not in text
    (session / "session.toml").write_text(text)
    return session


def test_a_recording_without_masks_is_tracked(handtrack, filmed):
    handtrack.does(
        "track", filmed, "--use", "edges,intensity", "--frames", "0:2", "--set", "tracker.escape=false",
        "--set", "intensity.weight=0.5",
    )  # fmt: skip
    track = read_npz(filmed / "tracks/poses.npz")
    settings = json.loads(track.settings)
    named = ("silhouettes", "cloud", "keypoints", "edges", "intensity")
    assert [settings[f"{name}.weight"] for name in named] == [0, 0, 0, 1, 0.5]
    assert set(track.energy_names or ()) >= {"edges", "intensity"}
    assert (track.status != Status.LOST).all()
    with np.load(filmed / "truth.npz") as truth:
        off = np.linalg.norm(track.keypoints21 - truth["keypoints21"][:2], axis=2)
    assert off.mean() < 0.012
