"""What a page shows, whole: the numbers of its widgets, drawings and scene are those that were recorded."""

import os
import re
import time

import numpy as np
import pytest

from handtrack.simulation.simulate import Simulation, simulate
from tests.app.cloudy_session import cloudy_session
from tests.app.desk import shown
from tests.app.waiting import eventually
from tests.app.wire import WireClient, said
from tests.golden.meaning import numbers, unlike_recorded

BODY = Simulation(
    cameras=2, frames=2, size=(96, 72), motion="still", model="body34", distance_m=3.5, images=False
)
UNSTEADY = re.compile(r"base64,[^\"']*|\d+-\d+-\d+|[\d:]*:\d+|[\d.]+ s\b")
"""pictures, dates and how long something took"""
SKIPPED = {"order", "uuid", "run_id", "name", "label", "source", "counter"}
"""what viser counts through; words"""


def brief(value):
    """Return the numbers of a message's value; of a long array a few that tell it from others."""
    if isinstance(value, str):
        return numbers(UNSTEADY.sub("", value)) if value.startswith("<") else None
    if isinstance(value, bytes):
        return len(value) > 0
    if isinstance(value, np.ndarray):
        if len(value) <= 12:
            return value.tolist()
        values = value.astype(float)
        along = np.linspace(0.0, 1.0, len(values))
        return [len(values), values.mean(), values.std(), (along * values).mean()]
    if isinstance(value, dict):
        known = {key: brief(one) for key, one in value.items() if key[0] != "_"}
        return {key: one for key, one in known.items() if key not in SKIPPED and one is not None}
    return [brief(one) for one in value] if isinstance(value, tuple | list) else value


def page_of(bench):
    """Return what a page that comes now is shown: widgets in their order, and the scene by names."""
    with WireClient(bench.url) as client:
        eventually(lambda: said(client, "ReplayDoneMessage"))
        messages = [message for _, message in client.messages]
    there = {}
    for message in messages[: [m["type"] for m in messages].index("ReplayDoneMessage")]:
        name = message.get("uuid") or message.get("name") or message["type"]
        there.setdefault(name, {}).update(message.get("props", {}) | message)
        there[name].update(message.get("updates", {}))
        there[name] |= {"props": None, "updates": None, "type": None}
    return [[name[0] == "/" and name, brief(one)] for name, one in there.items()]


def assert_as_recorded(name, bench):
    eventually(lambda: bench.state.progress.state == "idle")
    for _ in range(8):  # clouds and pictures come later than the rest; the last page is recorded
        time.sleep(0.5)
        unlike = unlike_recorded(f"page_{name}", page_of(bench))
        if not unlike and "HANDTRACK_RECORD" not in os.environ:
            break
    assert not unlike


@pytest.mark.parametrize("name, made", [
    ("cloud", cloudy_session),
    ("body", lambda folder: simulate(folder, BODY)),
])  # fmt: skip
def test_a_page_shows_what_was_recorded(tmp_path, name, made):
    with shown(made(tmp_path)) as bench:
        assert_as_recorded(name, bench)


def test_a_page_of_what_is_tracked_shows_what_was_recorded(done):
    with shown(done) as bench:
        assert_as_recorded("tracked", bench)


def test_a_page_with_truth_and_bones_shows_what_was_recorded(bench, wire):
    wire.set_value(bench.layout.session.mode, "skeleton")
    eventually(lambda: bench.stage.hand.bones.visible)
    assert_as_recorded("fake", bench)
