"""However a recording was tracked, it opens with its frames: the arm that tracking decided on is the take's, and no file says it."""

import shutil

import pytest

from handtrack import read_npz
from handtrack.simulation.simulate import Simulation, simulate
from handtrack_app.cli import main
from handtrack_app.commands import track
from tests.app.command_line import QUICK
from tests.app.commands.test_interrupts import Interrupter
from tests.app.desk import shown
from tests.app.waiting import eventually
from tests.app.wire import WireClient
from tests.session.small_session import edit


@pytest.fixture
def cancelled(tmp_path):
    """A recording in which an arm is seen, tracked until Ctrl-C after its first frame."""
    what = Simulation(frames=2, size=(320, 240), forearm=True, images=False)
    session = simulate(tmp_path / "session", what)
    with (session / "session.toml").open("a") as file:
        file.write(QUICK)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(track, "progress_bar", lambda *_: Interrupter(1))
        assert main(["track", str(session)]) == 130
    return session


def test_what_was_tracked_is_there_and_shown_by_a_button_where_it_does_not_fit(cancelled, tmp_path):
    frames = read_npz(cancelled / "tracks/poses.npz").frame.tolist()
    assert "wrist_flex" in read_npz(cancelled / "tracks/poses.npz").parameter_names
    other = shutil.copytree(cancelled, tmp_path / "other")
    edit(other / "session.toml", 'forearm = "auto"', "forearm = false")
    for session, fits in ((cancelled, True), (other, False)):
        with shown(session) as bench, WireClient(bench.url) as wire:
            timeline = bench.layout.timeline
            there = lambda: [n for n, status in enumerate(timeline.strip.status) if status >= 0]  # noqa: B023, E731
            if not fits:
                assert there() == []
                wire.press("Show them")
            eventually(lambda: there() == frames, "all that was tracked")  # noqa: B023
            assert "wrist_flex" in bench.state.names
