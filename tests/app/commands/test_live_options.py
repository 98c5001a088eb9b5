"""`handtrack open --live`: what cannot be meant is refused in one paragraph, before any server starts."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.session.small_session import make_session


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("--camera", "cam0=0"), "--camera and --record go with --live only"),
        (("--record", "new"), "--camera and --record go with --live only"),
        (("--live", "--camera", "cam0"), "--camera cam0: expected NAME=DEVICE"),
        (
            ("--live", "--camera", "a=0", "--camera", "a=1"),
            "--camera a=1: expected NAME=DEVICE, each",
        ),
        (("--live", "--tolerance-ms", "0"), "--tolerance-ms 0: expected milliseconds above 0"),
        (("--live", "--record", "."), "--record . is not empty; nothing was written"),
    ],
)
def test_options_that_cannot_be_meant(
    handtrack, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...], told: str
) -> None:
    make_session(tmp_path)
    monkeypatch.chdir(tmp_path)
    ended = handtrack("open", tmp_path, *words)
    assert ended.code == 2
    assert told in ended.err


def test_live_needs_a_folder(handtrack) -> None:
    ended = handtrack("open", "--live")
    assert ended.code == 2
    assert "--live needs calibrated cameras: name a session folder" in ended.err
