"""Flesh goes with its bones: points of an ellipsoid are points of the bone that it sits on."""

from __future__ import annotations

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


def test_a_moving_bone_has_a_body_as_long_as_itself_and_a_joint():
    """2007 paper, section 3.3: about two ellipsoids a bone; the body's middle one reaches from end to end."""
    model = load_model()
    flesh, skeleton = model.flesh["fine"], model.skeleton
    for bone in set(skeleton.hinge_bone.tolist()):
        own = flesh.bone == bone
        assert own.sum() >= 2, skeleton.bone_names[bone]
        low = (flesh.centre - flesh.radii)[own, 1].min()
        high = (flesh.centre + flesh.radii)[own, 1].max()
        length = skeleton.length[bone]
        assert low < 0.1 * length and high > 0.9 * length, skeleton.bone_names[bone]
