"""YAML as calibration files use it."""

from __future__ import annotations

import math
from typing import Any

import pytest

from handtrack.files.yaml_text import parse_yaml


@pytest.mark.parametrize(("text", "expected"), [
    ("", None),
    ("%YAML:1.0\n---\na: 1\n...\n", {"a": 1}),
    ("a: 1.\nb: -2e-3\nc: 007\nd: 1.5.2", {"a": 1.0, "b": -0.002, "c": 7, "d": "1.5.2"}),
    ("a: true\nb: null\nc: ~\nd:", {"a": True, "b": None, "c": None, "d": None}),
    ("a: 'x: # y'  # z\n# all\nb: c#d", {"a": "x: # y", "b": "c#d"}),
    ("a:\n  b:\n    - 1\n    - [2, 3]\n  c: {d: 4, e: [5]}", {"a": {"b": [1, [2, 3]], "c": {"d": 4, "e": [5]}}}),
    ("a:\n- 1\n- 2\nb: 3", {"a": [1, 2], "b": 3}),
    ("- a: 1\n  b: 2\n-\n  a: 3\n- - 4\n  - 5", [{"a": 1, "b": 2}, {"a": 3}, [4, 5]]),
    ("m: !!opencv-matrix\n   rows: 1\n   data: [ 1.,\n     2. ]", {"m": {"rows": 1, "data": [1.0, 2.0]}}),
    ("topic: /cam0/image_raw\ntime: Tue 01 Feb 10:11:12", {"topic": "/cam0/image_raw", "time": "Tue 01 Feb 10:11:12"}),
])  # fmt: skip
def test_what_is_read(text: str, expected: Any) -> None:
    assert parse_yaml(text) == expected


def test_numbers_that_are_none() -> None:
    read = parse_yaml("a: [.nan, .inf, -.inf, .Nan, .Inf]")["a"]
    assert [math.isnan(v) for v in read] == [True, False, False, True, False]
    assert read[1:3] == [math.inf, -math.inf]


@pytest.mark.parametrize(("text", "said"), [
    ("a: &b 1", "line 1: '&'"),
    ("a: [1, *b]", "line 1: '[*]'"),
    ("a: |\n  text", "line 1: '[|]'"),
    ("a: 1\na: 2", "line 2: the key 'a' stands twice"),
    ("a: [1, 2}", "line 1: brackets that do not match"),
    ("a: [1\nb: 2", "line 1: a bracket is not closed"),
    ("a: 1\n   b: 2", "line 2: this line fits nothing above it"),
    ("\n".join(" " * i + "a:" for i in range(60)), "nested more than 40 times"),
])  # fmt: skip
def test_what_is_refused(text: str, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        parse_yaml(text)


def test_a_large_file_is_read_to_its_end() -> None:
    """A bracket that stays open over many lines, and marks of comments within quotes."""
    with pytest.raises(ValueError, match="not closed"):
        parse_yaml("a: [\n" + "1, # 2\n" * 200_000)
    parse_yaml('a: "' + "#" * 1_000_000 + '"')
