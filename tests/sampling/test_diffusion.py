"""Samplers: the spread they promise, cores of equal volume, limits, seeds."""

import numpy as np
import pytest

from handtrack.model.model_file import load_model
from handtrack.sampling.diffusion import core_radius, covariance_scaled, projected, spherical


@pytest.fixture
def spread(rng):
    """A covariance with standard deviations from 0.01 to 1 along skew axes."""
    axes, _ = np.linalg.qr(rng.normal(size=(5, 5)))
    return axes @ np.diag(np.array([0.01, 0.03, 0.1, 0.3, 1.0]) ** 2) @ axes.T


@pytest.mark.parametrize("scale", [1.0, 4.0])
def test_gaussian_samples_have_the_covariance(rng, spread, scale):
    mean = rng.normal(size=5)
    drawn = covariance_scaled(mean, spread, scale, 40_000, rng)
    np.testing.assert_allclose(drawn.mean(axis=0), mean, atol=0.03 * scale)
    # in units of the wanted one, so that the narrow directions count as much as the wide
    root = np.linalg.inv(np.linalg.cholesky(spread))
    np.testing.assert_allclose(
        root @ np.cov(drawn.T) @ root.T, scale**2 * np.eye(5), atol=0.05 * scale**2
    )


def test_spherical_samples_are_round_and_of_the_same_volume(rng, spread):
    drawn = spherical(np.zeros(5), spread, 2.0, 40_000, rng)
    covariance = np.cov(drawn.T)
    radius = core_radius(spread)
    np.testing.assert_allclose(covariance, 4.0 * radius**2 * np.eye(5), atol=0.1 * radius**2)
    np.testing.assert_allclose(radius**5, np.sqrt(np.linalg.det(spread)))
    elliptic = np.cov(covariance_scaled(np.zeros(5), spread, 2.0, 40_000, rng).T)
    np.testing.assert_allclose(np.linalg.det(covariance), np.linalg.det(elliptic), rtol=0.1)


def test_heavy_tails(rng, spread):
    """Along each principal axis a Cauchy distribution: half within one spread, one in sixteen beyond ten."""
    values, vectors = np.linalg.eigh(spread)
    for sampler, width in (
        (covariance_scaled, np.sqrt(values)),
        (spherical, np.full(5, core_radius(spread))),
    ):
        drawn = sampler(np.zeros(5), spread, 3.0, 40_000, rng, "cauchy")
        along = np.abs(drawn @ (vectors if sampler is covariance_scaled else np.eye(5))) / (
            3.0 * width
        )
        np.testing.assert_allclose((along < 1.0).mean(axis=0), 0.5, atol=0.015)
        np.testing.assert_allclose(
            (along > 10.0).mean(axis=0), 1 - 2 / np.pi * np.arctan(10), atol=0.005
        )


@pytest.mark.parametrize("coupling", ["26", "18"])
def test_projection_onto_limits_that_narrow(rng, coupling):
    model = load_model("hand26", coupling=coupling)
    size = len(model.rest_params())
    drawn = model.rest_params() + 2.0 * rng.normal(size=(200, size))
    inside = projected(model, drawn)
    for row in inside:
        bounds = model.bounds(row)
        assert (row >= bounds[:, 0] - 1e-12).all() and (row <= bounds[:, 1] + 1e-12).all()
        np.testing.assert_array_equal(model.clipped(row), row)
    assert (inside != drawn).any(axis=1).all()
    free = model.bounds(model.rest_params())[:, 1] == np.inf
    np.testing.assert_array_equal(inside[:, free], drawn[:, free])
    np.testing.assert_array_equal(projected(model, inside), inside)
    assert projected(model, drawn[:0]).shape == (0, size)
