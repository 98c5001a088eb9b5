"""Sessions that are odd, foreign or made to do harm: read as they were meant, or refused in a sentence that says what and where."""

import os
from pathlib import Path

import numpy as np
import pytest

from handtrack import HandtrackError, Session
from tests.session.small_session import edit, keypoints, write_init


def refusal(folder):
    with pytest.raises(HandtrackError) as caught:
        Session.open(folder)
    message = str(caught.value)
    assert "\n" not in message
    return message


def contains(message, *words):
    for word in words:
        assert word in message, f"{word!r} is not in: {message}"


SETTINGS = [
    ('[hand]', '[hands]', "'hands'"),
    ('side = "right"', 'sid = "right"', "'sid'"),
    ('format = 1', 'format = 2', 'format = 2'),
    ('format = 1\n', '', "'format'"),
    ('fps = 10.0', 'fps = -10.0', 'fps = -10.0'),
    ('fps = 10.0', 'fps = "10"', 'fps = "10"'),
    ('fps = 10.0', '', '`timestamps`'),
    ('side = "right"', 'side = "both"', 'side = "both"'),
    ('side = "right"', 'forearm = "maybe"', 'forearm = "maybe"'),
    ('[hand]', '[tracking]\nsolver.iteration = 3\n\n[hand]', "'solver.iterations'"),
    ('"hand26"', '"hand62"', "'hand26'"),
    ('"masks/cam0/*.png"', '"masks/**.png"', "'cam0'"),
    ('"masks/cam0/*.png"', '"\\u0000"', "'cam0'"),
    ('"masks/cam0/*.png"', "'masks\\cam0\\*.png'", '/'),
    ('images = "cam0/*.png"', 'images = "*.toml"', 'no image'),
    ('name = "small"', 'name = small', 'line 4'),
    ('name = "cam1"', 'name = "cam7"', "'cam7'"),
    ('name = "cam1"', 'name = "cam0"', "'cam0'"),
    ('"masks/cam0/*.png"', '{ method = "green" }', "'green'"),
    ('"masks/cam1/*.png"', '{ method = "background_mog2" }', '`images`'),
    ('name = "cam0"', 'name = "cam0"\nroi = [40, 0, 30, 20]', '64 x 48'),
    ('name = "cam0"', 'name = "cam0"\nroi = [0, 0, 30]', '[0, 0, 30]'),
    ('"cam0/*.png"', '"cam0"', '"cam0/*.png"'),
    ('"masks/cam0/*.png"', '"calibration.toml"', '"masks/*.png"'),
    ('"cam0/*.png"', '"calibration.toml"', "'cam0'"),
    ('"cam0/*.png"', '"../other/*.png"', '"../other/*.png"'),
    ('"cam0/*.png"', "'C:\\data\\*.png'", "'cam0'"),
    ('"cam0/*.png"', '"cam0/*.png"\nbayer = "rgbg"', 'rgbg'),
    ('"cam0/*.png"', '"cam0/*.png"\ndemosaic = "bilinear"', '`bayer`'),
    ('fps = 10.0', 'timestamps = "none.csv"', '"none.csv"'),
    ('name = "cam1"', 'name = "cam1"\ndepth = "masks/cam1/*.png"', '`depth_scale_m`'),
    ('name = "cam1"', 'name = "cam1"\ndepth = "masks/cam1/*.png"\ndepth_scale_m = 0.001', 'uint8'),
]  # fmt: skip
"""what is written otherwise in session.toml, and what of it is told"""


@pytest.mark.parametrize(("old", "new", "told"), SETTINGS)
def test_settings_that_cannot_be_used(old, new, told, folder):
    edit(folder / "session.toml", old, new)
    contains(refusal(folder), told)


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("masks/cam0/*.png", "masks/cam0/*.PNG", "003.png"),
        ("masks/cam0/*.png", "mask/cam0/*.png", "no folder"),
        ("cam0/*.png", "cam0.mp4", "cam0"),
    ],
)
def test_files_that_are_not_there_count_as_missing(old, new, told, folder):
    edit(folder / "session.toml", f'"{old}"', f'"{new}"')
    session = Session.open(folder)
    (said,) = session.warnings
    contains(said, "camera 'cam0'", new, told)
    is_mask = new.startswith("mask")
    assert (session.mask("cam0", 1) is None) == is_mask
    assert (session.image("cam0", 1) is None) != is_mask
    for name in ("masks", "cam0"):
        (folder / name).rename(folder.parent / name)
    with pytest.raises(HandtrackError, match=f"no frames.*{folder}"):
        Session.open(folder).check_frames()


def test_links_out_of_the_folder(folder):
    (folder / "cam0/004.png").symlink_to(folder / "cam0/003.png")
    assert Session.open(folder).image("cam0", 4) is not None, "a link within it"
    outside = folder.parent / "outside"
    (folder / "cam0").rename(outside)
    (folder / "cam0").symlink_to(outside)
    contains(refusal(folder), '"cam0/*.png" leaves the session folder', str(outside))
    (folder / "cam0").unlink()
    (folder / "cam0").mkdir()
    (folder / "cam0/000.png").symlink_to(outside / "000.png")
    contains(refusal(folder), '"cam0/000.png" leaves the session folder', "copy the files there")


def without(folder, name):
    """Return where a file of the session may stand, and remove what is there."""
    (folder / name).parent.mkdir(exist_ok=True)
    (folder / name).unlink(missing_ok=True)
    return folder / name


