"""Flesh goes with its bones: points of an ellipsoid are points of the bone that it sits on."""

import numpy as np

from handtrack.model.model_file import load_model


def test_the_surface_of_each_ellipsoid_is_carried_by_its_bone(rng):
    model = load_model()
    bones = model.bones(model.clipped(model.rest_params() + 0.3 * rng.normal(size=26)))
    towards = rng.normal(size=(20, 3))
    towards /= np.linalg.norm(towards, axis=1)[:, None]
    for flesh in model.flesh.values():
        posed = flesh.posed(bones)
        for e, bone in enumerate(flesh.bone):
            on_it = flesh.centre[e] + (towards * flesh.radii[e]) @ flesh.rotation[e].T
            expected = bones.to_world(int(bone), on_it)
            found = posed.centre[e] + (towards * posed.radii[e]) @ posed.rotation[e].T
            np.testing.assert_allclose(found, expected, atol=1e-14)
