"""Files written whole or not at all, whatever stands at their place."""

import errno
import os

import pytest

from handtrack.files.atomic import remove_abandoned, replace_text, replacing
from tests.killing import copy_of_a_fresh_process, forked


def test_a_link_stays_and_what_it_leads_to_is_replaced(tmp_path):
    (tmp_path / "real.csv").write_text("old")
    (tmp_path / "link.csv").symlink_to("real.csv")
    replace_text(tmp_path / "link.csv", "new")
    assert (tmp_path / "link.csv").is_symlink()
    assert (tmp_path / "real.csv").read_text() == "new"


def test_a_full_disk_leaves_what_was_there_and_names_the_file(tmp_path):
    """Fault C38."""
    path = tmp_path / "poses.npz"
    path.write_text("old")
    with pytest.raises(OSError, match=r"poses\.npz") as caught, replacing(path) as part:
        assert part.suffix == ".npz"
        part.write_text("half")
        raise OSError(errno.ENOSPC, "No space left on device")
    assert caught.value.filename == str(path)
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["poses.npz"]


def killed_while_writing(path):
    """Return what a program leaves that is killed in the middle of `replacing`."""
    before = set(path.parent.iterdir())
    copy_of_a_fresh_process(_write_half, path).join()
    (left,) = set(path.parent.iterdir()) - before
    return left


def _write_half(path):
    with replacing(path) as part:
        part.write_text("half")
        os._exit(9)


@forked
def test_a23_what_a_killed_program_left_is_removed_later(tmp_path):
    kept = [tmp_path / name for name in (".mine.part", ".poses.npz.ab.part.npz", "poses.npz")]
    for path in kept:
        path.write_text("mine")
        os.utime(path, (0, 0))
    left = [killed_while_writing(tmp_path / name) for name in ("poses.npz", "session")]
    assert remove_abandoned(tmp_path) == []  # their writers may live
    for path in left:
        os.utime(path, (0, 0))
    assert set(remove_abandoned(tmp_path)) == set(left)
    assert set(tmp_path.iterdir()) == set(kept)
