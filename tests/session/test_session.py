"""Sessions: what an opened folder gives, frame by frame."""

from pathlib import Path

import numpy as np
import pytest

from handtrack.errors import HandtrackError
from handtrack.session.session import Session
from tests.session.small_session import edit, make_session


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return make_session(tmp_path)


def test_images_and_masks_are_as_they_were_taken(folder):
    session = Session.open(folder)
    image, mask = session.image("cam0", 2), session.mask("cam1", 2)
    assert image is not None
    assert image.shape == (48, 64, 3)
    assert (image == 80).all()
    assert mask is not None
    assert mask.dtype == np.uint8
    assert set(np.unique(mask)) == {0, 255}
    assert session.image("cam1", 2) is None
    assert session.image("cam0", 99) is None
    with pytest.raises(
        HandtrackError, match=r"no camera 'top' in .*session.toml; known: cam0, cam1"
    ):
        session.image("top", 0)


def test_a_missing_file_is_an_absent_view_and_an_empty_one_is_seen_emptiness(folder):
    (folder / "masks/cam0/001.png").unlink()
    path = folder / "masks/cam1/001.png"
    path.write_bytes(path.read_bytes()[:40])
    session = Session.open(folder)
    assert session.observation(1).silhouettes == ()
    assert len(session.observation(2).silhouettes) == 2
    assert len(session.warnings) == 1
    assert "frame 1 counts as missing" in session.warnings[0]


def test_frames_run_to_the_last_of_any_camera(folder):
    (folder / "masks/cam1/003.png").rename(folder / "masks/cam1/009.png")
    session = Session.open(folder)
    assert session.frame_count == 10
    assert session.observation(7).silhouettes == ()
    assert [s.camera.name for s in session.observation(9).silhouettes] == ["cam1"]
    with pytest.raises(HandtrackError, match=r"no frame 10; the session has the frames 0 to 9"):
        session.observation(10)


def test_masks_computed_from_images(folder):
    edit(folder / "session.toml", '"masks/cam0/*.png"', '{ method = "skin_ycrcb" }')
    session = Session.open(folder)
    mask = session.mask("cam0", 1)
    assert mask is not None
    assert not mask.any()
    first = session.observation(1).silhouettes[0]
    assert first.camera.name == "cam0"
    assert not first.mask.any()
    (folder / "cam0/001.png").unlink()
    assert [s.camera.name for s in Session.open(folder).observation(1).silhouettes] == ["cam1"]


def test_time_is_that_of_the_first_camera_with_time_stamps(folder):
    rows = ["camera,frame,time_s"]
    rows += [f"cam0,{f},{f * 0.1:.3f}" for f in range(4)]
    rows += [f"cam1,{f},{f * 0.1 + 0.01:.3f}" for f in range(3)]
    (folder / "times.csv").write_text("\n".join(rows))
    edit(folder / "session.toml", "fps = 10.0", 'timestamps = "times.csv"')
    session = Session.open(folder)
    assert [session.time_s(f) for f in range(3)] == pytest.approx([0.0, 0.1, 0.2])
    assert session.fps == pytest.approx(10.0, rel=0.06)
    assert session.time_s(5) == pytest.approx(0.3 + 2 / session.fps)


def test_the_real_desk_recording(data_dir):
    session = Session.open(data_dir / "sessions/desk_two_view")
    assert session.frame_count == 378
    observation = session.observation(18)
    assert [s.camera.name for s in observation.silhouettes] == ["cam0", "cam1"]
    for silhouette in observation.silhouettes:
        assert 20_000 < silhouette.mask.sum() < 60_000
        partial = (silhouette.mask > 0) & (silhouette.mask < 1)
        assert 0 < partial.mean() < 0.01  # only along outlines
    assert session.init is not None
    assert session.init.frame == 18
