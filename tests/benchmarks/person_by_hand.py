"""A real person before four cameras, by mouse and keys alone: from a folder with joints and videos to accepted frames.

Run: python -m tests.benchmarks.person_by_hand FOLDER. It prints figures as JSON; FOLDER gets pictures, and the session that is made
of pose2sim_body_4cam of the shared test data. Needs Chromium and HANDTRACK_DATA; says so and ends where either is missing.
"""

from __future__ import annotations

import json
import shutil
import sys
import time
from pathlib import Path
from typing import Any

from handtrack.bench.measuring import data_folder
from handtrack.session.session import Session
from handtrack_app.cli import main as handtrack
from handtrack_app.page.views.room import POSE
from handtrack_app.process.plan import EnginePlan
from handtrack_app.workbench import Workbench
from tests.app.page.test_browser import browsing
from tests.benchmarks.desk_by_hand import Person, accept_all
from tests.experiments.workbench.chromium import there_is_one

DATA = "pose2sim_body_4cam"


def run(person: Person) -> dict[str, Any]:
    """Find the body, track all, accept; return the figures."""
    bench, view, figures = person.bench, person.view, dict[str, Any]()
    began = time.monotonic()
    if POSE in next(iter(bench.layout.room.tastes.values())).folded:
        person.key("t")
    view.page.get_by_role("button", name="any frame", exact=True).wait_for()
    person.press("any frame")
    figures["found_s"] = person.idle("the search")
    person.until(lambda: person.pose.origin == "found", "it is taken")
    person.picture("found")
    person.tab("Track")
    person.press("Track all frames")
    figures["tracked_s"] = person.idle("tracking")
    figures["actions_to_track"] = person.actions
    strip = bench.layout.timeline.strip
    assert strip is not None
    figures["status"] = {str(int(s)): int((strip.status == s).sum()) for s in set(strip.status)}
    person.picture("tracked")
    accept_all(person, range(bench.state.start, bench.state.stop), figures)
    person.key("Shift+V")
    person.picture("accepted")
    figures["actions"], figures["seconds"] = person.actions, time.monotonic() - began
    return figures


def main(folder: str) -> None:
    data = data_folder() / DATA
    if not data.is_dir() or not there_is_one():
        print(f"left out: needs {data} and Chromium")
        return
    out = Path(folder)
    out.mkdir(parents=True, exist_ok=True)
    made = out / "person"
    shutil.rmtree(made, ignore_errors=True)
    code = handtrack(["new", "--out", str(made), "--project", str(data), "--yes"])
    assert not code, "the session was not made"
    bench = Workbench(made, port=0, plan=EnginePlan(made))
    with browsing(bench, dpr=0.5, size=(1280, 800), unfold=False) as view:
        person = Person(bench, view, Session.open(made).rig, out)
        person.until(lambda: bench.layout.tracking.progress.state == "idle", "ready")
        view.page.wait_for_timeout(3000)
        print(json.dumps(run(person), indent=1), flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
