"""The one finite-difference check: for Jacobians, terms and whole problems."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from handtrack.arrays import Floats
from handtrack.geometry.rotation import rotation_matrix
from handtrack.model.kinematics import BoneFields, BonePoses
from handtrack.terms.term import ObservationTerm, ParameterTerm

TWIST = ("vx", "vy", "vz", "wx", "wy", "wz")
DEFORMED = (*TWIST, "sx", "sy", "sz", "shift x", "shift y", "shift z")
KINKED = {"step": 1e-9, "rtol": 1e-3}
"""where pixels change hands between ellipsoids and enter bands: the cost has a kink there, so steps are short"""


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
    rows = names_rows or [f"row {r}" for r in range(len(analytic))]
    columns = names_columns or [f"column {c}" for c in range(len(x))]
    allowed = atol + rtol * float(np.abs(numeric).max(initial=0.0))
    off = np.abs(analytic - numeric)
    wrong = np.argwhere(~(off <= allowed))
    wrong = wrong[np.argsort(-off[wrong[:, 0], wrong[:, 1]])]
    lines = [
        f"  {rows[r]} by {columns[c]}: derivative {analytic[r, c]:.9g}, differences {numeric[r, c]:.9g}"
        for r, c in wrong[:12]
    ]
    assert not lines, (
        f"{len(wrong)} of {analytic.size} derivatives are off by more than {allowed:.3g}, the worst:\n"
        + "\n".join(lines)
    )


def check_gradient(
    cost: Callable[[Floats], float],
    gradient: Floats,
    x: Floats,
    names: Sequence[str] | None = None,
    step: float = 1e-6,
    rtol: float = 1e-6,
) -> None:
    """Compare a gradient (C,) at x (C,) with central differences of `cost`."""
    check_jacobian(lambda y: np.array([cost(y)]), gradient, x, ("cost",), names, step, rtol)


def check_observation_term(
    term: ObservationTerm,
    bones: BonePoses,
    bone_names: Sequence[str] | None = None,
    step: float = 1e-6,
    rtol: float = 1e-5,
) -> None:
    """Twist each bone about bones.reference and compare the change of cost with the term's gradient.

    Each bone is stretched along its axes and its flesh is shifted as well, from bones that are no longer the model's.
    Also: `linearize` and `cost` tell the same cost; the Hessian is symmetric, has no negative direction, and is the same by fields.
    """
    count = len(bones.position)
    labels = bone_names or [f"bone {b}" for b in range(count)]
    system = term.linearize(bones)
    assert system.gradient.shape == (6 * count,), system.gradient.shape
    _check_cost(system.cost, term.cost(bones), term.name)
    _check_hessian(system.hessian, 6 * count)

    def check(at: BonePoses, gradient: Floats, names: Sequence[str]) -> None:
        width = len(names)
        check_gradient(
            lambda by: term.cost(deformed(at, by.reshape(count, width))), gradient, np.zeros(width * count),
            [f"{label} {axis}" for label in labels for axis in names], step, rtol,
        )  # fmt: skip

    check(bones, system.gradient, TWIST)
    own = np.random.default_rng(7).uniform(-1.0, 1.0, (count, 12)) * np.repeat(
        [0, 0.05, 1e-3], [6, 3, 3]
    )
    larger = deformed(bones, own)
    plain, width = term.linearize(larger), len(DEFORMED)
    system = term.linearize(larger, deformations(larger))
    _check_cost(system.cost, plain.cost, term.name)
    _check_hessian(system.hessian, width * count)
    kept = np.arange(width * count) % width < 6
    scale = 1e-9 * max(float(np.abs(plain.hessian).max(initial=0.0)), 1e-300)
    np.testing.assert_allclose(system.hessian[np.ix_(kept, kept)], plain.hessian, atol=scale)
    check(larger, system.gradient, DEFORMED)


def check_parameter_term(term: ParameterTerm, joint_params: Floats, names: Sequence[str]) -> None:
    """Compare a term's gradient (S,) with the change of its cost."""
    system = term.linearize(joint_params)
    _check_cost(system.cost, term.cost(joint_params), term.name)
    _check_hessian(system.hessian, len(joint_params))
    check_gradient(term.cost, system.gradient, joint_params, names)


def deformed(bones: BonePoses, by: Floats) -> BonePoses:
    """Return the bones each moved by its own twist (B, 6) = (v, ω), world axes, about bones.reference; by (B, 12) they are stretched
    about it as well, along their own axes by the exponentials of three numbers, and their flesh is shifted [m].
    """
    turn = rotation_matrix(by[:, 3:6])
    arm, scale_change, shift = bones.position - bones.reference, bones.scale_change, bones.shift
    if by.shape[1] == 12:
        more = np.exp(by[:, 6:9])
        own = more * np.einsum("bji,bj->bi", bones.rotation, arm)
        arm = np.einsum("bij,bj->bi", bones.rotation, own)
        scale_change = more * (1.0 if scale_change is None else scale_change)
        shift = more * (0.0 if shift is None else shift) + by[:, 9:]
    position = bones.reference + np.einsum("bij,bj->bi", turn, arm) + by[:, :3]
    return replace(
        bones,
        rotation=turn @ bones.rotation,
        position=position,
        scale_change=scale_change,
        shift=shift,
    )


def deformations(bones: BonePoses) -> BoneFields:
    """Return what the numbers (12 B) of `deformed` do."""
    count = len(bones.position)
    twists = np.zeros((count, 6, count, 12))
    stretch, shift = (np.zeros((count, 12, count, 12)) for _ in range(2))
    for b, turn in enumerate(bones.rotation):
        twists[b, :, b, :6] = np.eye(6)
        for a, axis in enumerate(turn.T):
            stretch[b, 3:, b, 6 + a] = np.outer(axis, axis).ravel()
            shift[b, :3, b, 9 + a] = axis
    fields = BoneFields.of_twists(twists.reshape(count, 6, -1), 100)
    stretch, shift = stretch.reshape(fields.surface.shape), shift.reshape(fields.surface.shape)
    return replace(fields, joints=fields.joints + stretch, surface=fields.surface + stretch + shift)


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
