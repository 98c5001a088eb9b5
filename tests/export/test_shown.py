"""What is looked at: a page that plays, a report, a film over the images. Opened by other programs, without network."""

import resource
from itertools import pairwise

import numpy as np
import pytest

from handtrack import Session, TrackingRun, bundled_session, load_model
from handtrack.export.registry import export_format
from handtrack.export.table import ResultsTable
from tests.experiments.workbench.chromium import chromium, there_is_one
from tests.export.foreign import library
from tests.export.sequences import sample_sequence
from tests.sample_track import labels_of, posed_frame


def test_a_film_has_a_picture_a_frame_by_another_programs_count(tmp_path):
    """Counted by PyAV, that is FFmpeg; each picture differs from the one before and is as the session's cameras see it. Where the
    disk ends, the film before stays."""
    av = library("av")
    folder = bundled_session("open_fist_open")
    track = _moved_a_little(folder, 4)
    table = ResultsTable(track, session_folder=folder)
    (path,) = export_format("mp4").write(tmp_path / "poses.mp4", table)
    with av.open(str(path)) as film:
        pictures = [frame.to_ndarray(format="rgb24") for frame in film.decode(video=0)]
        rate = float(film.streams.video[0].average_rate)
    assert len(pictures) == len(track)
    assert rate == pytest.approx(table.fps, rel=1e-3)
    assert pictures[0].shape[0] == 480
    assert all(np.abs(a.astype(int) - b).max() > 20 for a, b in pairwise(pictures))
    kind = resource.RLIMIT_FSIZE
    before = resource.getrlimit(kind)
    resource.setrlimit(kind, (4096, before[1]))
    try:
        with pytest.raises(OSError, match="space"):
            export_format("mp4").write(path, table)
    finally:
        resource.setrlimit(kind, before)
    assert path.stat().st_size > 4096


def _moved_a_little(folder, count):
    """Return the first pose of a session, a centimetre farther in each frame."""
    run = TrackingRun.open(Session.open(folder))
    model, (_, params) = run.model, run.initial()
    frames = []
    for frame in range(count):
        values = model.joint_params(params)
        values[0] += 0.01 * frame
        frames.append(posed_frame(model, frame, values, run.session.fps))
    return run.result(frames)


def test_a_ball_of_one_bone_has_a_mesh(tmp_path):
    ball = load_model("ball6")
    track = labels_of(ball).track([posed_frame(ball, 0, ball.rest)])
    assert export_format("glb").write(tmp_path / "ball.glb", ResultsTable(track))


@pytest.mark.browser
@pytest.mark.skipif(not there_is_one(), reason="no Chromium here")
def test_pages_play_without_network_and_without_an_error(tmp_path):
    pytest.importorskip("playwright.sync_api")
    with chromium((640, 360), "--disable-gpu-compositing") as (page, errors):
        for kind in ("left", "claw"):
            _plays(page, tmp_path, ResultsTable(sample_sequence(kind)[1]))
    assert errors == []


def _plays(page, folder, table):
    (path,) = export_format("html").write(folder / "poses.html", table)
    page.goto(path.as_uri())
    before, say = page.locator("#view").screenshot(), page.locator("#say")
    assert "frame 3, 0.060 s, tracked" in say.inner_text()
    for _ in range(5):
        page.keyboard.press("ArrowRight")
    page.wait_for_function("document.getElementById('say').textContent.includes('frame 8')")
    assert "lost: " in say.inner_text()
    assert page.locator("#view").screenshot() != before
    page.locator("#play").click()
    page.wait_for_function("document.getElementById('say').textContent.includes('frame 26')")
    (path,) = export_format("report").write(folder / "report.html", table)
    page.goto(path.as_uri())
    assert page.locator("svg").count() >= 5
