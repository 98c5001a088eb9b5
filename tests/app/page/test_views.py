"""Views: a window onto a camera's image, in which every pixel is where OpenCV has it; the first views; all cameras side by side; looking
through a camera on the wire: the wheel, a walk out of it and the way back; and the solids that are drawn."""

import time
from dataclasses import replace

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose

from handtrack.geometry.rotation import looking_along, rotation_matrix
from handtrack_app.engine.camera_pictures import CLOSE_SIZE, close_up
from handtrack_app.engine.document_snapshots import session_snapshot
from handtrack_app.page.scene import looking, stage
from handtrack_app.page.scene import viewpoint as vp
from handtrack_app.page.scene.looking import CLOSE, plane_of
from handtrack_app.page.scene.viewpoint import (
    MOST,
    Zoom,
    around,
    box_of,
    enlarged,
    eye,
    fov_of,
    ray_pixel,
    whole,
    with_pixel_at,
)
from tests.app.fake_run import fake_document
from tests.app.waiting import eventually
from tests.cameras import pinhole

WINDOWS = [(1280, 700), (620, 800), (944, 640), (300, 900)]
TURN = rotation_matrix(np.array([0.4, -1.3, 0.8]))
"""camera → world"""
CARD = pinhole(
    "cam0", (640, 480), (610.0, 645.0), TURN.T, -TURN.T @ (0.3, -1.2, 2.0), at=(300.5, 260.25)
)


def by_opencv(points):
    turn, _ = cv2.Rodrigues(CARD.rotation)
    pixels, _ = cv2.projectPoints(points, turn, CARD.translation, CARD.matrix, np.zeros(5))
    return pixels[:, 0]


def in_window(zoom, window, point):
    """Return where a point of the world is drawn [px of the window], by the page's own kind of camera."""
    looks = eye(CARD, zoom, window[0] / window[1])
    focal = window[1] / 2 / np.tan(fov_of(looks) / 2)
    x, y, z = looks.rotation @ (point - CARD.centre)
    return np.array([focal * x / z + window[0] / 2, focal * y / z + window[1] / 2])


def on_picture(pixel):
    """Return where a pixel of the picture stands in the world, as the plane with the picture is placed."""
    width, height, middle = plane_of(CARD, 0.75)
    share = (pixel + 0.5) / CARD.size - 0.5
    return middle + TURN @ np.array([share[0] * width, share[1] * height, 0.0])


@pytest.mark.parametrize("window", WINDOWS)
@pytest.mark.parametrize("times", [1.0, 3.0, 12.0])
def test_model_and_picture_meet_at_the_pixel_that_opencv_has(window, times, rng):
    seen = rng.uniform((0, 0), CARD.size, (50, 2))
    depths = rng.uniform(0.3, 0.9, 50)
    hand = CARD.centre + depths[:, None] * CARD.rays(seen)
    zoom = Zoom((rng.uniform(0, 639), rng.uniform(0, 479)), times)
    for point, pixel in zip(hand, by_opencv(hand), strict=True):
        drawn = in_window(zoom, window, point)
        picture = in_window(zoom, window, on_picture(pixel))
        a_pixel = np.linalg.norm(in_window(zoom, window, on_picture(pixel + (1, 0))) - picture)
        assert np.linalg.norm(drawn - picture) < 0.01 * a_pixel  # 0.5 is promised


def test_rays_and_pixels_are_each_others_inverse(rng):
    looks = eye(CARD, Zoom((100.0, 400.0), 5.0), 1.3)
    for place in rng.uniform(0, 1, (20, 2)):
        ray = looks.rays(place)
        assert_allclose(ray_pixel(looks, 3.7 * ray), place, atol=1e-9)
        assert ray_pixel(looks, -ray) is None


def test_an_enlargement_has_bounds():
    zoom = Zoom((320.0, 240.0), 2.0)
    assert enlarged(CARD, zoom, 2.5) == Zoom((320.0, 240.0), 5.0)
    assert enlarged(CARD, zoom, 100.0).times == MOST
    assert enlarged(CARD, zoom, 0.01) == whole(CARD)


def test_a_dragged_pixel_stays_under_the_pointer_as_far_as_the_image_reaches():
    zoom = with_pixel_at(CARD, Zoom((320.0, 240.0), 4.0), 1.3, (200.0, 300.0), (0.8, 0.1))
    seen = ray_pixel(eye(CARD, zoom, 1.3), CARD.rays(np.array([200.0, 300.0])))
    assert_allclose(seen, (0.8, 0.1), atol=1e-4)
    far = with_pixel_at(CARD, Zoom((320.0, 240.0), 4.0), 1.3, (0.0, 0.0), (1.0, 1.0))
    assert far.aim == (0.0, 0.0)


@pytest.mark.parametrize("window", WINDOWS)
def test_a_hand_is_shown_whole_and_large(window):
    ahead = np.array([[0.02, 0.05, 0.5], [0.08, 0.10, 0.55], [-0.01, 0.12, 0.5]])
    points, radii = CARD.centre + ahead @ TURN.T, np.array([0.01, 0.01, 0.02])
    box = box_of(CARD, points, radii)
    assert box is not None
    zoom = around(CARD, box, window[0] / window[1])
    x, y, wide, high = box
    drawn = np.array([
        in_window(zoom, window, on_picture(np.array([x + a * wide, y + b * high]))) / window
        for a in (0, 1) for b in (0, 1)
    ])  # fmt: skip
    assert (drawn > 0.1).all() and (drawn < 0.9).all()
    assert np.ptp(drawn, axis=0).max() > 0.6
    assert box_of(CARD, CARD.centre - ahead @ TURN.T, radii) is None


