"""Images and outlines of random ellipsoids: for the tests of edges and texture."""

import cv2
import numpy as np

from handtrack import Camera
from handtrack.model.part_mesh import ellipsoid_mesh
from handtrack.terms.images import (
    Texture,
    depth_picture,
    edges_near,
    exposed_as,
    outline_points,
    smooth_image,
    still_visible,
    texture_points,
)
from tests.terms.silhouette_scene import bones_of, camera_of, ellipsoids_of, moved_along

STEP_M = 0.004


def texture_image(rng, camera: Camera):
    """Return an image (H, W, 3) uint8 of soft coloured spots, over the whole range of grey."""
    width, height = camera.size
    spots = cv2.GaussianBlur(rng.normal(size=(height, width, 3)), (0, 0), 3.0)
    return np.clip(128 + 60 * spots / spots.std(), 0, 255).astype(np.uint8)


def scene(rng, cameras=2, size=(200, 160), focal=330.0, parts=10):
    """Return bones, flesh, mesh, cameras with an image each."""
    bones, flesh = bones_of(rng), ellipsoids_of(rng, parts)
    views = [camera_of(rng, size, focal=focal, name=f"cam{i}") for i in range(cameras)]
    return bones, flesh, ellipsoid_mesh(flesh), [(view, texture_image(rng, view)) for view in views]


def edges_seen(bones, mesh, views, search_px=6.0):
    """Return the edges of the images near the outline as it is at `bones`, for each camera."""
    seen = []
    for camera, pixels in views:
        outline = outline_points(mesh, bones, depth_picture(mesh, bones, camera), STEP_M)
        image = smooth_image(pixels, 1.0, outline.pixel, search_px + 2)
        seen.append(edges_near(outline, image, search_px))
    return seen


def texture_seen(rng, bones, mesh, views):
    """Return the texture carried from poses a little off, with other colours than the images have."""
    before = moved_along(bones, rng.normal(scale=0.004, size=6 * len(bones.position)))
    seen = []
    for camera, pixels in views:
        bone, local, pixel = texture_points(mesh, before, depth_picture(mesh, before, camera), 3)
        image = smooth_image(pixels, 1.5, pixel, 10.0)
        color = 40.0 + 0.7 * image.look_up(pixel)
        texture = Texture(camera, bone, local, color)
        texture = still_visible(texture, bones, depth_picture(mesh, bones, camera), STEP_M)
        seen.append((exposed_as(texture, bones, image), image))
    return seen
