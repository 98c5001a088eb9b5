"""What is looked at: a page that plays, a report, a film over the images. Opened by other programs, without network."""

from __future__ import annotations

import os
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from handtrack.errors import HandtrackError
from handtrack.export.registry import FORMATS, export_format
from handtrack.export.shown.links import joint_links
from handtrack.export.shown.report import report_page
from handtrack.export.table import ResultsTable
from handtrack.session.bundled import bundled_session
from handtrack.session.run import TrackingRun
from handtrack.session.session import Session
from handtrack.tracking.frame.result import FrameResult, Status, TrackResult
from tests.export.foreign import library
from tests.export.sequences import KINDS, sample_model, sample_sequence

CHROMIUM = os.environ.get("CHROMIUM", "/usr/bin/chromium")
FLAGS = ["--no-sandbox", "--disable-background-networking", "--disable-component-update"]


def test_every_format_says_what_it_is_for_and_ends_as_promised():
    """Contracts §7."""
    endings = {"csv": ".csv", "csv-long": ".csv", "anipose": ".csv", "npz": ".npz", "keypoints": ".npz", "openpose": ".json",
               "mediapipe": ".json", "netcdf": ".nc", "report": ".html", "bvh-humanik": ".bvh"}  # fmt: skip
    for known in FORMATS:
        assert known.suffix == endings.get(known.name, f".{known.name}")
        assert known.purpose.endswith(".")
    assert len({known.ending for known in FORMATS}) == len(FORMATS)


def test_a_format_whose_package_is_absent_says_what_to_install(tmp_path):
    known = replace(export_format("nwb"), needs=("pynwb", "no-such-package"))
    with pytest.raises(HandtrackError, match=r"--to nwb: needs .*no-such-package, which is not installed. Install with `pip install"):  # fmt: skip
        known.write(tmp_path / "x.nwb", ResultsTable(sample_sequence("right")[1]))


@pytest.mark.parametrize("kind", KINDS)
def test_a_stick_figure_connects_all_joints(kind: str):
    model = sample_model(kind)
    links = joint_links(model)
    assert [joint for _, joint in links] == list(range(1, len(model.joint_names)))
    assert all(model.joint_bone[above] <= model.joint_bone[joint] for above, joint in links)
    named = {(model.joint_names[a], model.joint_names[b]) for a, b in links}
    if kind == "body":
        assert {("pelvis", "chest"), ("chest", "neck"), ("neck", "left_shoulder")} <= named
    if model.has_keypoints21:
        assert {("wrist", "index_mcp"), ("index_dip", "index_tip")} <= named


def test_a_report_names_states_and_reasons():
    _, track = sample_sequence("right")
    page = report_page(ResultsTable(replace(track, session="<b>bold</b>")))
    assert "<b>" not in page
    assert "doubtful" in page and "lost" in page
    assert str(track.reason[5]) in page
    assert "more than 25 mm off" in page
    assert "nan" not in page


def test_a_film_has_a_picture_a_frame_by_another_programs_count(tmp_path):
    """Counted by PyAV, that is FFmpeg; each picture differs from the one before and is as the session's cameras see it."""
    av = library("av")
    folder = bundled_session("open_fist_open")
    track = _moved_a_little(folder, 6)
    table = ResultsTable(track, session_folder=folder)
    (path,) = export_format("mp4").write(tmp_path / "poses.mp4", table)
    with av.open(str(path)) as film:
        pictures = [frame.to_ndarray(format="rgb24") for frame in film.decode(video=0)]
        rate = float(film.streams.video[0].average_rate)
    assert len(pictures) == len(track)
    assert rate == pytest.approx(table.fps, rel=1e-3)
    assert pictures[0].shape[0] == 480
    assert all(np.abs(a.astype(int) - b).max() > 20 for a, b in pairwise(pictures))


def test_a_film_needs_a_session(tmp_path):
    _, track = sample_sequence("right")
    with pytest.raises(HandtrackError, match="lies in no session"):
        export_format("mp4").write(tmp_path / "poses.mp4", ResultsTable(track))


def _moved_a_little(folder: Path, count: int) -> TrackResult:
    """Return the first pose of a session, a centimetre farther in each frame."""
    run = TrackingRun.open(Session.open(folder))
    model, (_, params) = run.model, run.initial()
    frames = []
    for frame in range(count):
        values = model.joint_params(params)
        values[0] += 0.01 * frame
        bones = model.bones(model.transform.solver_params(values))
        joints = model.joint_positions(bones)
        frames.append(
            FrameResult(
                frame=frame, time_s=frame / run.session.fps, parameters=values, status=Status.TRACKED, energy=1.0, iterations=1,
                parameter_std=np.full(len(values), 0.01), joint_covariance=np.tile(1e-6 * np.eye(3), (len(joints), 1, 1)),
                T_world_bone=bones.T_world_bone, joint_positions=joints, keypoints21=model.keypoints21(bones),
            )
        )  # fmt: skip
    return run.result(frames)


@pytest.mark.browser
@pytest.mark.skipif(not Path(CHROMIUM).exists(), reason="no Chromium here")
def test_pages_play_without_network_and_without_an_error(tmp_path):
    sync_api = pytest.importorskip("playwright.sync_api")
    said: list[str] = []
    with sync_api.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=CHROMIUM, headless=True, args=FLAGS)
        context = browser.new_context(offline=True)
        context.set_default_timeout(60_000)
        for kind in ("left", "body", "claw"):
            table = ResultsTable(sample_sequence(kind)[1])
            page = context.new_page()
            page.on("console", lambda message: said.append(message.text))
            page.on("pageerror", lambda error: said.append(str(error)))
            page.on(
                "request",
                lambda request: (
                    said.append(request.url) if request.url.startswith("http") else None
                ),
            )
            (path,) = export_format("html").write(tmp_path / f"{kind}.html", table)
            page.goto(path.as_uri())
            before = page.locator("#view").screenshot()
            assert "frame 3, 0.060 s, tracked" in page.locator("#say").inner_text()
            for _ in range(5):
                page.keyboard.press("ArrowRight")
            page.wait_for_function("document.getElementById('say').textContent.includes('frame 8')")
            assert "lost: " in page.locator("#say").inner_text()
            assert page.locator("#view").screenshot() != before
            page.locator("#play").click()
            page.wait_for_function(
                "document.getElementById('say').textContent.includes('frame 26')"
            )
            (path,) = export_format("report").write(tmp_path / f"{kind}_report.html", table)
            page.goto(path.as_uri())
            assert page.locator("svg").count() >= 5
            page.close()
        browser.close()
    assert said == []
