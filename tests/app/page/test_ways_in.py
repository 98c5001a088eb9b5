"""However a recording was tracked, it opens with its frames: the arm that tracking decided on is the take's, and no file says it."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from handtrack.session.formats.tables import read_npz
from handtrack.simulation.simulate import Simulation, simulate
from handtrack_app.commands.terminal import tracking_passes
from handtrack_app.start.start_page import StartPage
from handtrack_app.workbench import Workbench
from tests.app.command_line import CommandLine
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


Way = Callable[[CommandLine, Path, Path, pytest.MonkeyPatch], Path]
"""tracks a recording in an empty folder; returns the session's folder"""


def by_track(handtrack: CommandLine, given: Path, empty: Path, patch: pytest.MonkeyPatch) -> Path:
    session = Path(shutil.copytree(given, empty / "session"))
    assert handtrack("track", session, "--init", "auto", "--yes").code == 0
    return session


def by_track_cancelled(
    handtrack: CommandLine, given: Path, empty: Path, patch: pytest.MonkeyPatch
) -> Path:
    session = Path(shutil.copytree(given, empty / "session"))
    with patch.context() as inner:
        inner.setattr(tracking_passes, "progress_bar", lambda *_: Interrupter(1))
        assert handtrack("track", session, "--init", "auto", "--yes").code == 130
    return session


def by_new(handtrack: CommandLine, given: Path, empty: Path, patch: pytest.MonkeyPatch) -> Path:
    videos = [word for n in range(3) for word in ("--video", f"cam{n}={given / f'cam{n}.mp4'}")]
    made, calibration = empty / "made", given / "calibration.toml"
    ended = handtrack(
        "new", "--out", made, "--calibration", calibration, *videos, "--masks", "skin_ycrcb",
        "--side", "right", "--track", "--yes",
    )  # fmt: skip
    assert ended.code == 0, ended.err
    return made


def by_batch(handtrack: CommandLine, given: Path, empty: Path, patch: pytest.MonkeyPatch) -> Path:
    session = Path(shutil.copytree(given, empty / "session"))
    ended = handtrack("batch", session, "--out", empty / "batch", "--init", "auto", "--yes")
    assert ended.code == 0, ended.err
    return session


def by_start_page(
    handtrack: CommandLine, given: Path, empty: Path, patch: pytest.MonkeyPatch
) -> Path:
    patch.setenv("HANDTRACK_HOME", str(empty / "home"))
    material = empty / "material"
    material.mkdir()
    for file in (given / "calibration.toml", *given.glob("*.mp4")):
        shutil.copy(file, material)
    page = StartPage("127.0.0.1", 0)
    try:
        with WireClient(page.door.url) as client:
            client.set_value(page.folder, str(material))
            eventually(lambda: page.folder.value == str(material), "typed")
            client.set_value(client.button("Look into it"), True)
            eventually(lambda: page.make.visible, "found")
            client.set_value(page.masks, "skin colour")
            client.set_value(page.tracked, "a right hand")
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
    assert view.page.locator(".handtrack-hidden").count() == 0


@pytest.mark.parametrize(
    "way", [by_track, by_track_cancelled, by_new, by_batch, by_start_page], ids=lambda w: w.__name__
)
def test_what_was_tracked_is_there_when_it_is_opened(
    way: Way, handtrack: CommandLine, bare_arm: Path, tmp_path: Path, monkeypatch
) -> None:
    session = way(handtrack, bare_arm, tmp_path, monkeypatch)
    assert "wrist_flex" in read_npz(session / "tracks" / "poses.npz").parameter_names
    bench = Workbench(session, port=0)
    with browsing(bench) as view:
        shows_all_frames(view, bench, session)
        assert "wrist_flex" in bench.state.names


def test_frames_that_do_not_show_are_named_and_shown_by_a_button(
    handtrack: CommandLine, bare_arm: Path, tmp_path: Path, monkeypatch
) -> None:
    session = by_track_cancelled(handtrack, bare_arm, tmp_path, monkeypatch)
    toml = session / "session.toml"
    toml.write_text(toml.read_text().replace('forearm = "auto"', "forearm = false"))
    bench = Workbench(session, port=0)
    with browsing(bench) as view:
        view.page.locator(".handtrack-hidden").first.wait_for()
        view.press("Show them")
        eventually(lambda: "wrist_flex" in bench.state.names, "the model has the arm")
        view.page.locator(".handtrack-hidden").first.wait_for(state="hidden")
        shows_all_frames(view, bench, session)


def test_the_tutorials_material_is_all_there(
    handtrack: CommandLine, tmp_path: Path, monkeypatch
) -> None:
    """Its first frames; `HANDTRACK_TUTORIAL` takes them all."""
    handtrack("sample", "two_videos", "--to", tmp_path / "material")
    material, made = tmp_path / "material", tmp_path / "made"
    ended = handtrack(
        "new", "--out", made, "--calibration", material / "calibration.toml", "--side", "right",
        "--video", f"cam0={material / 'left.mp4'}", "--video", f"cam1={material / 'right.mp4'}",
    )  # fmt: skip
    assert ended.code == 0, ended.err
    some = () if "HANDTRACK_TUTORIAL" in os.environ else ("--frames", f"0:{FRAMES}")
    assert handtrack("track", made, "--init", "auto", "--yes", *some).code == 0
    bench = Workbench(made, port=0)
    with browsing(bench) as view:
        shows_all_frames(view, bench, made)
