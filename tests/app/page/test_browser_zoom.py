"""Model and picture in a real browser: where a ball of the scene is drawn, and where the picture has that pixel, from screenshots."""

import cv2
import numpy as np
import pytest

from handtrack_app.page.scene.zoom import Zoom, pixel_ray
from tests.app import fake_run
from tests.app.desk import in_threads
from tests.app.page.test_browser import browsing
from tests.app.waiting import eventually

SPOT = (41, 29)
"""the middle of a white square of 3 px in a dark image of 96 × 72"""
CANVAS = """() => {
  const r = window.__viserMutable.canvas.getBoundingClientRect();
  return [r.left, r.top, r.width, r.height];
}"""
NODES = "() => Object.keys(window.__viserMutable.nodeRefFromName)"


def with_spot(view, frame):
    image = np.full((72, 96, 3), 40, np.uint8)
    image[SPOT[1] - 1 : SPOT[1] + 2, SPOT[0] - 1 : SPOT[0] + 2] = 255
    return image if view.name == "front" else None


def screenshot(view):
    """Return the page once it stands still (H, W, 3) BGR."""
    before = b""
    for _ in range(40):
        now = view.page.screenshot()
        if now == before:
            break
        before = now
        view.page.wait_for_timeout(400)
    return cv2.imdecode(np.frombuffer(before, np.uint8), cv2.IMREAD_COLOR)


@pytest.mark.browser
def test_picture_and_model_are_drawn_as_one_at_any_enlargement_in_any_window(tmp_path, monkeypatch):
    monkeypatch.setattr(fake_run.FakeView, "image", with_spot)
    bench = in_threads(tmp_path, opener=fake_run.fake_document)
    with browsing(bench, dpr=1.0) as view:
        (client,) = bench.server.get_clients().values()
        looking = bench.stage.looking
        looking.set_paint(client.client_id, "plain")
        view.page.keyboard.press("1")
        looks = eventually(lambda: looking.views.of(client.client_id), "it looks")
        eventually(lambda: "/screen" in str(view.page.evaluate(NODES)), "its picture")
        bench.stage._marking = True  # nothing stands before the picture
        bench.redraw()
        for (width, height), times in (((1280, 800), 1.0), ((900, 1000), 12.0)):
            view.page.set_viewport_size({"width": width, "height": height})
            zoom = Zoom((SPOT[0] + 3 / times, SPOT[1] - 2 / times), times)
            looking.views._change(client, lambda _, zoom=zoom: zoom)
            plain = screenshot(view)
            radius = 0.36 / looks.card.matrix[0, 0] * 0.9 / times
            place = looks.card.centre + 0.36 * pixel_ray(looks.card, SPOT)
            ball = bench.server.scene.add_icosphere(
                "/ball", radius, color=(255, 0, 255), position=place, cast_shadow=False
            )
            drawn = cv2.absdiff(plain, screenshot(view)).max(axis=2) > 8
            ball.remove()
            scale = view.page.evaluate(CANVAS)[3] / 2 / looks.eye.half / looks.card.matrix[1, 1]
            ball_at = middle(drawn)
            spot = plain.min(axis=2) > 150
            rows, columns = np.indices(spot.shape)
            near = np.hypot(columns - ball_at[0], rows - ball_at[1]) < 6 * scale  # px of the image
            off = np.linalg.norm(ball_at - middle(spot & near)) / scale
            print(f"{width}×{height}, {times:g}×: {off:.3f} px of the image apart")
            assert off < 0.5


def middle(seen):
    """Return where the largest patch has its middle [px]."""
    _, _, boxes, centres = cv2.connectedComponentsWithStats(seen.astype(np.uint8))
    assert len(boxes) > 1, "it is drawn"
    return centres[1 + int(np.argmax(boxes[1:, cv2.CC_STAT_AREA]))]
