"""A person's recording by commands alone: from 2D joints to a size, a track and an export."""

import re

import numpy as np
import pytest

from handtrack.model.model_file import read_scale
from tests.session.body_session import film


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return film(tmp_path_factory.mktemp("person") / "session", frames=8, hand={"scale": "fit"}).folder  # fmt: skip


def test_a_persons_size_is_saved(handtrack, folder):
    ended = handtrack.does("size", folder, "--init", "auto", "--count", "6")
    saved = folder / "body.json"
    assert re.search(r"\+\d\.\d ± \d\.\d %, trunk", ended.out)
    assert f"Saved to {saved}" in ended.out
    scale = read_scale(saved)
    assert scale.overall * np.mean(list(scale.parts.values())) == pytest.approx(1.05, abs=0.04)
    again = handtrack("size", folder, "--init", "auto")
    assert again.code == 2
