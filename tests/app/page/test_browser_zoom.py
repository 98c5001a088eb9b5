"""Model and picture in a real browser: where a ball of the scene is drawn, and where the picture has that pixel, from screenshots."""

import cv2
import numpy as np
import pytest

from handtrack_app.page.scene.looking import Through
from handtrack_app.page.scene.zoom import Zoom, pixel_ray
from handtrack_app.workbench import Workbench
from tests.app import fake_run
from tests.app.desk import in_threads
from tests.app.fake_run import fake_document
from tests.app.page.test_browser import PageUnderTest, browsing
from tests.app.waiting import eventually

WINDOWS = [(1280, 800), (900, 1000)]
SQUARE = 6  # [px] of the image, 96 × 72
CANVAS = """() => {
  const r = window.__viserMutable.canvas.getBoundingClientRect();
  return [r.left, r.top, r.width, r.height];
}"""


def checkerboard() -> np.ndarray:
    rows, columns = np.mgrid[:72, :96] // SQUARE
    return np.repeat((40 + 170 * ((rows + columns) % 2)).astype(np.uint8)[..., None], 3, axis=2)


def picture(view: PageUnderTest) -> np.ndarray:
    """Return the page once it stands still (H, W, 3) BGR."""
    before = b""
    for _ in range(40):
        now = view.page.screenshot()
        if now == before:
            break
        before = now
        view.page.wait_for_timeout(400)
    image = cv2.imdecode(np.frombuffer(before, np.uint8), cv2.IMREAD_COLOR)
    assert image is not None
    return image


@pytest.mark.browser
def test_picture_and_model_are_drawn_as_one_at_any_enlargement_in_any_window(tmp_path, monkeypatch):
    monkeypatch.setattr(
        fake_run.FakeView, "image", lambda self, frame: checkerboard() if self.name == "front" else None
    )  # fmt: skip
    bench = in_threads(tmp_path, opener=fake_document)
    with browsing(bench, dpr=1.0) as view:
        (client,) = bench.server.get_clients().values()
        bench.stage.looking.set_paint(client.client_id, "plain")
        view.page.keyboard.press("1")
        looks = eventually(lambda: bench.stage.looking.views.of(client.client_id), "it looks")
        eventually(
            lambda: (
                "/screen"
                in str(
                    view.page.evaluate("() => Object.keys(window.__viserMutable.nodeRefFromName)")
                )
            ),
            "its picture",
        )
        bench.stage._marking = True  # nothing stands before the picture
        bench.redraw()
        worst = 0.0
        for window, times in zip(WINDOWS, (1.0, 12.0), strict=True):
            view.page.set_viewport_size({"width": window[0], "height": window[1]})
            # a corner of four squares, its ball at the hand's distance, a screen behind it
            pixel = np.array([7 * SQUARE - 0.5, 5 * SQUARE - 0.5])
            zoom = Zoom((pixel[0] + 3 / times, pixel[1] - 2 / times), times)
            bench.stage.looking.views._change(client, lambda _, zoom=zoom: zoom)
            worst = max(worst, apart(bench, view, looks, pixel))
        print(f"at most {worst:.3f} px of the image apart")
        assert worst < 0.5


def apart(bench: Workbench, view: PageUnderTest, looks: Through, pixel: np.ndarray) -> float:
    """Return how far a ball on a corner of the picture is drawn from that corner [px of the image]."""
    card, zoom = looks.card, looks.zoom
    where = card.centre + 0.36 * pixel_ray(card, (pixel[0], pixel[1]))
    plain = picture(view)
    radius = 0.36 / card.matrix[0, 0] * 0.9 / zoom.times
    ball = bench.server.scene.add_icosphere(
        "/ball", radius, color=(255, 0, 255), position=where, cast_shadow=False
    )
    with_ball = picture(view)
    ball.remove()
    changed = (cv2.absdiff(plain, with_ball).max(axis=2) > 8).astype(np.uint8)
    _, _, boxes, centres = cv2.connectedComponentsWithStats(changed)
    assert len(boxes) > 1, "the ball is drawn"
    centre = centres[1 + int(np.argmax(boxes[1:, cv2.CC_STAT_AREA]))]
    _, _, width, height = view.page.evaluate(CANVAS)
    scale = height / 2 / looks.eye.half / card.matrix[1, 1]  # px of the page by px of the image
    shrunk = min(
        1.0, 16 / scale
    )  # so large are squares seen at most: farther apart, no corner is found
    grey = cv2.cvtColor(plain, cv2.COLOR_BGR2GRAY)
    grey = np.asarray(cv2.resize(grey, None, fx=shrunk, fy=shrunk, interpolation=cv2.INTER_AREA))
    ball_at = (centre + 0.5) * shrunk - 0.5
    reach = int(SQUARE * scale * shrunk * 0.25)  # clear of the panels
    start = np.array([[ball_at + 2.0]], np.float32)
    until = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 100, 1e-3)
    corner = cv2.cornerSubPix(grey, start.copy(), (reach, reach), (-1, -1), until)[0, 0]
    assert np.linalg.norm(corner - start[0, 0]) > 0.1, "a corner of squares was found"
    off = float(np.linalg.norm(corner - ball_at)) / (scale * shrunk)
    print(f"canvas {width:.0f}×{height:.0f}, {zoom.times:g}×: {off:.3f} px apart")
    return off
