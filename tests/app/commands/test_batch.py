"""`handtrack batch`: many recordings, gone on with after any end, nothing done twice, the worst first."""

import csv
import json
import os
import random
import sys
import time
from collections import Counter

import pytest

from handtrack_app.cli import main
from handtrack_app.commands import batch
from handtrack_app.commands.batch import (
    DONE,
    INTERRUPTED,
    STARTED,
    Outcome,
    append,
    read_ledger,
)
from tests.app.waiting import eventually
from tests.conftest import REPOSITORY
from tests.killing import copy_of_a_fresh_process, forked

FAKE = "tests.app.commands.fake_child"
KILLS = 3


@pytest.fixture
def quick(monkeypatch):
    """Recordings are tracked by a stand-in."""
    monkeypatch.setattr(batch, "_CHILD", FAKE)
    monkeypatch.setattr(batch, "_CHILD_POLL_S", 0.02)
    monkeypatch.syspath_prepend(str(REPOSITORY))


def folders(root, count, broken=0):
    """Make folders with a session.toml each; the last `broken` are refused."""
    made = [root / f"take{number}" for number in range(count)]
    for row, folder in enumerate(made):
        folder.mkdir(parents=True)
        (folder / "session.toml").write_text("")
        if row >= count - broken:
            (folder / "ends").write_text("no calibration.")
    return made


def begun(root):
    """Return how often the work on each recording began."""
    lines = (root / "work.log").read_text().splitlines()
    return Counter(line.split()[1] for line in lines if line.startswith("begun"))


def test_the_worst_is_reported_first_and_what_is_done_stays_done_until_something_changes(
    tmp_path, handtrack, quick
):
    made = folders(tmp_path / "takes", 4, broken=1)
    words = ["batch", tmp_path / "takes" / "*" / "session.toml", "--out", tmp_path / "out"]
    first = handtrack(*words, "--most-lost", "0.1", "--json")
    assert first.code == 3
    outcomes = {row["recording"]: row for row in json.loads(first.out)["recordings"]}
    assert outcomes["take1"]["frames"] == {"tracked": 9, "doubtful": 0, "lost": 1}
    refused = outcomes["take3"]
    assert (refused["state"], refused["cause"]) == ("refused", "no calibration.")
    with (tmp_path / "out" / "report.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["recording"] for row in rows] == ["take3", "take2", "take1", "take0"]
    assert rows[1]["open"] == f"handtrack open {tmp_path / 'takes' / 'take2'}"
    page = (tmp_path / "out" / "report.html").read_text()
    assert "&lt;b&gt;" in page
    assert "http" not in page

    assert handtrack(*words).code == 2  # a batch is there: --resume, or another folder
    again = handtrack(*words, "--resume")
    assert again.code == 3
    assert "4 of 4" in again.err
    (made[0] / "session.toml").write_text("# changed")
    (made[1] / "tracks" / "poses.npz").unlink()
    assert handtrack(*words, "--resume").code == 3
    assert begun(tmp_path / "takes") == {"take0": 2, "take1": 2, "take2": 1, "take3": 1}
    assert handtrack(*words, "--resume", "--set", "solver.iterations=5").code == 3
    assert begun(tmp_path / "takes") == {"take0": 3, "take1": 3, "take2": 2, "take3": 2}


def ended(ledger):
    return [outcome for outcome in read_ledger(ledger) if outcome.state != STARTED]


def run_batch(*words):
    batch._CHILD, batch._CHILD_POLL_S = FAKE, 0.02
    os.chdir(REPOSITORY)
    sys.exit(main(["batch", *words]))


@forked
def test_killed_at_random_at_most_one_recording_a_job_is_done_again(tmp_path):
    """And their processes end with the batch that began them."""
    count, jobs, rng = 8, 2, random.Random(3)
    folders(tmp_path / "takes", count, broken=2)
    words = [f"{tmp_path}/takes/*", "--jobs", str(jobs), "--resume", "--out", f"{tmp_path}/out"]
    kills, ledger = 0, tmp_path / "out" / "ledger.jsonl"
    while True:
        settled = len(ended(ledger))
        child = copy_of_a_fresh_process(run_batch, *words)
        if kills == KILLS:
            child.join()
            assert child.exitcode == 3
            break
        eventually(lambda: not child.is_alive() or len(ended(ledger)) > settled)  # noqa: B023
        time.sleep(rng.uniform(0.0, 0.1))
        child.kill()
        child.join()
        kills += 1
    done = begun(tmp_path / "takes")
    assert len(done) == count
    assert sum(done.values()) - count <= KILLS * jobs
    for row in csv.DictReader((tmp_path / "out" / "report.csv").read_text().splitlines()):
        assert row["state"] == ("done" if int(row["recording"][4:]) < count - 2 else "refused")


def test_a_torn_line_of_the_ledger_costs_that_line_alone(tmp_path):
    file = tmp_path / "ledger.jsonl"
    first, second = (Outcome(name, f"/{name}", "1", DONE, 0) for name in "ab")
    append(file, first)
    with file.open("ab") as torn:
        torn.write(b'{"recording": "c", "fold')
    append(file, second)
    assert read_ledger(file) == [first, second]


def test_what_is_stopped_before_it_listens_was_interrupted_and_did_not_fail(tmp_path, quick):
    """A child that is told to stop while Python still starts ends by the signal."""
    early = Outcome("early", str(tmp_path), "5f0c")
    ended = batch.track_one((), tmp_path, 1, early, should_stop=lambda: True)
    assert (ended.state, ended.exit_code) == (INTERRUPTED, 130)
