"""Problem: a model and the terms of one frame, as a function of solver parameters, all or some of them free."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from handtrack.arrays import D2, Array, Floats, P
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.moving_limits import MovingLimits
from handtrack.solver.assembly import assemble
from handtrack.solver.compiled_problem import CompiledProblem
from handtrack.terms.bone_system import JointSystem
from handtrack.terms.term import ObservationTerm, ParameterTerm


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
        if self.compiled is not None:
            return self.compiled.cost(params)
        bones = self.model.bones(params)
        seen = sum(term.cost(bones) for term in self.observation_terms)
        joint = self.model.joint_params(params)
        return float(seen + sum(term.cost(joint) for term in self.parameter_terms))

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
        """Return cost, gradient and Gauss-Newton Hessian (P, P)."""
        if self.compiled is not None:
            return self.compiled.linearize(params)
        return assemble(self.model, params, self.observation_terms, self.parameter_terms)

    @cached_property
    def compiled(self) -> CompiledProblem | None:
        """The same for compiled descent; None where a term has no tables."""
        compiled = CompiledProblem.of(self.model, self.observation_terms, self.parameter_terms)
        return compiled and replace(compiled, limits=self.limits)

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


@dataclass(frozen=True, eq=False)
class FreeProblem:
    """A problem in which only some solver parameters move; the others stay at `params` (P,)."""

    problem: Problem
    free: Array[P]
    """bool"""
    params: Floats[P]

    def cost(self, params: Floats[P]) -> float:
        return self.problem.cost(params)

    def linearize(self, params: Floats[P]) -> JointSystem:
        return self.problem.linearize(params)

    @property
    def compiled(self) -> CompiledProblem | None:
        """The same for compiled descent; None where a term has no tables."""
        compiled = self.problem.compiled
        return compiled and replace(compiled, limits=self.limits)

    @property
    def limits(self) -> MovingLimits:
        """Those of the problem where free, without room elsewhere."""
        return self.problem.limits.frozen(~self.free, self.params)
