"""Painted residuals show what the terms sum up."""

from __future__ import annotations

import pytest

from handtrack.diagnostics import residual_image as ri
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
