"""Masks of a hand that closes to a fist and opens, the 2007 paper's second experiment."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from handtrack import ArticulatedModel, Observation, load_model
from handtrack.arrays import D3, F, Floats, J, S
from handtrack.simulation.motion import motion
from handtrack.simulation.scenes.simulated_views import mask_views
from handtrack.simulation.simulate import simulated_rig

FRAMES = 100


@dataclass(frozen=True, eq=False)
class Scene:
    """The motion and what a rig sees of it."""

    model: ArticulatedModel
    joint_params: Floats[F, S]
    """the truth"""
    observations: tuple[Observation, ...]

    @property
    def joints(self) -> Floats[F, J, D3]:
        """Return the true joint positions [m]."""
        solver = (self.model.transform.solver_params(x) for x in self.joint_params)
        return np.stack([self.model.joint_positions(self.model.bones(x)) for x in solver])


def scene(
    cameras: int,
    frames: int = FRAMES,
    size: tuple[int, int] = (640, 480),
    seen: range | None = None,
) -> Scene:
    """Return the bundled session's motion in front of a simulated rig; `seen`: only these frames of it."""
    model, rig = load_model(), simulated_rig(cameras, size)
    joint = motion(model, "open_fist_open", frames, np.random.default_rng(0))
    joint = joint if seen is None else joint[seen.start : seen.stop]
    solver = [model.transform.solver_params(x) for x in joint]
    views = tuple(mask_views(model, x, rig.cameras, i) for i, x in enumerate(solver))
    return Scene(model, joint, views)
