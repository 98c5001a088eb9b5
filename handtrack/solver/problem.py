"""Problem: a model and the terms of one frame, as a function of solver parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from handtrack.arrays import D2, Floats, P, S
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.kinematics import BonePoses
from handtrack.model.transform import MovingLimits
from handtrack.terms.bone_kernels import to_solver
from handtrack.terms.term import COST_ALONE, JointSystem, ObservationTerm, ParameterTerm, Sums


@dataclass(frozen=True)
class Problem:
    """cost(params), linearize(params) and limits of solver parameters (P,)."""

    model: ArticulatedModel
    observation_terms: Sequence[ObservationTerm]
    parameter_terms: Sequence[ParameterTerm] = ()
    unlimited: bool = False
    """whether joints may bend anywhere"""

    def cost(self, params: Floats[P]) -> float:
        """Return the sum of all terms' costs."""
        bones, joint = self.model.bones(params), self.model.joint_params(params)
        return self._summed(bones, joint, COST_ALONE, COST_ALONE)

    def costs(self, params: Floats[P]) -> dict[str, float]:
        """Return the cost of each kind of term, by its name; terms of one name are summed."""
        bones, joint = self.model.bones(params), self.model.joint_params(params)
        costs: dict[str, float] = {}
        for term in self.observation_terms:
            costs[term.name] = costs.get(term.name, 0.0) + float(term.cost(bones))
        for prior in self.parameter_terms:
            costs[prior.name] = costs.get(prior.name, 0.0) + float(prior.cost(joint))
        return costs

    def linearize(self, params: Floats[P]) -> JointSystem:
        """Return cost, gradient and Gauss-Newton Hessian (P, P).

        Observations are summed by the twists of bones, priors by joint parameters; both come together last.
        """
        bones, jacobian, joint = self.model.linearize(params)
        seen, known = Sums.zero(len(bones.position), 6), Sums.zero(len(joint))
        cost = self._summed(bones, joint, seen, known)
        links = self.model.transform.links
        return JointSystem(cost, *to_solver(seen, jacobian, known, links, len(params)))

    def _summed(self, bones: BonePoses, joint: Floats[S], seen: Sums, known: Sums) -> float:
        cost = 0.0
        for term in self.observation_terms:
            cost += term.add_to(bones, seen)
        for prior in self.parameter_terms:
            cost += prior.add_to(joint, known)
        return cost

    @property
    def limits(self) -> MovingLimits:
        if self.unlimited:
            return MovingLimits.fixed(self.bounds(self.model.rest_params()))
        return self.model.moving_limits

    def bounds(self, params: Floats[P]) -> Floats[P, D2]:
        """Return the limits that hold at params."""
        if self.unlimited:
            return np.tile([-np.inf, np.inf], (len(params), 1))
        return self.model.bounds(params)
