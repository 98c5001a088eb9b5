"""Golden files: a saved result opens, and exports of it are what they were, to the seventh digit."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest

from handtrack.session.formats.tables import read_npz
from handtrack.version import VERSION
from tests.golden.files import FOLDER, FRAMES, POSES, TEXTS, written
from tests.sample_track import hand_track

NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")
CLOSE = 1e-6


def parts(text: str) -> tuple[list[str], list[float]]:
    """Return what stands between a text's numbers, and the numbers."""
    text = text.replace(VERSION, "VERSION")
    return NUMBER.split(text), [float(number) for number in NUMBER.findall(text)]


@pytest.fixture(scope="module")
def now(tmp_path_factory):
    folder = tmp_path_factory.mktemp("exports")
    return {file.name: file for file in written(FOLDER / POSES, folder)}


def test_a_saved_result_opens():
    saved, made = read_npz(FOLDER / POSES), hand_track(FRAMES)
    assert saved.parameter_names == made.parameter_names
    assert saved.joint_names == made.joint_names
    np.testing.assert_allclose(saved.joint_positions, made.joint_positions, atol=1e-9)


def test_the_same_files_are_written(now):
    assert sorted(now) == sorted(file.name for file in FOLDER.iterdir() if file.name != POSES)
    assert len(now) > len(TEXTS)


@pytest.mark.parametrize("name", sorted(f.name for f in FOLDER.iterdir() if f.name != POSES))
def test_exports_are_what_they_were(now, name):
    before, after = (parts(f.read_text(encoding="utf-8")) for f in (FOLDER / name, now[name]))
    assert before[0] == after[0], "words or columns changed: a promise; tell it in the changelog"
    close = [math.isclose(a, b, rel_tol=CLOSE, abs_tol=CLOSE) for a, b in zip(before[1], after[1], strict=True)]  # fmt: skip
    assert all(close)
