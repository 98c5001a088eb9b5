"""docs/start/person.md: its commands, as they stand, on a small project that this test makes."""

import re
import shlex

import numpy as np

from handtrack import Session, read_npz
from tests.app.commands.test_new_project import project
from tests.capture.joints.people import names, places
from tests.conftest import REPOSITORY

PAGE = REPOSITORY / "docs" / "start" / "person.md"
FRAMES = 3


def test_the_page_s_commands_run(handtrack, tmp_path, monkeypatch):
    project(tmp_path / "p").rename(tmp_path / "my_project")
    for path in (tmp_path / "my_project").glob("pose/*/*.json"):
        if int(path.stem.split("_")[-1]) >= FRAMES:
            path.unlink()
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"```sh\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    commands = [line for block in blocks for line in block.splitlines() if line]
    commands += [f"handtrack export walk/tracks/poses.npz --to {to}" for to in ("csv", "bvh")]
    for line in commands:
        ended = handtrack(*shlex.split(line)[1:])
        assert ended.code == 0, f"{line}: {ended.err}"
    assert Session.open(tmp_path / "walk").file.hand.model == "body34"
    track = read_npz(tmp_path / "walk/tracks/poses.npz")
    assert len(track) == FRAMES
    shared = [
        n for n in ("left_wrist", "right_knee", "left_shoulder", "nose") if n in track.joint_names
    ]
    found = track.joint_positions[:, [track.joint_names.index(n) for n in shared]]
    true = places()[:FRAMES, [names().index(n) for n in shared]]
    assert np.linalg.norm(found - true, axis=2).mean() < 0.05
    for suffix in ("csv", "bvh", "trc", "html"):
        assert list((tmp_path / "walk/tracks").glob(f"*.{suffix}")), suffix
