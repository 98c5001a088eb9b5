"""A session of many files: each is looked at once, and never followed by itself (faults A18, C60)."""

import os
from pathlib import Path

import pytest

from handtrack.errors import HandtrackError
from handtrack.session.layout import matching_files


def _folder(tmp_path: Path, count: int) -> Path:
    masks = tmp_path / "masks" / "cam0"
    masks.mkdir(parents=True)
    for frame in range(count):
        (masks / f"{frame:06d}.png").touch()
    return tmp_path


def test_links_that_lead_out_of_the_folder_are_refused(tmp_path):
    folder = _folder(tmp_path / "session", 2)
    outside = tmp_path / "outside"
    outside.mkdir()
    (outside / "000002.png").touch()
    within, out = folder / "masks" / "cam0" / "000003.png", folder / "masks" / "cam0" / "000002.png"
    os.symlink(folder / "masks" / "cam0" / "000000.png", within)
    assert within in matching_files(folder, "masks/cam0/*.png", "here")
    os.symlink(outside / "000002.png", out)
    with pytest.raises(HandtrackError, match="leaves the session folder"):
        matching_files(folder, "masks/cam0/*.png", "here")
    out.unlink()
    os.symlink(outside, folder / "masks" / "cam1")
    with pytest.raises(HandtrackError, match="leaves the session folder"):
        matching_files(folder, "masks/*/*.png", "here")
