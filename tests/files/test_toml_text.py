"""TOML values on one line, read back by the standard library."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from handtrack.errors import HandtrackError
from handtrack.files.toml_text import read_toml, toml_key, toml_value

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
    assert tomllib.loads(f"key = {toml_value(value)}") == {"key": value}


def test_numpy_numbers_and_keys() -> None:
    assert toml_value(np.float64(0.5)) == "0.5"
    assert toml_key("crop_m") == "crop_m"
    assert tomllib.loads(f"{toml_key('a b')} = 1") == {"a b": 1}
    with pytest.raises(TypeError, match=r"no TOML for set"):
        toml_value({1})


def test_files_that_are_no_text(tmp_path: Path) -> None:
    path = tmp_path / "x.toml"
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(HandtrackError, match=r"x.toml: not UTF-8 text"):
        read_toml(path, "settings")
    with pytest.raises(HandtrackError, match=r"cannot read settings: Is a directory"):
        read_toml(tmp_path, "settings")
