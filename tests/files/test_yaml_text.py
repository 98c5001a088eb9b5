"""YAML as calibration files use it."""

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
    ("on: yes\nat: 12:30\nday: 2001-01-01\nn: 010\nc: 1e3", {"on": "yes", "at": "12:30", "day": "2001-01-01", "n": 10, "c": 1000.0}),
    ("a: |\n  text", {"a": "text"}),
])  # fmt: skip
def test_what_is_read(text, expected):
    assert parse_yaml(text) == expected


@pytest.mark.parametrize(("text", "line"), [
    ("a: &b 1", 1),
    ("a: [1, *b]", 1),
    ("a: 1\na: 2", 2),
    ("a: [1, 2}", 1),
    ("a: [1\nb: 2", 2),
    ("a: 1\n   b: 2", 2),
    ("? [1]\n: 2", 1),
    ("\n".join(" " * i + "a:" for i in range(60)), 40),
    ("a: " + "[" * 5000, 1),
    ("a: [\n" + "1, # 2\n" * 2_000, 2001),
])  # fmt: skip
def test_what_is_refused_by_its_line(text, line):
    with pytest.raises(ValueError, match=rf"^line {line}: "):
        parse_yaml(text)
