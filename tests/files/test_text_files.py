"""Text that people and other programs write: editors' marks, foreign encodings, numbers beyond any measure."""

import pytest

from handtrack.errors import HandtrackError
from handtrack.files.text_files import read_json
from handtrack.files.toml_text import read_toml

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
    with pytest.raises(HandtrackError) as caught:
        read_toml(tmp_path / "x", "settings")
    assert words in str(caught.value)


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
    with pytest.raises(HandtrackError) as caught:
        read_json(tmp_path / "x", "a pose")
    assert words in str(caught.value)
