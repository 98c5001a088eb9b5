"""What is in front at each pixel, beside the exact picture of ellipsoids."""

import numpy as np

from handtrack.model.surfaces.part_mesh import ellipsoid_mesh
from handtrack.simulation.render import render
from handtrack.terms.images.depth_picture import depth_picture
from tests.terms.silhouette_scene import bones_of, camera_of, ellipsoids_of


def test_it_agrees_with_exact_rays(rng):
    bones, flesh = bones_of(rng), ellipsoids_of(rng, 10)
    camera = camera_of(rng, (200, 160), focal=330.0)
    picture = depth_picture(ellipsoid_mesh(flesh, 3), bones, camera)
    face, depth = picture.in_image()
    front, exact, _ = render(camera, flesh.posed(bones))
    both = (face >= 0) & (front >= 0)
    assert both.sum() > 1000
    assert ((face >= 0) != (front >= 0)).sum() < 0.01 * both.sum()  # along the outline
    assert np.percentile(np.abs(depth - exact)[both], 95) < 2e-4
    same = face[both] // 1280 == front[both]  # 20 · 4³ faces an ellipsoid
    assert same.mean() > 0.97


def test_a_window_holds_the_model_and_nothing_is_around_it(rng):
    bones, flesh = bones_of(rng), ellipsoids_of(rng, 10)
    camera = camera_of(rng, (200, 160), focal=330.0)
    picture = depth_picture(ellipsoid_mesh(flesh), bones, camera)
    face, depth = picture.in_image()
    v, u = np.mgrid[:160, :200]
    every = np.stack([u.ravel(), v.ravel()], axis=1).astype(float)
    faces, depths = picture.at(every)
    np.testing.assert_array_equal(faces, face.ravel())
    np.testing.assert_array_equal(depths, depth.ravel())
    outside = picture.at(np.array([[-5.0, 3.0], [3.0, 1e9], [np.nan, 2.0]]))
    assert (outside[0] == -1).all()
    assert np.isinf(outside[1]).all()
