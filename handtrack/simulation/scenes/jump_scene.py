"""Scene of the 2003 paper's Table 1: a person seen from the front by one camera, joints only."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from handtrack.arrays import D2, Floats, J, N, P, array_dataclass, indices
from handtrack.geometry.camera import Camera
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.model_file import load_model
from handtrack.observation.observation import ImageKeypoints
from handtrack.sampling.chains import Chain, chains_of
from handtrack.sampling.interpretation_tree import interpretation_tree
from handtrack.sampling.polish import Polished, polish
from handtrack.solver.covariance import covariance
from handtrack.terms.collision import CollisionTerm
from handtrack.terms.term import ParameterTerm
from handtrack.tracking.frame.terms.priors import points_rest, pose_priors

LIMBS = ("left_arm", "right_arm", "left_leg", "right_leg")
KJS1 = ("left_arm", "right_arm", "left_leg")
"""both shoulders and the left calf"""
KJS2 = ("left_leg", "right_leg", "right_arm")
"""both calves and the right shoulder"""
_MEANT = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
OBSERVED = (
    "neck",
    "head",
    "head_top",
    *(f"{side}_{j}" for side in ("left", "right") for j in _MEANT),
)
"""centres of joints; toes, and hands without wrists, are ends of bones that cannot flip by themselves"""
NOISE_PX = 1.0
STEEP, FLAT = 0.9, 0.5
FULL_SEED = 277
"""the first seed whose scene has full trees"""


@array_dataclass
class JumpScene:
    """One pose, its image joints, and the minimum that descent reaches from the truth."""

    model: ArticulatedModel
    observed: ImageKeypoints
    start: Floats[P]
    """the minimum next to the true pose"""
    covariance: Floats[P, P]
    """there"""

    def polished(self, starts: Floats[N, P]) -> Polished:
        """Return the minima that descent reaches from starts."""
        return polish(self.model, starts, [self.observed], body_priors(self.model))

    @property
    def targets(self) -> Floats[J, D2]:
        """Where the model's joints are seen [px]; NaN where they are not."""
        targets = np.full((len(self.model.joint_names), 2), np.nan)
        targets[indices(self.model.joint_names, self.observed.names)] = self.observed.pixels
        return targets

    def tree(self, limbs: Sequence[str]) -> Floats[N, P]:
        """Return all flips of limbs at the start that put the seen joints where they are seen."""
        chains = [limb_chains(self.model)[name] for name in limbs]
        return interpretation_tree(
            self.model, self.start, chains, self.observed.camera, self.targets
        )


def body_priors(model: ArticulatedModel) -> list[ParameterTerm]:
    """Return what is known of a pose beforehand."""
    return pose_priors(model, points_rest(model), 0.0)


@lru_cache(maxsize=4)
def limb_chains(model: ArticulatedModel) -> dict[str, Chain]:
    """Return a body's chains by name."""
    return {chain.name: chain for chain in chains_of(model)}


def observed_joints(model: ArticulatedModel) -> tuple[str, ...]:
    """Return the joints that are seen of a body: those of all, and the ends of its limbs where they flip."""
    ends = (chain.joints[-1] for chain in limb_chains(model).values())
    return OBSERVED + tuple(end for end in ends if end not in OBSERVED)


def front_camera() -> Camera:
    """Return a camera 4 m before the body, at the height of its belly: 1.75 m of person are 480 pixels."""
    turn = np.diag([1.0, -1.0, -1.0])  # looks along −z of the world, where the body comes from
    matrix = np.array([[1100.0, 0, 640], [0, 1100, 480], [0, 0, 1]])
    return Camera("front", (1280, 960), matrix, np.zeros(5), turn, -turn @ [0.0, 0.2, 4.0])


def frontal_pose(model: ArticulatedModel, rng: np.random.Generator) -> Floats[P]:
    """Return parameters of a body that faces the camera and holds its limbs anyhow within limits.

    Each link of arms and legs is 30° to 64° off the plane across its viewing ray (sine between `FLAT` and `STEEP`): a
    link in that plane has no flip, one along the viewing ray no direction. Trunk, head and shoulders are near rest. No part passes
    through another.
    """
    through = CollisionTerm.of(model)
    while True:
        params = model.rest_params()
        params[3:6] = rng.normal(scale=0.1, size=3)
        for name, width in _NEAR_REST.items():
            params[model.transform.names.index(name)] += rng.normal(scale=width)
        for limb in LIMBS:
            _hold(model, limb_chains(model)[limb], params, rng)
        params = model.clipped(params)
        if through.cost(model.bones(params)) == 0.0:
            return params


_NEAR_REST = {
    f"{part}_{way}": 0.1 for part in ("spine", "neck") for way in ("flex", "lean", "twist")
} | {
    f"{side}_clavicle_{way}": 0.05 for side in ("left", "right") for way in ("elevate", "protract")
}
"""standard deviations [rad]"""


def _hold(
    model: ArticulatedModel,
    chain: Chain,
    params: Floats,
    rng: np.random.Generator,
) -> None:
    """Draw a limb's angles into params, evenly within the middle 80 % of their limits, until its links are steep enough."""
    own = indices(model.transform.names, chain.parameters)
    joints = indices(model.joint_names, chain.joints)
    low, high = model.bounds(params)[own].T
    centre = front_camera().centre
    while True:
        params[own] = low + (high - low) * rng.uniform(0.1, 0.9, size=len(own))
        points = model.joint_positions(model.bones(params))[joints]
        link, ray = np.diff(points, axis=0), points[:-1] - centre
        along = np.abs((link * ray).sum(axis=1))
        leaves = along / (np.linalg.norm(link, axis=1) * np.linalg.norm(ray, axis=1))
        if leaves.min() > FLAT and leaves.max() < STEEP:
            return


def jump_scene(seed: int) -> JumpScene:
    """Return a scene with a random frontal pose of body34; the joints are seen with noise (standard deviation, each axis)."""
    rng = np.random.default_rng(seed)
    model, camera = load_model("body34"), front_camera()
    truth = frontal_pose(model, rng)
    names = observed_joints(model)
    chosen = indices(model.joint_names, names)
    points = model.joint_positions(model.bones(truth))[chosen]
    pixels = camera.project(points) + NOISE_PX * rng.normal(size=(len(names), 2))
    seen = ImageKeypoints(camera, names, pixels, 1.0)
    found = polish(model, truth[None], [seen], body_priors(model))
    assert found.is_minimum[0], "descent from the truth ended in no minimum"
    return JumpScene(model, seen, found.params[0], covariance(found.normal[0])[0])


def full_scene() -> JumpScene:
    """Return the first scene in which both arms have four leaves and both legs two: what limits allow at most."""
    return jump_scene(FULL_SEED)
