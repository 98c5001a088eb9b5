"""A person's recording by commands alone: from 2D joints to a size, a track and an export."""

import json
import re

import numpy as np
import pytest

from handtrack.model.model_file import read_scale
from handtrack.session.formats.tables import read_npz
from tests.session.body_session import OFFSETS, film


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return film(tmp_path_factory.mktemp("person") / "session", frames=8, hand={"scale": "fit"}).folder  # fmt: skip


def test_a_person_is_tracked_by_commands_alone(handtrack, folder):
    ended = handtrack("track", folder, "--init", "auto", "--frames", "0:4", "--json")
    assert ended.code == 0, ended.err
    assert "3 cameras agree on 17 of 17 joints" in ended.err
    assert json.loads(ended.out)["frames"]["tracked"] == 4
    track = read_npz(folder / "tracks" / "poses.npz")
    assert track.model == "body34"
    assert set(OFFSETS) < set(json.loads(track.scale)["offsets_mm"])
    assert handtrack("export", folder / "tracks" / "poses.npz", "--to", "trc").code == 0


def test_a_persons_size_is_saved(handtrack, folder):
    ended = handtrack("size", folder, "--init", "auto", "--count", "6")
    assert ended.code == 0, ended.err
    saved = folder / "body.json"
    assert re.search(r"\+\d\.\d ± \d\.\d %, trunk", ended.out)
    assert f"Saved to {saved}" in ended.out
    scale = read_scale(saved)
    assert scale.overall * np.mean(list(scale.parts.values())) == pytest.approx(1.05, abs=0.04)
    again = handtrack("size", folder, "--init", "auto")
    assert again.code == 2


def test_one_camera_is_not_sure_and_asks_for_another(handtrack, tmp_path):  # fmt: skip
    alone = film(tmp_path / "session", cameras=1, frames=1, motion="still").folder
    ended = handtrack("track", alone, "--init", "auto")
    assert ended.code == 2
    assert not (alone / "tracks" / "poses.npz").exists()
