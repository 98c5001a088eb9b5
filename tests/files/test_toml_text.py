"""TOML values on one line, read back by the standard library."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
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
def test_values_read_back(value: Any) -> None:
    assert tomllib.loads(f"key = {toml_item(value).as_string()}") == {"key": value}


def test_tuples_are_arrays_and_lists_of_mappings_stay_on_their_line() -> None:
    assert toml_item((1.0, 2)).as_string() == "[1.0, 2]"
    assert toml_item([{"a": 1}]).as_string() == "[{a = 1}]"
    assert toml_item(np.float64(0.5)).as_string() == "0.5"


def test_files_that_are_no_text(tmp_path: Path) -> None:
    path = tmp_path / "x.toml"
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(HandtrackError, match=r"x.toml: not UTF-8 text"):
        read_toml(path, "settings")
    with pytest.raises(HandtrackError, match=r"is a folder; expected settings"):
        read_toml(tmp_path, "settings")


def test_a_file_far_larger_than_settings_are_is_not_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "session.toml"
    path.write_text("[session]\n")
    with path.open("r+b") as file:
        file.truncate(200 << 20)
    monkeypatch.setattr(Path, "read_text", None)
    with pytest.raises(HandtrackError, match=r"session.toml has 210 MB"):
        read_toml(path, "settings")
