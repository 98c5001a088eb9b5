"""A problem as tables for the compiled descent."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from handtrack.arrays import D2, Floats, Ints, M, N, P
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.kinematics_kernels import Moving
from handtrack.model.moving_limits import MovingLimits
from handtrack.solver.descent_kernels import evaluate, workspace
from handtrack.terms.bone_system import JointSystem
from handtrack.terms.term import ObservationTerm, ParameterTerm
from handtrack.terms.term_table import TermTable, entries


@dataclass(frozen=True, eq=False)
class CompiledProblem:
    """What a descent needs, without Python in between."""

    moving: Moving
    limits: MovingLimits
    observed: Ints[N, D2]
    """addresses of kernels and tables"""
    priors: Ints[M, D2]
    is_block: bool
    """no term couples two bones"""
    tables: Sequence[TermTable]
    """kept, for their addresses are used"""

    @classmethod
    def of(
        cls,
        model: ArticulatedModel,
        observation_terms: Sequence[ObservationTerm],
        parameter_terms: Sequence[ParameterTerm],
    ) -> CompiledProblem | None:
        """Return the tables of all terms; None where one has none, or the person's size is being fitted."""
        observed, priors = _tables(observation_terms), _tables(parameter_terms)
        if observed is None or priors is None or model.skeleton.growth is not None:
            return None
        is_block = not any(table.couples for table in observed)
        return cls(
            model.moving, model.moving_limits, entries(observed), entries(priors), is_block, (*observed, *priors)
        )  # fmt: skip

    def cost(self, params: Floats[P]) -> float:
        """Return the sum of all terms' costs."""
        work = workspace(self.moving, len(params))
        return evaluate(self.moving, self.observed, self.priors, self.is_block, params, work, 0)

    def linearize(self, params: Floats[P]) -> JointSystem:
        """Return cost, gradient (P,) and Gauss-Newton Hessian (P, P)."""
        work = workspace(self.moving, len(params))
        cost = evaluate(self.moving, self.observed, self.priors, self.is_block, params, work, 6)
        return JointSystem(cost, work.gradient, work.hessian)


def _tables(terms: Sequence[ObservationTerm] | Sequence[ParameterTerm]) -> list[TermTable] | None:
    found = []
    for term in terms:
        own: Callable[[], list[TermTable] | None] | None = getattr(term, "tables", None)
        tables = None if own is None else own()
        if tables is None:
            return None
        found += tables
    return found
