"""TOML values on one line, read back by the standard library."""

import tomllib
from pathlib import Path
from typing import Any

import pytest

from handtrack.errors import HandtrackError
from handtrack.files.toml_text import read_toml, toml_item

VALUES: list[Any] = [
    'a "quoted" \\ text\twith ünïcode 🖐 and \x7f',
    True,
    -3,
    0.1,
    1e-300,
    float("inf"),
    [1, [2.5, "x"]],
    {"method": "m", "cr": [1, 2], "odd key": False},
]


@pytest.mark.parametrize("value", VALUES, ids=str)
def test_values_read_back(value):
    assert tomllib.loads(f"key = {toml_item(value).as_string()}") == {"key": value}


def test_a_file_far_larger_than_settings_are_is_not_read(tmp_path, monkeypatch):
    path = tmp_path / "session.toml"
    path.write_text("[session]\n")
    with path.open("r+b") as file:
        file.truncate(200 << 20)
    monkeypatch.setattr(Path, "read_text", None)
    with pytest.raises(HandtrackError, match=r"session.toml has 210 MB"):
        read_toml(path, "settings")
