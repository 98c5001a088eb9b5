"""The lease: one writer, who it is, whether it lives, and what it is told when another takes over."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from handtrack.errors import HandtrackError
from handtrack.store import lease as lease_file
from handtrack.store.lease import Lease, LeaseTaken, holder_of
from handtrack.store.store import Store, WritableStore
from tests.store.made import about, add_take, files_of, step


def change(folder: Path, **changed: object) -> Path:
    """Make the lease of a folder one of another program."""
    (path,) = folder.glob("lease-*.json")
    path.write_text(json.dumps(json.loads(path.read_text()) | changed))
    return path


def test_a2_a_second_writer_is_told_who_holds_the_store_and_may_read(tmp_path):
    with WritableStore(tmp_path, "handtrack track") as store:
        add_take(store, range(3))
        with pytest.raises(LeaseTaken) as told:
            WritableStore(tmp_path, "handtrack open")
        assert f"`handtrack track` (process {os.getpid()} on " in str(told.value)
        assert "so nothing was changed" in str(told.value)
        assert Store(tmp_path).takes()[0].frames == (0, 1, 2)
        assert store.lease.holder == holder_of(tmp_path)
    assert holder_of(tmp_path) is None
    assert not [name for name in files_of(tmp_path) if "lease" in name]


def test_a2_who_is_taken_over_is_told_and_nothing_of_either_is_lost(tmp_path):
    first = WritableStore(tmp_path, "the first")
    begun = first.begin(about())
    rng = np.random.default_rng(0)
    begun.add(step(rng, 0))
    with WritableStore(tmp_path, "the second", take_over=True) as second:
        assert second.lease.generation == 2
        with pytest.raises(
            HandtrackError, match="`the second` .* took over, so this change was not saved"
        ):
            begun.add(step(rng, 1))
        second.go_on(second.take(1)).add(step(rng, 1))
    first.close()
    assert Store(tmp_path).take(1).frames == (0, 1)
    assert files_of(tmp_path) == ["takes/0001/000001.log", "takes/0001/000002.log"]
    assert not Store(tmp_path).damage()


def test_a_lease_of_a_program_that_was_killed_is_stale(tmp_path):
    code = "import sys,os; from handtrack.store.lease import Lease; from pathlib import Path; " \
        "Lease.acquire(Path(sys.argv[1]), 'killed'); os._exit(9)"  # fmt: skip
    subprocess.run([sys.executable, "-c", code, str(tmp_path)], check=False)
    assert files_of(tmp_path) == ["lease-000001.json"]
    assert holder_of(tmp_path) is None
    with WritableStore(tmp_path, "the next") as store:
        assert files_of(tmp_path) == ["lease-000002.json"]
        assert store.lease.generation == 2


def test_a_torn_lease_is_no_reason_to_write(tmp_path):
    (tmp_path / "lease-000004.json").write_text('{"generation": 4, "pro')
    with pytest.raises(LeaseTaken, match="an unknown program"):
        WritableStore(tmp_path, "here")
    os.utime(tmp_path / "lease-000004.json", (0, 0))  # whoever wrote that was killed at it
    with WritableStore(tmp_path, "here") as store:
        assert store.lease.generation == 5


def test_of_two_that_find_a_stale_lease_one_gets_it(tmp_path, monkeypatch):
    really, others = lease_file._newest, []

    def newest(folder: Path) -> Path | None:
        found = really(folder)
        if not others:
            others.append(None)
            others[0] = Lease.acquire(folder, "the quicker")
        return found

    monkeypatch.setattr(lease_file, "_newest", newest)
    with pytest.raises(LeaseTaken, match="`the quicker`"):
        Lease.acquire(tmp_path, "the slower")
    others[0].release()
