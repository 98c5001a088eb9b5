"""How an ended engine is spoken of, and how much memory it may use."""

from __future__ import annotations

import signal
from pathlib import Path

import pytest

from handtrack_app.process import memory
from handtrack_app.process.engine_process import ending_words
from handtrack_app.process.memory import GB


@pytest.mark.parametrize(
    ("code", "said", "words"),
    [
        (-9, b"", "ended from outside (SIGKILL), as the system does when memory runs out. It may use 3.0"),
        (-11, b"", "crashed (SIGSEGV), a mistake in handtrack or in a library."),
        (-6, b"terminate called after throwing 'std::bad_alloc'\n", "crashed (SIGABRT), for want of memory. It"),
        (1, b"", "ended with exit code 1, a mistake"),
        (-10**6, b"", "ended from outside (signal 1000000)"),
        (0, b"", "asked to end (SIGTERM), by a person or by a guard of the memory."),
    ],
)  # fmt: skip
def test_c40_how_it_ended_is_said_in_words(
    tmp_path: Path, code: int, said: bytes, words: str
) -> None:
    log = tmp_path / "log"
    before = b"std::bad_alloc, in the life before\n"
    log.write_bytes(before + said)
    assert words in ending_words(code, 3 * GB, log, len(before))
    log.write_bytes(b"std::bad_alloc, long ago\n" + 20_000 * b"." + said)
    assert words in ending_words(code, 3 * GB, log, 0)
    assert "crashed" in ending_words(-signal.SIGABRT, None, tmp_path / "no log", 0)


def test_c40_a_container_has_what_its_groups_allow(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    own, groups = tmp_path / "cgroup", tmp_path / "groups"
    monkeypatch.setattr(memory, "_OWN_GROUPS", own)
    monkeypatch.setattr(memory, "_CONTROL_GROUPS", groups)
    physical = memory.machine_memory()
    (groups / "a/b").mkdir(parents=True)
    (groups / "memory/c").mkdir(parents=True)
    (groups / "a/b/memory.max").write_text("max\n")
    (groups / "a/memory.max").write_text(f"{2 * GB}\n")
    (groups / "memory/c/memory.limit_in_bytes").write_text(f"{GB}\n")
    own.write_text("0::/a/b\n")
    assert memory.machine_memory() == min(physical, 2 * GB)
    own.write_text("0::/a/b\n4:cpu,memory:/c\n3:pids:/d\n")
    assert memory.machine_memory() == min(physical, GB)
    assert memory.memory_limit() == GB, "less would be too little to begin with"
    own.write_text("0::/elsewhere\n")
    assert memory.machine_memory() == physical
