"""Texts: TOML, YAML and JSON, read, written and edited."""

import re
import tomllib
from pathlib import Path

import pytest

from handtrack.files.text_files import read_json
from handtrack.files.toml_edit import changed_toml
from handtrack.files.toml_table import read_toml, toml_item
from handtrack.files.yaml_text import parse_yaml
from tests.conftest import refused

BIG = "1" + "0" * 400


@pytest.mark.parametrize(
    "content", [b"\xef\xbb\xbfa = 1\r\nb = 2\r\n", b"a = 1\nb = 2"], ids=["mark and CRLF", "plain"]
)
def test_what_editors_add_does_not_matter(content, tmp_path):
    (tmp_path / "x.toml").write_bytes(content)
    assert read_toml(tmp_path / "x.toml", "settings") == {"a": 1, "b": 2}


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (
            "a = 1".encode("utf-16"),
            "x: not UTF-8 text (invalid start byte at byte 0). Save it as UTF-8.",
        ),
        (
            f"a = {BIG}".encode(),
            "x: not valid TOML: a whole number of 1329 bits; expected at most 64.",
        ),
        (f"a = [[{BIG}]]".encode(), "a whole number of 1329 bits"),
        (b"a = " + b"[" * 100_000, "x: not valid TOML: maximum recursion depth"),
        (b"a = 1\na = 2", "x: not valid TOML: Cannot overwrite a value"),
    ],
    ids=["UTF-16", "huge", "huge within", "deep", "twice"],
)
def test_toml_that_cannot_be_used(content, words, tmp_path):
    (tmp_path / "x").write_bytes(content)
    refused(re.escape(words), read_toml, tmp_path / "x", "settings")


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("", "x: not valid JSON at line 1: Expecting value; expected a pose there."),
        (
            '{"a": NaN}',
            "x: cannot be read as JSON: NaN is no JSON number; write null where a value is unknown.",
        ),
        ("[" * 100_000, "x: cannot be read as JSON: maximum recursion depth"),
    ],
    ids=["empty", "NaN", "deep"],
)
def test_json_that_cannot_be_used(content, words, tmp_path):
    (tmp_path / "x").write_text(content)
    refused(re.escape(words), read_json, tmp_path / "x", "a pose")


TEXT = """# my recording
[session]
format = 1  # of the file
fps = 25.0

[tracking]   # what I found out
solver.iterations = 20  # enough, "really"
  silhouettes.bands_mm = [6, 3, 1]
"model"."forearm" = "a # b"# odd

[tracking.prior]
posture = 4.0

[[camera]]
name = "left"
"""
REST = "# mine\n[session]\nformat = 1  # of the file\n\n[[camera]]\nname = 'left' # west\n"
SPELLINGS = {
    "own table": ("[tracking.cloud] # T\nweight = 2.0\n", "tracking.cloud.weight", 0.5, "0.5"),
    "at the root": ("tracking.cloud.weight = 2.0 # T\n", "tracking.cloud.weight", 0.5, "0.5"),
    "quoted table": ('["tracking"]\ncloud.weight = 2.0 # T\n', "tracking.cloud.weight", 0.5, "0.5"),
    "inline": ("tracking = { cloud = { weight = 2.0 } } # T\n", "tracking.cloud.weight", 0.5, "0.5"),
    "over lines": (
        "[tracking]\nsilhouettes.bands_mm = [\n 8, # first\n 2.0,\n] # T\n",
        "tracking.silhouettes.bands_mm", (8.0, 0.5), "0.5",
    ),
    "clouds, array over lines": (
        "[clouds]\nstereo = [\n  ['a', 'b'], # front\n]\ncrop_m = 2.0 # T\n", "clouds.crop_m", 0.5, "0.5",
    ),
    "clouds, skin a table": (
        "[clouds]\nfiles = 'c'\n[clouds.skin] # T\nmean = [0.4, 0.3]\nsize = 2.0\n",
        "clouds.skin", {"mean": (0.4, 0.3), "size": 0.5}, "0.5",
    ),
    "scale, single quotes": ("[hand]\nscale = 'fit' # T\n", "hand.scale", "hand.json", '"hand.json"'),
    "scale inline": ('hand = { scale = "fit" } # T\n', "hand.scale", "hand.json", '"hand.json"'),
}  # fmt: skip
"""text, name, new value, how it is written"""


@pytest.mark.parametrize("way", SPELLINGS)
def test_every_spelling_is_edited(way):
    given, name, value, written = SPELLINGS[way]
    text = REST.replace("\n[[camera]]", f"\n{given}\n[[camera]]")
    if not given.startswith("["):
        text = given + REST
    changed = changed_toml(text, {name: value})
    old = next(word for word in ("2.0", '"fit"', "'fit'") if word in given)
    expected = given.replace(" 8,", " 8.0,").replace(old, written)
    assert changed == text.replace(given, expected), "this value alone differs, all comments stay"
    table, *keys = name.split(".")
    found = tomllib.loads(changed)[table]
    for key in keys:
        found = found[key]
    assert found == (
        {"mean": [0.4, 0.3], "size": 0.5}
        if isinstance(value, dict)
        else list(value)
        if isinstance(value, tuple)
        else value
    )


def test_without_a_change_the_text_stays():
    assert changed_toml(TEXT, {}) == TEXT
    assert changed_toml(TEXT, {"tracking.prior.posture": 4, "hand.scale": None}) == TEXT


def test_a_table_stands_on_one_line():
    value = {"method": "m", "cr": [1, 2], "odd key": False}
    assert tomllib.loads(f"key = {toml_item(value).as_string()}") == {"key": value}


def test_a_file_far_larger_than_settings_are_is_not_read(tmp_path, monkeypatch):
    path = tmp_path / "session.toml"
    path.write_text("[session]\n")
    with path.open("r+b") as file:
        file.truncate(200 << 20)
    monkeypatch.setattr(Path, "read_text", None)
    refused(r"session.toml has 210 MB", read_toml, path, "settings")


@pytest.mark.parametrize(("text", "expected"), [
    ("%YAML:1.0\n---\na: 1\n...\n", {"a": 1}),
    ("a: 1.\nc: 007\nd: 1.5.2", {"a": 1.0, "c": 7, "d": "1.5.2"}),
    ("m: !!opencv-matrix\n   rows: 1\n   data: [ 1.,\n     2. ]", {"m": {"rows": 1, "data": [1.0, 2.0]}}),
    ("on: yes\nat: 12:30\nday: 2001-01-01\nn: 010\nc: 1e3", {"on": "yes", "at": "12:30", "day": "2001-01-01", "n": 10, "c": 1000.0}),
])  # fmt: skip
def test_what_is_read(text, expected):
    assert parse_yaml(text) == expected


@pytest.mark.parametrize(("text", "line"), [
    ("a: &b 1", 1),
    ("a: [1, *b]", 1),
    ("a: 1\na: 2", 2),
    ("a: [1\nb: 2", 2),
    ("? [1]\n: 2", 1),
    ("\n".join(" " * i + "a:" for i in range(60)), 40),
    ("a: " + "[" * 5000, 1),
])  # fmt: skip
def test_what_is_refused_by_its_line(text, line):
    with pytest.raises(ValueError, match=rf"^line {line}: "):
        parse_yaml(text)
