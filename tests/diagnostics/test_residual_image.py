"""Painted residuals show what the terms sum up."""

import cv2
import numpy as np
import pytest

from handtrack.diagnostics import residual_image as ri
from handtrack.observation.observation import UNKNOWN, Silhouette
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


def test_a_piece_beside_the_model_is_outlined(scene):
    bones, flesh, seen = scene
    camera, posed = seen[0].camera, flesh.posed(bones)
    image, mask = np.full((72, 96, 3), 100, np.uint8), ri.model_mask(camera, posed).astype(float)
    assert not (ri.residual_picture(image, camera, posed, mask) == ri.OUTLINE).all(axis=-1).any()
    mask[50:70, 70:94] = 1.0
    drawn = (ri.residual_picture(image, camera, posed, mask) == ri.OUTLINE).all(axis=-1)
    assert drawn[69, 75:90].all(), "the piece's lower edge"


def test_a_mask_is_shown_with_what_nobody_knows(scene):
    seen = scene[2][0]
    mask = seen.mask.copy()
    mask[:, :9] = UNKNOWN
    image = np.full((72, 96, 3), 100, np.uint8)
    painted = ri.mask_picture(image, Silhouette(seen.camera, mask, seen.valid))
    background = cv2.dilate((mask > 0.5).astype(np.uint8), np.ones((5, 5))) == 0
    assert (painted[background & (mask == 0)] == 100).all()
    hatched = (painted[:, :9] != 100).any(axis=-1)
    assert 0.4 < hatched.mean() < 0.6, "every other stripe"
    inside = cv2.erode((mask > 0.5).astype(np.uint8), np.ones((5, 5))) > 0
    away = np.linalg.norm(painted[inside].astype(float) - ri.HAND_TINT, axis=-1)
    assert (
        inside.any()
        and (0 < away).all()
        and (away < np.linalg.norm(100.0 - np.array(ri.HAND_TINT))).all()
    )
