"""Files of time stamps that cannot be used: each says what is wrong with it."""

from pathlib import Path

import pytest

from tests.session.small_session import edit, make_session
from tests.session.test_bad_sessions import contains, refusal


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return make_session(tmp_path)


TIMES: dict[str, tuple[str, list[str]]] = {
    "columns": ("cam,frame,t\ncam0,0,0.0", ["the columns are cam,frame,t", "camera,frame,time_s"]),
    "empty": ("", ["the columns are missing", "expected camera,frame,time_s"]),
    "text": ("camera,frame,time_s\ncam0,one,0.0", ["line 2: 'cam0,one,0.0'", "whole frame number"]),
    "short": ("camera,frame,time_s\ncam0,1", ["line 2: 'cam0,1,None'", "and seconds"]),
    "NaN": ("camera,frame,time_s\ncam0,1,nan", ["line 2: frame 1, time nan", "finite seconds"]),
    "camera": ("camera,frame,time_s\ncam9,1,0.1", ["line 2: unknown camera 'cam9'", "cam0, cam1"]),
    "twice": ("camera,frame,time_s\ncam0,1,0.1\ncam0,1,0.2", ["line 3: a second time", "frame 1"]),
    "backwards": ("camera,frame,time_s\ncam0,0,0.2\ncam0,1,0.1", ["time of frame 1 is not later"]),
    "one": ("camera,frame,time_s\ncam0,0,0.2", ["times of 1 frames; expected at least two"]),
    "decimal comma": ("camera,frame,time_s\ncam0,0,0,2", ["line 2: 'cam0,0,0,2'", "and seconds"]),
}


@pytest.mark.parametrize("case", TIMES)
def test_timestamps_that_cannot_be_used(case, folder):
    """Fault C9."""
    text, words = TIMES[case]
    (folder / "t.csv").write_text(text)
    edit(folder / "session.toml", "fps = 10.0", 'timestamps = "t.csv"')
    contains(refusal(folder), "t.csv", *words)


@pytest.mark.parametrize("fps", ["", "fps = 10.0\n"])
@pytest.mark.parametrize(
    ("unit", "per_s"), [("milliseconds", 1e3), ("microseconds", 1e6), ("nanoseconds", 1e9)]
)
def test_c10_times_in_another_unit_are_refused(fps, unit, per_s, folder):
    start = 1_700_000_000 if fps else 0  # from the epoch, or from the recording's start
    step = 0.1 if fps else 1 / 30
    rows = [f"cam0,{f},{(start + f * step) * per_s:.0f}" for f in range(4)]
    (folder / "t.csv").write_text("\n".join(["camera,frame,time_s", *rows]))
    edit(folder / "session.toml", "fps = 10.0", f'{fps}timestamps = "t.csv"')
    contains(refusal(folder), "t.csv", f"Are these {unit}", f"Multiply time_s by {1 / per_s:g}")
