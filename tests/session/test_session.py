"""Sessions: what an opened folder gives, frame by frame."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from handtrack.errors import HandtrackError
from handtrack.session.bundled import bundled_names, bundled_session
from handtrack.session.doctor.examine import examine
from handtrack.session.session import Session
from tests.session.small_session import edit, make_session, write_truth


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return make_session(tmp_path)


def test_a_session_knows_its_frames_and_cameras(folder: Path) -> None:
    session = Session.open(folder)
    assert session.name == "small"
    assert session.camera_names == ("cam0", "cam1")
    assert session.frame_count == 4
    assert session.frame_range == range(4)
    assert session.fps == 10.0
    assert session.time_s(3) == pytest.approx(0.3)
    assert session.hand_model == "hand26"
    assert session.hand_scale == "fit"
    assert session.warnings == []


def test_images_and_masks_are_as_they_were_taken(folder: Path) -> None:
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


def test_an_observation_holds_every_view(folder: Path) -> None:
    observation = Session.open(folder).observation(1)
    assert observation.frame == 1
    assert observation.time_s == pytest.approx(0.1)
    assert [s.camera.name for s in observation.silhouettes] == ["cam0", "cam1"]
    for silhouette in observation.silhouettes:
        assert silhouette.mask.shape == (48, 64)
        assert silhouette.mask.sum() == 38 * 30
    assert observation.keypoints == ()
    assert observation.cloud is None


def test_a_missing_file_is_an_absent_view_and_an_empty_one_is_seen_emptiness(folder: Path) -> None:
    (folder / "masks/cam0/001.png").unlink()
    path = folder / "masks/cam1/001.png"
    path.write_bytes(path.read_bytes()[:40])
    session = Session.open(folder)
    assert session.observation(1).silhouettes == ()
    assert len(session.observation(2).silhouettes) == 2
    assert len(session.warnings) == 1
    assert "frame 1 counts as missing" in session.warnings[0]


def test_frames_run_to_the_last_of_any_camera(folder: Path) -> None:
    (folder / "masks/cam1/003.png").rename(folder / "masks/cam1/009.png")
    session = Session.open(folder)
    assert session.frame_count == 10
    assert session.observation(7).silhouettes == ()
    assert [s.camera.name for s in session.observation(9).silhouettes] == ["cam1"]
    with pytest.raises(HandtrackError, match=r"no frame 10; the session has the frames 0 to 9"):
        session.observation(10)


def test_masks_computed_from_images(folder: Path) -> None:
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


def test_a_region_of_interest_limits_a_view(folder: Path) -> None:
    edit(folder / "session.toml", 'name = "cam1"', 'name = "cam1"\nroi = [10, 5, 20, 30]')
    valid = Session.open(folder).observation(0).silhouettes[1].valid
    assert (valid[5:35] == (10, 30)).all()
    assert (valid[35:] == 0).all()


def test_the_last_observations_are_kept(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("handtrack.session.seen.memory._OBSERVATIONS_KEPT", 2)
    session = Session.open(folder)
    first = session.observation(0)
    assert session.observation(0) is first
    for frame in (1, 2):
        session.observation(frame)
    assert session.observation(2) is session.observation(2)
    assert session.observation(0) is not first


def test_time_is_that_of_the_first_camera_with_time_stamps(folder: Path) -> None:
    rows = ["camera,frame,time_s"]
    rows += [f"cam0,{f},{f * 0.1:.3f}" for f in range(4)]
    rows += [f"cam1,{f},{f * 0.1 + 0.01:.3f}" for f in range(3)]
    (folder / "times.csv").write_text("\n".join(rows))
    edit(folder / "session.toml", "fps = 10.0", 'timestamps = "times.csv"')
    session = Session.open(folder)
    assert [session.time_s(f) for f in range(3)] == pytest.approx([0.0, 0.1, 0.2])
    assert session.fps == pytest.approx(10.0, rel=0.06)
    assert session.time_s(5) == pytest.approx(0.3 + 2 / session.fps)


def test_missing_times_lie_between_their_neighbours(folder: Path) -> None:
    (folder / "times.csv").write_text("camera,frame,time_s\ncam0,1,0.1\ncam0,3,0.4\n")
    edit(folder / "session.toml", "fps = 10.0", 'fps = 10.0\ntimestamps = "times.csv"')
    session = Session.open(folder)
    assert session.time_s(2) == pytest.approx(0.25)
    assert session.time_s(0) == pytest.approx(0.0)


def test_truth_and_first_pose_come_along(folder: Path) -> None:
    write_truth(folder, frame=np.array([0, 2, 3, 1]))
    session = Session.open(folder)
    assert session.truth is not None
    assert session.init is not None
    assert session.truth.keypoints21 is not None
    assert session.truth.frame.tolist() == [0, 2, 3, 1]
    assert session.truth.joint_names == ("wrist", "palm")
    assert session.init.frame == 0
    assert session.init.convention == "openpose21"
    (folder / "truth.npz").unlink()
    (folder / "init.json").unlink()
    bare = Session.open(folder)
    assert bare.truth is None
    assert bare.init is None


def test_definitions_and_saved_hands_are_files_of_the_folder(folder: Path) -> None:
    (folder / "my.toml").write_text("")
    (folder / "me.json").write_text("{}")
    edit(folder / "session.toml", '"hand26"', '"my.toml"')
    edit(folder / "session.toml", '"fit"', '"me.json"')
    session = Session.open(folder)
    assert session.hand_model == folder / "my.toml"
    assert session.hand_scale == folder / "me.json"
    (folder / "me.json").unlink()
    with pytest.raises(HandtrackError, match=r"\[hand\], scale: no file \"me.json\" in"):
        _ = session.hand_scale


def test_a_camera_with_nothing_is_only_drawn(folder: Path) -> None:
    edit(folder / "session.toml", 'name = "cam1"\nmasks = "masks/cam1/*.png"', 'name = "cam1"')
    session = Session.open(folder)
    assert [s.camera.name for s in session.observation(0).silhouettes] == ["cam0"]
    assert (
        "note",
        "camera 'cam1': no images, masks, depth or joints; it is only drawn.",
    ) in examine(session)


def test_the_real_desk_recording(data_dir: Path) -> None:
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


@pytest.mark.parametrize("name", [*bundled_names(), "webxr_depth_640", "webxr_stereo_768"])
def test_rendered_recordings_are_found_in_order(name: str, request: pytest.FixtureRequest) -> None:
    if name in bundled_names():
        folder = bundled_session(name)
    else:
        folder = request.getfixturevalue("data_dir") / "sessions" / name
    session = Session.open(folder)
    findings = examine(session)
    odd = {finding.severity for finding in findings} - {"ok"}
    assert odd == ({"note"} if name == "another_hand" else set())  # its arm leaves the images
    assert session.truth is not None
    assert len(session.truth.frame) == session.frame_count