@pytest.mark.parametrize(
    "name", ["tracks", "tracks/poses.npz", "init.json", "hand.json", "masks_corrected"]
)
def test_c48_nothing_is_written_through_a_link_out_of_the_folder(folder, name):
    outside = folder.parent / "outside"
    without(folder, name).symlink_to(outside)  # also one that leads nowhere yet
    contains(refusal(folder), f'"{name}" leaves the session folder', str(outside))


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no pipes in folders")
@pytest.mark.parametrize("name", ["init.json", "truth.npz", "calibration.toml", "tracks/poses.npz"])
def test_c48_a_pipe_is_not_opened(folder, name):
    os.mkfifo(without(folder, name))
    contains(refusal(folder), f"{name} is a pipe or a device, not a file, so it was not opened")


def test_a_first_pose_must_belong_to_the_session(folder):
    write_init(folder, frame=4)
    contains(refusal(folder), "init.json: frame = 4", "the session has the frames 0 to 3")
    write_init(folder, xyz=None, parameters={"index_dip": 0.1})
    contains(refusal(folder), "no parameter 'index_dip'", "init.json", "index_dip_flex")
    write_init(folder, xyz=None, parameters={"index_dip_flex": 0.1, "wrist_flex": 0.1})
    assert Session.open(folder).init is not None


def test_c29_cameras_go_by_their_names_whatever_the_order(folder):
    for file in ("session.toml", "calibration.toml"):
        edit(folder / file, 'name = "cam1"', 'name = "cam_2"')
        edit(folder / file, 'name = "cam0"', 'name = "cam_10"')
    text = (folder / "calibration.toml").read_text()
    first, second = text.split("[cam_1]")
    (folder / "calibration.toml").write_text(f"[cam_1]{second}\n{first}")
    rig = Session.open(folder).rig
    assert rig.names == ("cam_10", "cam_2")
    assert rig["cam_10"].rotation[0, 0] == 1.0
    assert rig["cam_2"].rotation[0, 0] == pytest.approx(np.cos(0.7))


class Canary:
    def __reduce__(self):
        return (Path.touch, (Path("canary"),))


@pytest.mark.parametrize("name", ["keypoints21", "joint_names", "time_s"])
def test_c51_a_pickle_in_an_npz_is_refused_and_not_run(name, folder, monkeypatch):
    monkeypatch.chdir(folder)
    harmful = np.empty(1, object)
    harmful[0] = Canary()
    np.savez(
        folder / "truth.npz", **{"keypoints21": keypoints()[None], name: harmful}, allow_pickle=True
    )
    contains(refusal(folder), "truth.npz", "Object arrays cannot be loaded")
    assert not (folder / "canary").exists()


def test_c58_tables_as_spreadsheets_write_them(folder):
    rows = ["camera,frame,time_s", *(f"cam0,{frame},{frame / 10}" for frame in range(4))]
    edit(folder / "session.toml", "fps = 10.0", 'timestamps = "t.csv"')
    (folder / "t.csv").write_bytes(b"\xef\xbb\xbf" + "\r\n".join(rows).encode())
    assert Session.open(folder).time_s(3) == pytest.approx(0.3)
    (folder / "t.csv").write_text("\n".join(rows).replace(",", ";"))
    contains(refusal(folder), "the columns are camera;frame;time_s", "expected camera,frame,time_s")


TIMES = {
    "empty": ("", ["the columns are missing", "expected camera,frame,time_s"]),
    "NaN": ("camera,frame,time_s\ncam0,1,nan", ["line 2: frame 1, time nan", "finite seconds"]),
    "camera": ("camera,frame,time_s\ncam9,1,0.1", ["line 2: unknown camera 'cam9'", "cam0, cam1"]),
    "twice": ("camera,frame,time_s\ncam0,1,0.1\ncam0,1,0.2", ["line 3: a second time", "frame 1"]),
    "backwards": ("camera,frame,time_s\ncam0,0,0.2\ncam0,1,0.1", ["time of frame 1 is not later"]),
    "one": ("camera,frame,time_s\ncam0,0,0.2", ["times of 1 frames; expected at least two"]),
    "decimal comma": ("camera,frame,time_s\ncam0,0,0,2", ["line 2: 'cam0,0,0,2'", "and seconds"]),
}


@pytest.mark.parametrize("case", TIMES)
def test_timestamps_that_cannot_be_used(case, folder):
    """Fault C9."""
    text, words = TIMES[case]
    (folder / "t.csv").write_text(text)
    edit(folder / "session.toml", "fps = 10.0", 'timestamps = "t.csv"')
    contains(refusal(folder), "t.csv", *words)


@pytest.mark.parametrize("fps", ["", "fps = 10.0\n"])
@pytest.mark.parametrize(
    ("unit", "per_s"), [("milliseconds", 1e3), ("microseconds", 1e6), ("nanoseconds", 1e9)]
)
def test_c10_times_in_another_unit_are_refused(fps, unit, per_s, folder):
    start = 1_700_000_000 if fps else 0  # from the epoch, or from the recording's start
    step = 0.1 if fps else 1 / 30
    rows = [f"cam0,{f},{(start + f * step) * per_s:.0f}" for f in range(4)]
    (folder / "t.csv").write_text("\n".join(["camera,frame,time_s", *rows]))
    edit(folder / "session.toml", "fps = 10.0", f'{fps}timestamps = "t.csv"')
    contains(refusal(folder), "t.csv", f"Are these {unit}", f"Multiply time_s by {1 / per_s:g}")
