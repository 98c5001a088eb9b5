"""Model definitions of a person's own: what is wrong in one is said, before anything is built from it."""

from __future__ import annotations

from importlib import resources
from pathlib import Path

import pytest

from handtrack.errors import HandtrackError
from handtrack.model.model_file import load_model

TEXT = resources.files("handtrack.model.definitions").joinpath("glove9.toml").read_text("utf-8")
BAD = {
    "key missing": ("length_mm", "length_m", "Object missing required field `length_mm`."),
    "bone's key missing": ("tail =", "tial =", "Object missing required field `tail` - at `$.bone[0]`."),
    "kind": ('kind = "hand"', 'kind = "foot"', "Invalid enum value 'foot' - at `$.kind`."),
    "a text for a number": ("up = [0, 0, 1]", 'up = [0, 0, "1"]', "got `str` - at `$.bone[0].up[2]`."),
    "too few numbers": ("up = [0, 0, 1]", "up = [0, 1]", "length 3, got 2 - at `$.bone[0].up`."),
    "not finite": ("up = [0, 0, 1]", "up = [0, 0, nan]", "- at `$.bone[0].up[2]`."),
    "unknown bone": ('parent = "root"', 'parent = "rot"', "no bone 'rot' in the model definition"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_a_bad_definition_is_refused(case: str, tmp_path: Path) -> None:
    old, new, words = BAD[case]
    assert old in TEXT
    path = tmp_path / "mine.toml"
    path.write_text(TEXT.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(HandtrackError) as refused:
        load_model(path)
    assert f"model definition {path}" in str(refused.value)
    assert words in str(refused.value)


def test_a_copy_of_ours_is_the_same_model(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text(TEXT, encoding="utf-8")
    mine, ours = load_model(tmp_path / "mine.toml"), load_model("glove9")
    assert mine.parameter_names == ours.parameter_names
    assert (mine.skeleton.offset == ours.skeleton.offset).all()
