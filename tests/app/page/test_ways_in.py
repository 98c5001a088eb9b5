"""However a recording was tracked, it opens with its frames: the arm that tracking decided on is the take's, and no file says it."""

import shutil

from handtrack import read_npz
from handtrack.simulation.simulate import Simulation, simulate
from tests.app.command_line import QUICK
from tests.app.commands.test_interrupts import interrupted
from tests.app.desk import shown
from tests.app.waiting import eventually
from tests.app.wire import WireClient
from tests.session.small_session import edit


def test_what_was_tracked_is_there_and_shown_by_a_button_where_it_does_not_fit(
    handtrack, tmp_path, monkeypatch
):
    """A recording in which an arm is seen was tracked until Ctrl-C after its first frame."""
    what = Simulation(frames=2, size=(320, 240), forearm=True, images=False)
    cancelled = simulate(tmp_path / "session", what)
    with (cancelled / "session.toml").open("a") as file:
        file.write(QUICK)
    with interrupted(monkeypatch, 1):
        assert handtrack("track", cancelled).code == 130
    frames = read_npz(cancelled / "tracks/poses.npz").frame.tolist()
    assert "wrist_flex" in read_npz(cancelled / "tracks/poses.npz").parameter_names
    other = shutil.copytree(cancelled, tmp_path / "other")
    edit(other / "session.toml", 'forearm = "auto"', "forearm = false")
    for session, fits in ((cancelled, True), (other, False)):
        with shown(session) as bench, WireClient(bench.url) as wire:
            there = lambda: [n for n, status in enumerate(bench.state.strip.status) if status >= 0]  # noqa: E731
            if not fits:
                assert there() == []
                wire.press("Show them")
            eventually(lambda: there() == frames)  # noqa: B023
            assert "wrist_flex" in bench.state.names
