"""Table 1 on arms of three links: the trees are of the paper's size, and all of their leaves are minima of their own."""

import pytest

from handtrack.sampling.diffusion import covariance_scaled, projected, spherical
from handtrack.sampling.interpretation_tree import TreeSettings, interpretation_tree
from handtrack.simulation.scenes.jump_scene import (
    KJS1,
    KJS2,
    LIMBS,
    body,
    jump_scene,
    limb_chains,
)
from tests.experiments.jumps.failing_leaves import fitted_leaves
from tests.experiments.jumps.minima import sampled
from tests.experiments.jumps.three_links import headline, scene_without_limits


@pytest.fixture(scope="module")
def scene():
    return scene_without_limits()


def test_two_depths_a_link_give_the_papers_1024(scene):
    assert [len(scene.tree([limb])) for limb in LIMBS] == [8, 8, 4, 4]
    assert (len(scene.tree(KJS1)), len(scene.tree(KJS2))) == (256, 128)
    assert len(scene.tree(LIMBS)) == 1024


def test_every_eighth_leaf_is_a_minimum_that_no_other_is(scene):
    leaves = scene.tree(LIMBS).params[::8]
    row = sampled(scene, "KJS", "", lambda: leaves, len(leaves)).row
    assert (row.minima, row.converged) == (128, 1.0)


def test_jumps_find_more_than_covariance_scaled_samples_as_many(rng, scene):
    chosen = ("left_arm", "left_leg")
    jumps = sampled(scene, "KJS all", "", lambda: scene.tree(chosen).params, 32)
    assert jumps.row.minima == 32

    def drawn(sampler):
        return projected(scene.model, sampler(scene.start, scene.covariance, 4.0, 32, rng))

    told = headline(
        [
            jumps,
            *(
                sampled(scene, name, "4", lambda sampler=sampler: drawn(sampler), 32)
                for name, sampler in (("CSS", covariance_scaled), ("SS", spherical))
            ),
        ]
    )
    assert told["jumps"] > told["css_most"] > told["ss_most"]


def test_leaves_that_cannot_meet_their_joints_come_nearer_when_fitted():
    """Where limits are in the way: to the depths chosen, all joints at once, and within limits still."""
    scene = jump_scene(0, flat=0.0, steep=1.0, model=body("body38"))
    chain = limb_chains(scene.model)["left_arm"]
    failing = TreeSettings(failing="nearest")
    plain = interpretation_tree(
        scene.model, scene.start, [chain], scene.camera, scene.targets, failing
    )
    fitted = fitted_leaves(scene, chain)
    assert (fitted[plain.exact] == plain.params[plain.exact]).all()
    assert not plain.exact.all()
    assert abs(fitted[~plain.exact] - plain.params[~plain.exact]).max() > 0.01
    for leaf in fitted:
        assert leaf == pytest.approx(scene.model.clipped(leaf), abs=1e-9)
