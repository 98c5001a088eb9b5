"""A hostile client that knows the token, against a whole workbench: what `handtrack bench hostile` does for five minutes, in seconds."""

import re
import time
from pathlib import Path

import numpy as np
import pytest

from handtrack_app.log import logging_to
from tests.experiments.workbench import attacks
from tests.experiments.workbench.wire import WireClient

FEWER = {
    "_VALUES": 3000, "_UPLOAD_BYTES": 70_000_000, "_FLOOD_S": 1.0, "_SLOW_READERS": 4, "_SLOW_S": 0.5,
    "_RECONNECTS": 100, "_PIECES": 600_000,
}  # fmt: skip


def resident_mb():
    status = Path("/proc/self/status")
    if not status.is_file():
        return 0.0  # told by this system in no such way
    return float(re.search(r"VmRSS:\s+(\d+)", status.read_text())[1]) / 1000


def callbacks(bench):
    known = bench.server.gui._gui_input_handle_from_uuid
    return {uuid: len(handle._impl.update_cb) for uuid, handle in known.items()}


@pytest.mark.parametrize("name", list(attacks.ATTACKS))
def test_a11_c49_a_hostile_client_harms_nobody(bench, tmp_path, capfd, monkeypatch, name):
    for constant, fewer in FEWER.items():
        monkeypatch.setattr(attacks, constant, fewer)
    slider, before = bench.layout.pose.sliders["index_mcp_flex"], callbacks(bench)
    page = attacks.TargetPage(bench.url, list(before))
    with logging_to(tmp_path / "log"), WireClient(bench.url) as honest:
        memory = resident_mb()
        attacks.ATTACKS[name](page)
        time.sleep(0.3)
        for k in range(9):
            sent = honest.set_value(slider, 10.0 + k + np.random.default_rng(k).random())
            came = honest.wait_for(sent, "/hand/flesh", "batched_positions")
            assert came is not None, "the hand did not move"
        assert resident_mb() - memory < 50
    now = callbacks(bench)
    assert {uuid: now.get(uuid) for uuid in before} == before
    assert capfd.readouterr() == ("", "")
