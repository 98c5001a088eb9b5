"""A window onto a camera's image: every pixel where OpenCV has it, at any enlargement and in any window; turning and enlarging."""

import cv2
import numpy as np
import pytest

from handtrack.geometry.rotation import rotation_matrix
from handtrack_app.page.scene.looking import plane_of
from handtrack_app.page.scene.zoom import (
    MOST,
    Zoom,
    around,
    box_of,
    eye,
    pixel_ray,
    ray_pixel,
    towards,
    whole,
    with_pixel_at,
)
from handtrack_app.protocol.snapshots import CameraCard

WINDOWS = [(1280, 700), (620, 800), (944, 640), (300, 900)]
MATRIX = np.array([[610.0, 0, 300.5], [0, 645.0, 260.25], [0, 0, 1.0]])  # off-centre, fx ≠ fy
CARD = CameraCard(
    "cam0", (640, 480), MATRIX, rotation_matrix(np.array([0.4, -1.3, 0.8])), np.array([0.3, -1.2, 2.0])
)  # fmt: skip


def by_opencv(points):
    world_to_camera = CARD.rotation.T
    turn, _ = cv2.Rodrigues(world_to_camera)
    pixels, _ = cv2.projectPoints(points, turn, -world_to_camera @ CARD.centre, MATRIX, np.zeros(5))
    return pixels[:, 0]


def in_window(zoom, window, point):
    """Return where a point of the world is drawn [px of the window], by the page's own kind of camera."""
    looks = eye(CARD, zoom, window[0] / window[1])
    focal = window[1] / 2 / np.tan(looks.fov / 2)
    x, y, z = looks.rotation.T @ (point - CARD.centre)
    return np.array([focal * x / z + window[0] / 2, focal * y / z + window[1] / 2])


def on_picture(pixel, depth):
    """Return where a pixel of the picture stands in the world, as the plane with the picture is placed."""
    width, height, middle = plane_of(CARD, depth)
    share = (pixel + 0.5) / CARD.size - 0.5
    return middle + CARD.rotation @ np.array([share[0] * width, share[1] * height, 0.0])


@pytest.mark.parametrize("window", WINDOWS)
@pytest.mark.parametrize("times", [1.0, 3.0, 12.0])
def test_model_and_picture_meet_at_the_pixel_that_opencv_has(window, times, rng):
    seen = rng.uniform((0, 0), CARD.size, (50, 2))
    depths = rng.uniform(0.3, 0.9, 50)
    hand = np.array([
        CARD.centre + depth * CARD.rotation @ np.linalg.solve(MATRIX, [*pixel, 1.0])
        for pixel, depth in zip(seen, depths, strict=True)
    ])  # fmt: skip
    zoom = Zoom((rng.uniform(0, 639), rng.uniform(0, 479)), times)
    for point, pixel in zip(hand, by_opencv(hand), strict=True):
        drawn = in_window(zoom, window, point)
        picture = in_window(zoom, window, on_picture(pixel, 0.75))
        a_pixel = np.linalg.norm(
            in_window(zoom, window, on_picture(pixel + (1, 0), 0.75)) - picture
        )
        assert np.linalg.norm(drawn - picture) < 0.01 * a_pixel  # 0.5 is promised


def test_rays_and_pixels_are_each_others_inverse(rng):
    for pixel in rng.uniform((0, 0), CARD.size, (20, 2)):
        ray = pixel_ray(CARD, (pixel[0], pixel[1]))
        np.testing.assert_allclose(ray_pixel(CARD, 3.7 * ray), pixel, atol=1e-9)
        np.testing.assert_allclose(by_opencv((CARD.centre + 0.6 * ray)[None])[0], pixel, atol=1e-6)
        assert ray_pixel(CARD, -ray) is None
    looks = eye(CARD, Zoom((100.0, 400.0), 5.0), 1.3)
    for place in rng.uniform(0, 1, (20, 2)):
        np.testing.assert_allclose(looks.place(looks.ray((place[0], place[1]))), place, atol=1e-9)
    assert looks.place(-looks.ray((0.5, 0.5))) is None


@pytest.mark.parametrize("window", WINDOWS)
def test_enlarging_leaves_what_is_pointed_at_where_it_is(window):
    aspect, zoom = window[0] / window[1], Zoom((320.0, 240.0), 2.0)
    place = (0.7, 0.35)
    pointed = ray_pixel(CARD, eye(CARD, zoom, aspect).ray(place))
    assert pointed is not None
    closer = towards(CARD, zoom, aspect, place, 2.5)
    assert closer.times == 5.0
    np.testing.assert_allclose(
        eye(CARD, closer, aspect).place(pixel_ray(CARD, pointed)), place, atol=1e-4
    )
    assert towards(CARD, zoom, aspect, place, 100.0).times == MOST
    assert towards(CARD, zoom, aspect, place, 0.01) == whole(CARD)


def test_a_dragged_pixel_stays_under_the_pointer_as_far_as_the_image_reaches():
    zoom = with_pixel_at(CARD, Zoom((320.0, 240.0), 4.0), 1.3, (200.0, 300.0), (0.8, 0.1))
    seen = eye(CARD, zoom, 1.3).place(pixel_ray(CARD, (200.0, 300.0)))
    np.testing.assert_allclose(seen, (0.8, 0.1), atol=1e-4)
    far = with_pixel_at(CARD, Zoom((320.0, 240.0), 4.0), 1.3, (0.0, 0.0), (1.0, 1.0))
    assert far.aim == (0.0, 0.0)


@pytest.mark.parametrize("window", WINDOWS)
def test_a_hand_is_shown_whole_and_large(window):
    ahead = np.array([[0.02, 0.05, 0.5], [0.08, 0.10, 0.55], [-0.01, 0.12, 0.5]])
    points, radii = CARD.centre + ahead @ CARD.rotation.T, np.array([0.01, 0.01, 0.02])
    box = box_of(CARD, points, radii)
    assert box is not None
    zoom = around(CARD, box, window[0] / window[1])
    x, y, wide, high = box
    drawn = np.array([
        in_window(zoom, window, on_picture(np.array([x + a * wide, y + b * high]), 0.75)) / window
        for a in (0, 1) for b in (0, 1)
    ])  # fmt: skip
    assert (drawn > 0.1).all() and (drawn < 0.9).all()
    assert np.ptp(drawn, axis=0).max() > 0.6
    assert box_of(CARD, CARD.centre - ahead @ CARD.rotation.T, radii) is None
