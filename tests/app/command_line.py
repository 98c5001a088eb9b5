"""Runs `handtrack` in this process, and makes the small recordings that its tests use."""

import hashlib
import os
import re
import shutil
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
import pytest

from handtrack import CameraRig, bundled_session
from handtrack.capture.calibration.rig_file import read_rig, write_rig
from handtrack_app.cli import main
from tests.conftest import REPOSITORY

FRAMES = 5
SIZE = (320, 240)
PROGRAM = os.environ | {"PYTHONPATH": os.pathsep.join([str(REPOSITORY), str(REPOSITORY / "app")])}
"""the environment in which `python -m handtrack_app.cli` is this checkout's"""


class Ended(NamedTuple):
    """How a command ended."""

    code: int
    out: str
    err: str


class CommandLine:
    """`handtrack` with what it printed."""

    def __init__(self, capsys: pytest.CaptureFixture[str]) -> None:
        self._capsys = capsys

    def __call__(self, *words: object) -> Ended:
        self._capsys.readouterr()
        code = main([str(word) for word in words])
        out, err = self._capsys.readouterr()
        assert "Traceback" not in out + err
        return Ended(code, out, err)

    def does(self, *words: object) -> Ended:
        """Run a command that ends well."""
        ended = self(*words)
        assert ended.code == 0, ended.err
        return ended


QUICK = "\n[tracking]\ntracker.recovery = false\ntracker.escape = false\n"
"""settings with which a lost finger is not searched for: half of the time that a frame takes"""


def small_recording(
    folder: Path, name: str = "open_fist_open", frames: int = FRAMES, more: str = QUICK
) -> Path:
    """Make a session of a bundled one's first frames: a hand alone, masks of half the size. more: settings."""
    source = bundled_session(name)
    for masks in sorted((source / "masks").iterdir()):
        kept = folder / "masks" / masks.name
        kept.mkdir(parents=True)
        for file in sorted(masks.iterdir())[:frames]:
            halved = cv2.resize(cv2.imread(str(file), 0), SIZE, interpolation=cv2.INTER_AREA)
            cv2.imwrite(str(kept / file.name), np.where(halved > 127, np.uint8(255), np.uint8(0)))
    rig = (camera.scaled(SIZE) for camera in read_rig(source / "calibration.toml"))
    write_rig(folder / "calibration.toml", CameraRig(tuple(rig)))
    shutil.copyfile(source / "init.json", folder / "init.json")
    with np.load(source / "truth.npz") as truth:
        np.savez(folder / "truth.npz", keypoints21=truth["keypoints21"][:frames])
    settings = (source / "session.toml").read_text().replace('forearm = "auto"', "forearm = false")
    (folder / "session.toml").write_text(re.sub("images = .*", "", settings) + more)
    return folder


def listing(folder: Path) -> dict[str, str]:
    """Return every file and folder below a folder, files with a digest of their content."""
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        if path.is_file()
        else ""
        for path in sorted(folder.rglob("*"))
    }


def refused(handtrack: CommandLine, within: Path, words: list[object], expected: list[str]) -> None:
    """Run a command that must be refused: code 2, one paragraph with the expected words, nothing written."""
    before = listing(within)
    ended = handtrack(*words)
    assert ended.code == 2, ended.err
    assert ended.out == ""
    assert ended.err.startswith(f"handtrack {words[0]}: ")
    assert ended.err.count("\n") == 1, ended.err
    assert ended.err.endswith("\n")
    for word in expected:
        assert word in ended.err, f"{word!r} is not in: {ended.err}"
    assert listing(within) == before
