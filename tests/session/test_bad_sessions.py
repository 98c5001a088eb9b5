"""Sessions that cannot be used: each says what, where, what was expected and what to do."""

import os
from pathlib import Path

import pytest

from handtrack.errors import HandtrackError
from handtrack.session.session import Session
from tests.session.small_session import edit, make_session, write_init


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    inner = tmp_path / "recording"
    inner.mkdir()
    return make_session(inner)


def refusal(folder: Path) -> str:
    with pytest.raises(HandtrackError) as caught:
        Session.open(folder)
    message = str(caught.value)
    assert "\n" not in message
    assert "Traceback" not in message
    return message


def contains(message: str, *words: str) -> None:
    for word in words:
        assert word in message, f"{word!r} is not in: {message}"


SETTINGS = [
    ('[hand]', '[hands]', "'hands'"),
    ('fps = 10.0', 'fsp = 10.0\nfps = 10.0', "'fsp'"),
    ('side = "right"', 'sid = "right"', "'sid'"),
    ('name = "cam1"', 'name = "cam1"\nmask = "x"', "'mask'"),
    ('format = 1', 'format = 2', 'format = 2'),
    ('format = 1\n', '', "'format'"),
    ('fps = 10.0', 'fps = -10.0', 'fps = -10.0'),
    ('fps = 10.0', 'fps = "10"', 'fps = "10"'),
    ('fps = 10.0', 'fps = nan', 'fps = nan'),
    ('fps = 10.0', '', '`timestamps`'),
    ('fps = 10.0', 'fps = 10.0\nworld_unit_m = 0.0', 'world_unit_m = 0.0'),
    ('side = "right"', 'side = "both"', 'side = "both"'),
    ('scale = "fit"', 'scale = -1.0', 'scale = -1.0'),
    ('side = "right"', 'forearm = "maybe"', 'forearm = "maybe"'),
    ('[hand]', '[tracking]\nsolver.iteration = 3\n\n[hand]', "'solver.iterations'"),
    ('"hand26"', '"hand62"', "'hand26'"),
    ('"masks/cam0/*.png"', '"masks/**.png"', "'cam0'"),
    ('"masks/cam0/*.png"', '"\\u0000"', "'cam0'"),
    ('"masks/cam0/*.png"', "'masks\\cam0\\*.png'", '/'),
    ('"masks/cam0/*.png"', '"masks/cam0/*.PNG"', '000.png'),
    ('"masks/cam0/*.png"', '"mask/cam0/*.png"', 'no folder'),
    ('images = "cam0/*.png"', 'images = "*.toml"', 'no image'),
    ('name = "small"', 'name = small', 'line 4'),
    ('name = "cam1"', 'name = "cam7"', "'cam7'"),
    ('name = "cam1"', 'name = "cam0"', "'cam0'"),
    ('"masks/cam0/*.png"', '{ method = "green" }', "'green'"),
    ('"masks/cam0/*.png"', '{ method = "skin_ycrcb", red = 3 }', "'red'"),
    ('"masks/cam1/*.png"', '{ method = "background_mog2" }', '`images`'),
    ('name = "cam0"', 'name = "cam0"\nroi = [40, 0, 30, 20]', '64 x 48'),
    ('name = "cam0"', 'name = "cam0"\nroi = [-1, 0, 30, 20]', '[-1, 0, 30, 20]'),
    ('name = "cam0"', 'name = "cam0"\nroi = [0, 0, 30]', '[0, 0, 30]'),
    ('"masks/cam0/*.png"', '"masks/cam0/*.jpg"', '"masks/cam0/*.jpg"'),
    ('"cam0/*.png"', '"cam0"', '"cam0/*.png"'),
    ('"masks/cam0/*.png"', '"calibration.toml"', '"masks/*.png"'),
    ('"cam0/*.png"', '"cam0.mp4"', 'cam0.mp4'),
    ('"cam0/*.png"', '"calibration.toml"', "'cam0'"),
    ('"cam0/*.png"', '"../other/*.png"', '"../other/*.png"'),
    ('"cam0/*.png"', '"/tmp/*.png"', '"/tmp/*.png"'),
    ('"cam0/*.png"', "'C:\\data\\*.png'", "'cam0'"),
    ('fps = 10.0', 'timestamps = "none.csv"', '"none.csv"'),
    ('name = "cam1"', 'name = "cam1"\ndepth = "masks/cam1/*.png"', '`depth_scale_m`'),
    ('name = "cam1"', 'name = "cam1"\ndepth = "masks/cam1/*.png"\ndepth_scale_m = 0.001', 'uint8'),
]  # fmt: skip
"""what is written otherwise in session.toml, and what of it is told"""


@pytest.mark.parametrize(("old", "new", "told"), SETTINGS)
def test_settings_that_cannot_be_used(old, new, told, folder):
    edit(folder / "session.toml", old, new)
    contains(refusal(folder), told)


def test_links_out_of_the_folder(folder):
    outside = folder.parent / "outside"
    (folder / "cam0").rename(outside)
    (folder / "cam0").symlink_to(outside)
    contains(refusal(folder), '"cam0/*.png" leaves the session folder', str(outside))
    (folder / "cam0").unlink()
    (folder / "cam0").mkdir()
    (folder / "cam0/000.png").symlink_to(outside / "000.png")
    contains(refusal(folder), '"cam0/000.png" leaves the session folder', "copy the files there")


@pytest.mark.parametrize("name", ["tracks", "tracks/poses.npz", "init.json", "hand.json"])
def test_c48_nothing_is_written_through_a_link_out_of_the_folder(folder, name):
    outside, inside = folder.parent / "outside", folder / name
    inside.parent.mkdir(exist_ok=True)
    inside.unlink(missing_ok=True)
    inside.symlink_to(outside)  # also one that leads nowhere yet
    contains(refusal(folder), f'"{name}" leaves the session folder', str(outside))


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no pipes in folders")
@pytest.mark.parametrize("name", ["init.json", "truth.npz", "calibration.toml", "tracks/poses.npz"])
def test_c48_a_pipe_is_not_opened(folder, name):
    (folder / name).parent.mkdir(exist_ok=True)
    (folder / name).unlink(missing_ok=True)
    os.mkfifo(folder / name)
    contains(refusal(folder), f"{name} is a pipe or a device, not a file, so it was not opened")


def test_a_first_pose_must_belong_to_the_session(folder):
    write_init(folder, frame=4)
    contains(refusal(folder), "init.json: frame = 4", "the session has the frames 0 to 3")
    write_init(folder, xyz=None, parameters={"index_dip": 0.1})
    contains(refusal(folder), "no parameter 'index_dip'", "init.json", "index_dip_flex")
    write_init(folder, xyz=None, parameters={"index_dip_flex": 0.1, "wrist_flex": 0.1})
    assert Session.open(folder).init is not None
