"""The one finite-difference check: for Jacobians, terms and whole problems."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from handtrack.arrays import Floats
from handtrack.geometry.rotation import rotation_matrix
from handtrack.model.kinematics import BonePoses
from handtrack.solver.problem import Problem
from handtrack.terms.term import GrowingTerm, ObservationTerm, ParameterTerm

TWIST = ("vx", "vy", "vz", "wx", "wy", "wz")
GROWN = (*TWIST, "growth")


def check_jacobian(
    function: Callable[[Floats], Floats],
    jacobian: Floats,
    x: Floats,
    names_rows: Sequence[str] | None = None,
    names_columns: Sequence[str] | None = None,
    step: float = 1e-6,
    rtol: float = 1e-6,
    atol: float = 0.0,
) -> None:
    """Compare a Jacobian (R, C) at x (C,) with central differences of `function`: (C,) → (R,).

    An entry may be off by atol + rtol · the largest entry. The failure names rows and columns, worst first.
    """
    x = np.asarray(x, dtype=float)
    analytic = np.atleast_2d(np.asarray(jacobian, dtype=float))
    numeric = np.empty_like(analytic)
    for c in range(len(x)):
        move = np.zeros(len(x))
        move[c] = step
        ahead, behind = np.ravel(function(x + move)), np.ravel(function(x - move))
        assert len(ahead) == len(analytic), f"{len(ahead)} values, {len(analytic)} Jacobian rows"
        numeric[:, c] = (ahead - behind) / (2 * step)
    _compare(analytic, numeric, names_rows, names_columns, rtol, atol)


def check_gradient(
    cost: Callable[[Floats], float],
    gradient: Floats,
    x: Floats,
    names: Sequence[str] | None = None,
    step: float = 1e-6,
    rtol: float = 1e-6,
    atol: float = 0.0,
) -> None:
    """Compare a gradient (C,) at x (C,) with central differences of `cost`."""
    check_jacobian(lambda y: np.array([cost(y)]), gradient, x, ("cost",), names, step, rtol, atol)


def check_observation_term(
    term: ObservationTerm,
    bones: BonePoses,
    bone_names: Sequence[str] | None = None,
    step: float = 1e-6,
    rtol: float = 1e-5,
    atol: float = 0.0,
    grows: bool = True,
) -> None:
    """Twist each bone about bones.reference and compare the change of cost with the term's gradient.

    A term that can tell sizes grows each bone as well, unless `grows` is false. Also: `linearize` and `cost` tell the same cost; the Hessian is
    symmetric, has no negative direction, and is the same with growth and without.
    """
    count = len(bones.position)
    labels = bone_names or [f"bone {b}" for b in range(count)]
    system = term.linearize(bones)
    assert system.gradient.shape == (6 * count,), system.gradient.shape
    _check_cost(system.cost, term.cost(bones), term.name)
    _check_hessian(system.hessian, 6 * count)
    names = TWIST
    if grows and isinstance(term, GrowingTerm):
        plain, names = system, GROWN
        system = term.linearize_growth(bones)
        _check_cost(system.cost, plain.cost, term.name)
        _check_hessian(system.hessian, 7 * count)
        kept = np.arange(7 * count) % 7 < 6
        scale = 1e-9 * max(float(np.abs(plain.hessian).max(initial=0.0)), 1e-300)
        np.testing.assert_allclose(system.hessian[np.ix_(kept, kept)], plain.hessian, atol=scale)
    width = len(names)
    check_gradient(
        lambda twists: term.cost(twisted(bones, twists.reshape(count, width))),
        system.gradient,
        np.zeros(width * count),
        [f"{label} {axis}" for label in labels for axis in names],
        step,
        rtol,
        atol,
    )


def check_parameter_term(
    term: ParameterTerm,
    joint_params: Floats,
    names: Sequence[str] | None = None,
    step: float = 1e-6,
    rtol: float = 1e-6,
    atol: float = 0.0,
) -> None:
    """Compare a term's gradient (S,) with the change of its cost."""
    system = term.linearize(joint_params)
    _check_cost(system.cost, term.cost(joint_params), term.name)
    _check_hessian(system.hessian, len(joint_params))
    check_gradient(term.cost, system.gradient, joint_params, names, step, rtol, atol)


def check_problem(
    problem: Problem, params: Floats, step: float = 1e-6, rtol: float = 1e-5, atol: float = 0.0
) -> None:
    """Compare the whole problem's gradient (P,) with the change of its cost."""
    system = problem.linearize(params)
    _check_cost(system.cost, problem.cost(params), "problem")
    _check_hessian(system.hessian, len(params))
    names = problem.model.transform.names
    check_gradient(problem.cost, system.gradient, params, names, step, rtol, atol)


def twisted(bones: BonePoses, twists: Floats) -> BonePoses:
    """Return the bones each moved by its own twist (B, 6) = (v, ω), world axes, about bones.reference; (B, 7): grown too."""
    turn = np.stack([rotation_matrix(w) for w in twists[:, 3:6]])
    more = np.exp(twists[:, 6]) if twists.shape[1] == 7 else None
    arm = bones.position - bones.reference
    arm = arm if more is None else arm * more[:, None]
    position = bones.reference + np.einsum("bij,bj->bi", turn, arm) + twists[:, :3]
    growth = bones.growth
    if more is not None:
        growth = more[:, None] * (np.ones((len(more), 3)) if growth is None else growth)
    return replace(bones, rotation=turn @ bones.rotation, position=position, growth=growth)


def _check_cost(linearized: float, plain: float, name: str) -> None:
    np.testing.assert_allclose(
        linearized, plain, rtol=1e-10, err_msg=f"{name}: linearize and cost differ in the cost"
    )


def _check_hessian(hessian: Floats, size: int) -> None:
    assert hessian.shape == (size, size), hessian.shape
    largest = max(float(np.abs(hessian).max()), 1e-300)
    np.testing.assert_allclose(hessian, hessian.T, atol=1e-10 * largest, err_msg="not symmetric")
    least = float(np.linalg.eigvalsh(hessian)[0])
    assert least > -1e-8 * largest, (
        f"the Hessian has a negative direction: {least:g} of {largest:g}"
    )


def _compare(
    analytic: Floats,
    numeric: Floats,
    rows: Sequence[str] | None,
    columns: Sequence[str] | None,
    rtol: float,
    atol: float,
) -> None:
    rows = rows or [f"row {r}" for r in range(analytic.shape[0])]
    columns = columns or [f"column {c}" for c in range(analytic.shape[1])]
    allowed = atol + rtol * float(np.abs(numeric).max(initial=0.0))
    off = np.abs(analytic - numeric)
    off[~np.isfinite(off)] = np.inf
    wrong = np.argwhere(~(off <= allowed))
    if not len(wrong):
        return
    wrong = wrong[np.argsort(-off[wrong[:, 0], wrong[:, 1]])]
    lines = [
        f"  {rows[r]} by {columns[c]}: derivative {analytic[r, c]:.9g}, differences {numeric[r, c]:.9g}"
        for r, c in wrong[:12]
    ]
    more = f"\n  and {len(wrong) - 12} more" if len(wrong) > 12 else ""
    raise AssertionError(
        f"{len(wrong)} of {analytic.size} derivatives are off by more than {allowed:.3g}:\n"
        + "\n".join(lines)
        + more
    )
