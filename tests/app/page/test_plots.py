"""Plots: anatomical names and pictures, speed and range of motion, the band, drawings as SVG and PNG, the tab."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from handtrack.model.model_file import load_model
from handtrack_app.page.time.angles import anatomical, angle_parts
from handtrack_app.page.time.drawing import Area, Drawing, Line, Words
from handtrack_app.page.time.plot import motion_of, plots, speed_of
from handtrack_app.page.time.window import Window
from handtrack_app.protocol.comparing import Curve, CurvesSnapshot
from handtrack_app.protocol.snapshots import Download
from handtrack_app.workbench import Workbench
from tests.app.fake_run import FRAMES
from tests.app.page.test_review_panel import _tracked
from tests.app.waiting import eventually
from tests.app.wire import WireClient


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("index_pip_flex", "Index finger, middle joint (PIP), flexion"),
        ("thumb_cmc_abd", "Thumb, saddle joint (CMC), abduction"),
        ("root_ty", "Place along y"),
        ("left_elbow_flex", "Left elbow, flexion"),
    ],
)
def test_parameters_have_anatomical_names(name: str, words: str) -> None:
    assert anatomical(name) == words


@pytest.mark.parametrize("model", ["hand26", "body34"])
def test_each_parameter_has_a_name_and_a_picture_of_its_own_place(model: str) -> None:
    names = load_model(model).parameter_names
    assert len({anatomical(name) for name in names}) == len(names)
    for name in names:
        points = [p for part in angle_parts(name, 10.0, 20.0, 50.0) if not isinstance(part, Words) for p in part.points]  # fmt: skip
        x, y = np.array(points).T
        assert x.min() > 0 and x.max() < 70 and y.min() > 10 and y.max() < 80, name


def test_range_of_motion_and_speed() -> None:
    values = np.array([0.0, 10.0, np.nan, 5.0, 5.0, 8.0])
    motion = motion_of(values, 10.0)
    assert motion is not None
    assert (motion.least, motion.most, motion.fastest, motion.typical) == (0.0, 10.0, 100.0, 30.0)
    np.testing.assert_allclose(speed_of(values, 10.0), [100, 100, np.nan, 0, 15, 30])
    assert motion_of(np.array([1.0, np.nan, 2.0]), 10.0) is None


def _snapshot(count: int = 300) -> CurvesSnapshot:
    values = np.linspace(0, 1, count)
    curve = Curve("index_mcp_flex", values, np.full(count, 0.05), values + 0.1, values - 0.1, (-1, 1))  # fmt: skip
    return CurvesSnapshot(0, 30.0, (curve,), 3)


def _lines(drawing: Drawing) -> list[Line]:
    return [part for part in drawing.parts if isinstance(part, Line) and len(part.points) > 50]


def test_a_plot_has_track_band_other_take_and_truth() -> None:
    drawing = plots(_snapshot(), Window(0, 299), False, 900.0, 190.0)
    assert len(_lines(drawing)) == 3
    (band,) = [p for p in drawing.parts if isinstance(p, Area) and len(p.points) > 100]
    track = _lines(drawing)[-1]
    at = len(track.points) // 2
    up, down = band.points[at][1] - track.points[at][1], band.points[-1 - at][1] - track.points[at][1]  # fmt: skip
    assert up == pytest.approx(-down) and up < 0, "as far above as below"
    words = [part.text for part in drawing.parts if isinstance(part, Words)]
    assert "Index finger, knuckle (MCP), flexion [°]" in words
    assert {"take 3", "truth", "± 2 σ", "0 to 57 °"} <= set(words)


def test_a_plot_shows_the_window_alone_and_does_not_grow_with_the_recording() -> None:
    window = plots(_snapshot(), Window(100, 199), False, 900.0, 190.0)
    assert "19 to 38 °" in [p.text for p in window.parts if isinstance(p, Words)]
    sizes = [len(plots(_snapshot(n), Window(0, n - 1), True, 282.0, 104.0).svg()) for n in (2_000, 18_000)]  # fmt: skip
    assert sizes[1] < 1.1 * sizes[0] < 40_000


def test_a_drawing_is_the_same_as_svg_and_png() -> None:
    drawing = Drawing(100, 60, [Area([(10, 10), (40, 10), (40, 40), (10, 40)], "#ff0000"), Line([(60, 30), (90, 30)], "#0000ff", 4), Words(50, 55, "<±>", 10)])  # fmt: skip
    assert "&lt;±&gt;" in drawing.svg() and "<polygon" in drawing.svg(ground="#ffffff")
    image = cv2.imdecode(np.frombuffer(drawing.png(), np.uint8), cv2.IMREAD_COLOR)
    assert image.shape == (120, 200, 3)
    assert image[50, 50].tolist() == [0, 0, 255] and image[60, 150].tolist() == [255, 0, 0]
    assert image[60, 110].tolist() == [255, 255, 255]


def test_the_tab_shows_the_angles_of_a_finger_and_saves_them(
    bench: Workbench, monkeypatch: pytest.MonkeyPatch
) -> None:
    panel = bench.layout.plots
    given: list[Download] = []
    monkeypatch.setattr(panel, "deliver", given.append)
    _tracked(bench)
    with WireClient(bench.url) as client:
        client.set_value(panel.group, "Index")
        eventually(lambda: "Index finger, end joint" in panel.picture.content, "drawn")
        assert panel.picture.content.count("abduction") == 1
        client.set_value(panel.speed, True)
        eventually(lambda: "°/s" in panel.picture.content, "speed")
        for kind, begin in (("SVG", b"<svg"), ("PNG", b"\x89PNG")):
            client.set_value(panel.save, kind)
            eventually(lambda: bool(given), "saved")
            saved = given.pop()
            assert saved.name == f"index_speed_0_{FRAMES - 1}.{kind.lower()}"
            assert saved.data.startswith(begin)
        before = panel.picture.content
        bench.layout.timeline.look_closer("In")
        eventually(lambda: panel.picture.content != before, "the window of the timeline")


def test_without_curves_there_is_nothing_to_save(bench: Workbench) -> None:
    bench.layout.plots.show(CurvesSnapshot(0, 25.0, ()))
    assert not bench.layout.plots.save.visible
