"""Painted residuals show what the terms sum up."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from handtrack.diagnostics import residual_image as ri
from handtrack.geometry.camera import Camera
from handtrack.observation.observation import UNKNOWN, ImageKeypoints, Silhouette
from handtrack.simulation.render import render_mask
from handtrack.terms.silhouettes.conic_field import ConicFieldTerm
from handtrack.terms.silhouettes.coverage import CoverageTerm
from tests.terms.silhouette_scene import bones_of, ellipsoids_of, silhouettes_of


@pytest.fixture
def scene(rng):
    return bones_of(rng), ellipsoids_of(rng), silhouettes_of(rng, full=True)


@pytest.mark.parametrize("kind", ["field", "depth", "wide", "last"])
def test_the_terms_cost_is_half_the_sum_of_squared_residuals(scene, kind):
    bones, flesh, seen = scene
    if kind in ("field", "depth"):
        term = ConicFieldTerm(seen, flesh, normalised=kind == "field")
    else:
        term = CoverageTerm(seen, flesh, 3.0, bones, antisymmetric=kind == "last")
    cost = 0.0
    for i, silhouette in enumerate(seen):
        residual = ri.residual_image(ri.predicted_image(term, i, bones), silhouette.mask)
        cost += 0.5 * (residual**2).sum()
    assert term.cost(bones) == pytest.approx(cost, rel=1e-9)


def test_the_models_mask_is_what_rays_hit(scene):
    bones, flesh, seen = scene
    for silhouette in seen:
        ours = ri.model_mask(silhouette.camera, flesh.posed(bones))
        cut = render_mask(silhouette.camera, flesh.posed(bones)) > 0
        assert (ours != cut).sum() <= 1  # a pixel exactly on an outline
        assert ours.any()


def test_pictures_have_the_images_shape_and_leave_it_alone(scene):
    bones, flesh, seen = scene
    camera, mask, posed = seen[0].camera, seen[0].mask, flesh.posed(bones)
    image = np.full((72, 96, 3), 100, np.uint8)
    hard = ri.model_mask(camera, posed)
    painted = ri.residual_picture(image, camera, posed, mask)
    agree = (mask == hard) if mask.dtype == bool else np.isclose(mask, hard)
    assert (painted[agree] == 100).all()
    only_model = hard & (mask == 0)
    assert only_model.any()
    assert (painted[only_model][:, 2] > painted[only_model][:, 0]).all()  # bluish
    outline = ri.outline_picture(image, camera, posed)
    field = ri.field_picture(camera, posed)
    for picture in (painted, outline, field):
        assert picture.shape == image.shape
        assert picture.dtype == np.uint8
    assert (outline != 100).any()
    assert (field[~hard] == 24).all()
    assert (image == 100).all()


def test_outlines_follow_the_mask(scene):
    bones, flesh, seen = scene
    camera, posed = seen[0].camera, flesh.posed(bones)
    hard = ri.model_mask(camera, posed)
    for line in ri.outline_polygons(camera, posed):
        u, v = np.rint(line).astype(int).T
        assert line.shape[1] == 2
        near = [
            hard[np.clip(v + dv, 0, 71), np.clip(u + du, 0, 95)]
            for dv in (-1, 0, 1)
            for du in (-1, 0, 1)
        ]
        assert np.any(near, axis=0).all()


def test_a_mask_is_shown_with_what_nobody_knows(scene):
    seen = scene[2][0]
    mask = seen.mask.copy()
    mask[:, :9] = UNKNOWN
    image = np.full((72, 96, 3), 100, np.uint8)
    painted = ri.mask_picture(image, Silhouette(seen.camera, mask, seen.valid))
    assert (painted[mask == 0] < 40).all() or (painted[mask == 0] == ri.MASK_ONLY).all(
        axis=-1
    ).any()
    assert (painted[:, :9] == np.rint((100 + np.array(ri.UNKNOWN_TINT)) / 2)).all()
    inside = cv2.erode((mask > 0.5).astype(np.uint8), np.ones((5, 5))) > 0
    assert inside.any() and (painted[inside] == 100).all()


def test_a_joint_that_was_seen_elsewhere_is_painted_with_the_way_to_the_models():
    camera = Camera(
        "cam", (60, 40), np.diag([50.0, 50.0, 1.0]), np.zeros(5), np.eye(3), np.zeros(3)
    )
    seen = ImageKeypoints(
        camera, ("left_wrist", "nose", "left_ear"), np.array([[10.0, 20.0], [np.nan, 0.0], [5.0, 5.0]]), 3.0,
    )  # fmt: skip
    places = np.array([[0.4, 0.2, 1.0], [0.8, 0.4, 1.0]])
    pairs = ri.joint_pairs(seen, ("nose", "left_wrist"), places)
    assert pairs.tolist() == [
        [[10.0, 20.0], [40.0, 20.0]]
    ]  # the nose was not seen, ears the model has none
    painted = ri.joints_picture(np.zeros((40, 60, 3), np.uint8), pairs)
    for place, colour in (((20, 10), ri.MASK_ONLY), ((20, 30), ri.MODEL_ONLY)):
        np.testing.assert_allclose(painted[place], colour, atol=25)  # smoothed edges
    assert not painted[30].any()
