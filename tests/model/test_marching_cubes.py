"""Marching cubes of fields whose surfaces are known, and of noise, where each ambiguous case occurs."""

import numpy as np
import pytest
import trimesh

from handtrack.model.surfaces.marching_cubes import marching_cubes

RADIUS = 0.7
SPACING = 2 / 59


def nodes() -> np.ndarray:
    axis = np.linspace(-1, 1, 60)
    return np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1)


def solid(field: np.ndarray) -> trimesh.Trimesh:
    vertices, faces = marching_cubes(field)
    return trimesh.Trimesh(vertices, faces, process=False)


def test_a_sphere_has_its_area_and_volume():
    found = solid(np.linalg.norm(nodes(), axis=-1) - RADIUS)
    assert found.volume * SPACING**3 == pytest.approx(4 / 3 * np.pi * RADIUS**3, rel=2e-3)
    assert found.area * SPACING**2 == pytest.approx(4 * np.pi * RADIUS**2, rel=1e-3)
    away = np.linalg.norm(found.vertices * SPACING - 1, axis=1)
    assert np.abs(away - RADIUS).max() < 2e-3


def test_noise_gives_closed_and_consistently_turned_surfaces():
    field = np.random.default_rng(0).normal(size=(20, 20, 20))
    field[[0, -1]] = field[:, [0, -1]] = field[:, :, [0, -1]] = 1.0
    found = solid(field)
    assert found.is_watertight
    assert found.is_winding_consistent
    assert found.volume > 0
    inside = np.argwhere(field < 0)
    assert found.volume == pytest.approx(len(inside), rel=0.3)
