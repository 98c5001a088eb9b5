"""However a recording was tracked, it opens with its frames: the arm that tracking decided on is the take's, and no file says it."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from handtrack.session.formats.tables import read_npz
from handtrack.simulation.simulate import Simulation, simulate
from handtrack_app.cli import main
from handtrack_app.commands.terminal import tracking_progress
from handtrack_app.start.start_page import StartPage
from handtrack_app.workbench import Workbench
from tests.app.commands.test_cli_interrupts import Interrupter
from tests.app.page.test_browser import PageUnderTest, browsing
from tests.app.waiting import eventually
from tests.app.wire import WireClient

pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
pytestmark = pytest.mark.browser
FRAMES = 2


@pytest.fixture(scope="module")
def bare_arm(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording in which an arm is seen, without a first pose; not to be changed."""
    folder = tmp_path_factory.mktemp("arm") / "recording"
    simulate(folder, Simulation(frames=FRAMES, size=(320, 240), forearm=True))
    (folder / "init.json").unlink()
    return folder


@pytest.fixture
def cancelled(bare_arm: Path, tmp_path: Path) -> Path:
    """The recording, tracked until Ctrl-C after its first frame."""
    session = Path(shutil.copytree(bare_arm, tmp_path / "session"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tracking_progress, "progress_bar", lambda *_: Interrupter(1))
        assert main(["track", str(session), "--init", "auto", "--yes"]) == 130
    return session


@pytest.fixture
def made(bare_arm: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A session of its videos, made and tracked by the start page."""
    monkeypatch.setenv("HANDTRACK_HOME", str(tmp_path / "home"))
    material = tmp_path / "material"
    material.mkdir()
    for file in (bare_arm / "calibration.toml", *bare_arm.glob("*.mp4")):
        shutil.copy(file, material)
    page = StartPage("127.0.0.1", 0)
    try:
        with WireClient(page.door.url) as client:
            client.set_value(page.folder, str(material))
            eventually(lambda: page.make.visible, "found")
            client.set_value(page.masks, "skin colour")
            client.set_value(page.tracked, "right hand")
            client.set_value(page.track, True)
            eventually(lambda: page.track.value, "ticked")
            client.set_value(page.make, True)
            eventually(lambda: page.chosen is not None, "made and tracked", 600.0)
        assert page.chosen is not None
        return page.chosen
    finally:
        page.stop()


def shows_all_frames(view: PageUnderTest, bench: Workbench, session: Path) -> None:
    """The timeline of the page has every frame of the result, and nothing is said to be hidden."""
    frames = read_npz(session / "tracks" / "poses.npz").frame.tolist()
    strip = eventually(lambda: bench.layout.timeline.strip, "a timeline")
    there = [strip.start + n for n, status in enumerate(strip.status) if status >= 0]
    assert there == frames and frames
    assert view.page.get_by_text("nothing tracked").count() == 0
    assert view.page.get_by_text("Show them").count() == 0


def opens_with_all(session: Path) -> None:
    assert "wrist_flex" in read_npz(session / "tracks" / "poses.npz").parameter_names
    bench = Workbench(session, port=0)
    with browsing(bench) as view:
        shows_all_frames(view, bench, session)
        assert "wrist_flex" in bench.state.names


def test_what_was_tracked_is_there_when_it_is_opened(made: Path) -> None:
    opens_with_all(made)


def test_what_was_tracked_until_ctrl_c_is_there_and_shown_by_a_button_where_it_does_not_fit(
    cancelled: Path, tmp_path: Path
) -> None:
    session = Path(shutil.copytree(cancelled, tmp_path / "other"))
    opens_with_all(cancelled)
    toml = session / "session.toml"
    toml.write_text(toml.read_text().replace('forearm = "auto"', "forearm = false"))
    bench = Workbench(session, port=0)
    with browsing(bench) as view:
        view.press("Show them")
        eventually(lambda: "wrist_flex" in bench.state.names, "the model has the arm")
        view.page.get_by_text("Show them").wait_for(state="hidden")
        shows_all_frames(view, bench, session)
