"""Sessions that cannot be used: each says what, where, what was expected and what to do."""

from __future__ import annotations

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


SETTINGS: dict[str, tuple[str, str, list[str]]] = {
    "unknown table": (
        "[hand]",
        "[hands]",
        [
            "session.toml: unknown key 'hands'",
            "known tables: session, hand, camera, clouds, tracking",
        ],
    ),
    "unknown key in session": (
        "fps = 10.0",
        "fsp = 10.0\nfps = 10.0",
        [
            "[session]: unknown key 'fsp'",
            "known keys: format,",
            "fps",
            "timestamps",
            "world_unit_m",
        ],
    ),
    "unknown key in hand": (
        'side = "right"',
        'sid = "right"',
        ["[hand]: unknown key 'sid'", "model, side, scale", "forearm"],
    ),
    "unknown key in camera": (
        'name = "cam1"',
        'name = "cam1"\nmask = "x"',
        ["camera 'cam1': unknown key 'mask'", "images", "masks", "roi", "depth", "depth_scale_m"],
    ),
    "newer format": (
        "format = 1",
        "format = 2",
        ["format = 2", "reads format 1", "update handtrack"],
    ),
    "no format": ("format = 1\n", "", ["[session]: the key 'format' is missing"]),
    "negative fps": ("fps = 10.0", "fps = -10.0", ["[session]: fps = -10.0", "above 0 [1/s]"]),
    "fps is text": ("fps = 10.0", 'fps = "10"', ['[session]: fps = "10"', "expected a number"]),
    "fps is NaN": ("fps = 10.0", "fps = nan", ["[session]: fps = nan", "expected a number"]),
    "neither fps nor times": ("fps = 10.0", "", ["give `fps`", "or `timestamps`"]),
    "zero unit": (
        "fps = 10.0",
        "fps = 10.0\nworld_unit_m = 0.0",
        ["world_unit_m = 0.0", "above 0 [m]"],
    ),
    "side": ('side = "right"', 'side = "both"', ['side = "both"', 'one of "right", "left"']),
    "scale": ('scale = "fit"', "scale = -1.0", ["[hand]: scale = -1.0", "above 0"]),
    "forearm": (
        'side = "right"',
        'forearm = "maybe"',
        ['forearm = "maybe"', 'true, false or "auto"'],
    ),
    "key nearly right": (
        "fps = 10.0",
        "fsp = 10.0",
        ["session.toml, [session]: unknown key 'fsp'", "Did you mean 'fps'?"],
    ),
    "setting nearly right": (
        "[hand]",
        "[tracking]\nsolver.iteration = 3\n\n[hand]",
        [
            "session.toml, [tracking]: no setting 'solver.iteration'",
            "Did you mean 'solver.iterations'?",
        ],
    ),
    "model nearly right": (
        '"hand26"',
        '"hand62"',
        ["session.toml, [hand]: model", "Did you mean 'hand26'?"],
    ),
    "no pattern": (
        '"masks/cam0/*.png"',
        '"masks/**.png"',
        ["camera 'cam0', masks", "no pattern of files"],
    ),
    "no path": ('"masks/cam0/*.png"', '"\\u0000"', ["camera 'cam0', masks", "is no path"]),
    "other slashes": (
        '"masks/cam0/*.png"',
        "'masks\\cam0\\*.png'",
        ["nothing matches", "write / between folders"],
    ),
    "another suffix": (
        '"masks/cam0/*.png"',
        '"masks/cam0/*.PNG"',
        ["nothing matches", "there is 000.png, 001.png, 002.png, …"],
    ),
    "no such folder": (
        '"masks/cam0/*.png"',
        '"mask/cam0/*.png"',
        ["nothing matches", "there is no folder"],
    ),
    "no images in the pattern": (
        'images = "cam0/*.png"',
        'images = "*.toml"',
        ["which is no image", "A video is named"],
    ),
    "TOML": ('name = "small"', "name = small", ["session.toml: not valid TOML", "line 4"]),
    "camera without calibration": (
        'name = "cam1"',
        'name = "cam7"',
        ["camera 'cam7' has no calibration", "calibration.toml", "cameras there: cam0, cam1"],
    ),
    "camera twice": ('name = "cam1"', 'name = "cam0"', ["two tables [[camera]]", "'cam0'"]),
    "camera as table": ("[[camera]]", "[camera]", ["not valid TOML"]),
    "unknown method": (
        '"masks/cam0/*.png"',
        '{ method = "green" }',
        ["camera 'cam0', masks: unknown mask method 'green'", "skin_ycrcb", "depth_range"],
    ),
    "unknown method key": (
        '"masks/cam0/*.png"',
        '{ method = "skin_ycrcb", red = 3 }',
        ["camera 'cam0', masks, method \"skin_ycrcb\"", "unknown key 'red'", "y_min, cr, cb"],
    ),
    "method without its images": (
        '"masks/cam1/*.png"',
        '{ method = "background_mog2" }',
        ["camera 'cam1'", '"background_mog2" need', "`images`", "missing"],
    ),
    "roi outside": (
        'name = "cam0"',
        'name = "cam0"\nroi = [40, 0, 30, 20]',
        ["camera 'cam0': roi = [40, 0, 30, 20]", "outside the image of 64 x 48"],
    ),
    "roi negative": (
        'name = "cam0"',
        'name = "cam0"\nroi = [-1, 0, 30, 20]',
        ["camera 'cam0': roi = [-1, 0, 30, 20]", "[x, y, w, h]", "inside the image"],
    ),
    "roi form": (
        'name = "cam0"',
        'name = "cam0"\nroi = [0, 0, 30]',
        ["roi = [0, 0, 30]", "expected 4 whole numbers [x, y, w, h]"],
    ),
    "nothing matches": (
        '"masks/cam0/*.png"',
        '"masks/cam0/*.jpg"',
        ["camera 'cam0', masks", 'nothing matches "masks/cam0/*.jpg"', "Check the pattern"],
    ),
    "a folder as pattern": (
        '"cam0/*.png"',
        '"cam0"',
        ["camera 'cam0', images", '"cam0" is a folder', '"cam0/*.png"'],
    ),
    "a video as masks": (
        '"masks/cam0/*.png"',
        '"calibration.toml"',
        ["camera 'cam0', masks", "is no image file", '"masks/*.png"'],
    ),
    "no video there": (
        '"cam0/*.png"',
        '"cam0.mp4"',
        ["camera 'cam0', images", "cam0.mp4", "no such"],
    ),
    "no video inside": (
        '"cam0/*.png"',
        '"calibration.toml"',
        ["camera 'cam0', images", "cannot be opened as a video"],
    ),
    "upwards": (
        '"cam0/*.png"',
        '"../other/*.png"',
        ["camera 'cam0', images", '"../other/*.png" leaves the session folder', "must stay in it"],
    ),
    "up and down": (
        '"cam0/*.png"',
        '"cam*/../../*.png"',
        ["camera 'cam0', images", "leaves the session folder"],
    ),
    "absolute": (
        '"cam0/*.png"',
        '"/tmp/*.png"',
        ["camera 'cam0', images", '"/tmp/*.png" leaves the session folder'],
    ),
    "absolute on Windows": (
        '"cam0/*.png"',
        "'C:\\data\\*.png'",
        ["camera 'cam0', images", "leaves the session folder"],
    ),
    "no times file": (
        "fps = 10.0",
        'timestamps = "none.csv"',
        ["[session], timestamps", 'no file "none.csv"'],
    ),
    "depth without scale": (
        'name = "cam1"',
        'name = "cam1"\ndepth = "masks/cam1/*.png"',
        ["camera 'cam1': depth needs `depth_scale_m`"],
    ),
    "depth of 8 bits": (
        'name = "cam1"',
        'name = "cam1"\ndepth = "masks/cam1/*.png"\ndepth_scale_m = 0.001',
        ["000.png", "depth must be one channel of 16 bits", "found uint8"],
    ),
}