@pytest.fixture
def overlooked(tmp_path):
    return session_snapshot(fake_document(tmp_path))


def test_all_cameras_are_in_an_overview_where_they_look_down_too(overlooked):
    hand, down = np.array([0.0, 0.09, 0.0]), np.diag([1.0, -1.0, -1.0])
    cards = overlooked.cameras
    above = tuple(
        replace(card, rotation=down, translation=np.array([-0.2 * i, 0.0, 0.6]))
        for i, card in enumerate(cards)
    )
    for seen_by in (cards, above, above[:1]):
        seen_from = replace(overlooked, cameras=seen_by)
        assert np.isfinite(vp.first_view(seen_from, hand).position).all()
        view = vp.hand_view(seen_from, hand, everything=True)
        ahead = view.look_at - view.position
        turn = looking_along(ahead / np.linalg.norm(ahead), -view.up)
        for card in seen_by:
            seen = (vp.frustum_corners(card, hand)[1:] - view.position) @ turn.T
            assert (seen[:, 2] > 0).all()
            assert (np.abs(seen[:, :2] / seen[:, 2:]) <= np.tan(view.fov / 2)).all()


def test_a_page_sees_all_cameras_until_it_looks_elsewhere(bench, page):
    page.press("See the hand in all cameras")
    _, shown = eventually(lambda: page.client.close_ups)
    eventually(lambda: shown.content.count("<img") == 2 and "side" in shown.content)
    assert {one for one in bench.stage.wanted()["want_pictures"][2] if one[1] == CLOSE} == {
        ("front", CLOSE), ("side", CLOSE),
    }  # fmt: skip
    page.press("Camera view: side")
    eventually(lambda: page.view)
    assert page.view.card.name == "side"
    assert page.client.close_ups is None
    eventually(lambda: CLOSE not in str(bench.stage.wanted()["want_pictures"]))


def test_a_close_picture_shows_the_hand_whole_and_large_with_its_outline(bench):
    document = bench.worker.document
    model = document.model
    flesh = model.ellipsoids["fine"].posed(
        model.bones(model.transform.solver_params(document.start))
    )
    camera = document.session.rig["front"]
    picture = close_up(np.full((72, 96, 3), 90, np.uint8), camera, flesh)
    yellow = (picture[..., 0] > 200) & (picture[..., 2] < 90)
    rows, columns = np.nonzero(yellow)
    assert rows.min() > 20 and rows.max() < CLOSE_SIZE[1] - 20
    assert columns.min() > 20 and columns.max() < CLOSE_SIZE[0] - 20
    assert max(np.ptp(rows) / CLOSE_SIZE[1], np.ptp(columns) / CLOSE_SIZE[0]) > 0.5


def test_the_wheel_enlarges_and_nothing_is_counted_twice(bench, page):
    page.press("Camera view: front")
    page.obey()
    assert_allclose(page.centre, page.view.card.centre, atol=1e-9)
    assert 1.0 < page.times() <= 12.0
    page.press("View: the whole image")
    eventually(lambda: page.times() == 1.0)
    page.obey()
    centre, target, fov = page.centre, page.target, page.told("SetCameraFovMessage")
    for notch in range(1, 5):  # the browser goes on while the answers are under way
        page.tell(target + 0.95**notch * (centre - target), target)
    eventually(lambda: page.times() == pytest.approx(0.95**-12, rel=1e-3), "four notches, no more")
    eventually(
        lambda: (
            np.tan(page.told("SetCameraFovMessage") / 2)
            == pytest.approx(np.tan(fov / 2) * 0.95**12, rel=1e-3)
        )
    )
    assert not page.view.follows and not page.view.left


def test_an_answer_to_what_it_was_told_before_undoes_nothing(bench, monkeypatch, page):
    monkeypatch.setattr(looking, "_SETTLED_S", 1e6)  # however slow the machine
    page.press("Camera view: front")
    page.obey()
    old = page.centre, page.target
    page.press("View: the whole image")
    eventually(lambda: page.times() == 1.0)
    page.tell(*old)
    page.obey()
    time.sleep(0.3)
    assert page.times() == 1.0


def test_who_walks_out_is_told_and_one_key_leads_back(bench, monkeypatch, wire, page):
    monkeypatch.setattr(looking, "_SETTLED_S", 0.0)
    page.press("Camera view: front")
    page.obey()
    page.tell(page.centre + 0.05, page.target + 0.05)
    eventually(lambda: page.view.left)
    eventually(lambda: "You left front" in str(wire.messages))
    page.press("View: the hand, and back into the camera")
    eventually(lambda: not page.view.left)
    page.obey()
    assert page.view.follows


def test_a_camera_chosen_while_a_free_view_is_sought_stays(bench, monkeypatch, wire, page):
    sought = stage.hand_view

    def hand_view(*given):
        page.press("Camera view: front")
        eventually(lambda: page.view)
        return sought(*given)

    monkeypatch.setattr(stage, "hand_view", hand_view)
    bench.stage.look(None, page.client)
    page.client.handle.scene.add_frame("/after")
    eventually(lambda: "/after" in str(wire.messages))
    assert_allclose(page.told("SetCameraPositionMessage"), page.view.card.centre)


def test_a_window_of_another_shape_shows_the_hand_as_well(bench, page):
    page.press("Camera view: front")
    page.obey()
    page.obey(width=300)
    eventually(lambda: page.view.aspect == 0.5)
    assert page.view.follows
    eventually(lambda: page.told("SetCameraFovMessage") == pytest.approx(fov_of(page.view.eye)))
