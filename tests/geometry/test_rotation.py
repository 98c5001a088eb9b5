"""Rotations between their forms, to the bit as scipy converts them: scipy itself takes long to import."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from handtrack.geometry.rotation import (
    matrix_from_quaternion,
    quaternion_wxyz,
    rotation_matrix,
    rotation_vector,
)


@pytest.mark.parametrize("off", [0.0, 1e-13, 1e-9, 1e-3])
@pytest.mark.parametrize("angle", [0.0, 1e-6, 1e-3, 2.0, np.pi - 1e-9])
def test_matrices_give_the_vectors_and_quaternions_of_scipy(rng, angle, off):
    axes = rng.normal(size=(300, 3))
    turns = rotation_matrix(angle * axes / np.linalg.norm(axes, axis=1, keepdims=True))
    turns = turns + off * rng.normal(size=turns.shape)
    known = Rotation.from_matrix(turns)
    np.testing.assert_array_equal(rotation_vector(turns), known.as_rotvec())
    np.testing.assert_array_equal(quaternion_wxyz(turns), known.as_quat(scalar_first=True))
    assert rotation_vector(turns[0]).shape == (3,)
    assert quaternion_wxyz(turns.reshape(30, 10, 3, 3)).shape == (30, 10, 4)


def test_quaternions_of_any_length_give_the_matrices_of_scipy(rng):
    wxyz = rng.normal(size=(300, 4))
    known = Rotation.from_quat(wxyz, scalar_first=True).as_matrix()
    np.testing.assert_array_equal(matrix_from_quaternion(wxyz), known)