@pytest.mark.parametrize("case", SETTINGS)
def test_settings_that_cannot_be_used(case: str, folder: Path) -> None:
    old, new, words = SETTINGS[case]
    edit(folder / "session.toml", old, new)
    contains(refusal(folder), *words)


def test_links_out_of_the_folder(folder: Path) -> None:
    outside = folder.parent / "outside"
    (folder / "cam0").rename(outside)
    (folder / "cam0").symlink_to(outside)
    contains(refusal(folder), '"cam0/*.png" leaves the session folder', str(outside))
    (folder / "cam0").unlink()
    (folder / "cam0").mkdir()
    (folder / "cam0/000.png").symlink_to(outside / "000.png")
    contains(refusal(folder), '"cam0/000.png" leaves the session folder', "copy the files there")


@pytest.mark.parametrize("name", ["tracks", "tracks/poses.npz", "init.json", "hand.json"])
def test_c48_nothing_is_written_through_a_link_out_of_the_folder(folder: Path, name: str) -> None:
    outside, inside = folder.parent / "outside", folder / name
    inside.parent.mkdir(exist_ok=True)
    inside.unlink(missing_ok=True)
    inside.symlink_to(outside)  # also one that leads nowhere yet
    contains(refusal(folder), f'"{name}" leaves the session folder', str(outside))


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no pipes in folders")
@pytest.mark.parametrize("name", ["init.json", "truth.npz", "calibration.toml", "tracks/poses.npz"])
def test_c48_a_pipe_is_not_opened(folder: Path, name: str) -> None:
    (folder / name).parent.mkdir(exist_ok=True)
    (folder / name).unlink(missing_ok=True)
    os.mkfifo(folder / name)
    contains(refusal(folder), f"{name} is a pipe or a device, not a file, so it was not opened")


def test_a_first_pose_must_belong_to_the_session(folder: Path) -> None:
    write_init(folder, frame=4)
    contains(refusal(folder), "init.json: frame = 4", "the session has the frames 0 to 3")
    write_init(folder, xyz=None, parameters={"index_dip": 0.1})
    contains(refusal(folder), "no parameter 'index_dip'", "init.json", "index_dip_flex")
    write_init(folder, xyz=None, parameters={"index_dip_flex": 0.1, "wrist_flex": 0.1})
    assert Session.open(folder).init is not None
