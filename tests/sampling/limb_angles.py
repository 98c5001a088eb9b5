"""All angles that put one limb's joints at given positions: the trees' growth, link by link, without rays."""

import numpy as np

from handtrack import ArticulatedModel
from handtrack.arrays import Array, Floats, Ints, check_shape
from handtrack.model.limits import Limits
from handtrack.sampling.chains import Chain, PreparedChain, prepare
from handtrack.sampling.interpretation_tree import extended, rooted


def limb_angles(
    model: ArticulatedModel,
    params: Floats,
    chain: Chain | PreparedChain,
    positions: Floats,
    spare: Floats | None = None,
    tolerance: float = 1e-6,
) -> tuple[Floats, Ints]:
    """Return all joint parameters (M, S) that put a chain's joints at positions, and the row (M,) each is for.

    positions: (N, links, 3) world [m] of the joints after the first, which stays where solver parameters (P,) put it,
    with everything before the chain. A ball joint with a hinge after it has up to four solutions; those beyond a limit
    are dropped (2003 paper, §3.1). Where positions leave a turn open, a stretched limb's twist, it keeps its angle at
    `params`, or that of `spare` (N, S).
    """
    ready = prepare(model, chain) if isinstance(chain, Chain) else chain
    check_shape(positions, (None, len(ready.reach), 3), "joint positions")
    joint = model.joint_params(params)
    count = len(positions)
    given = np.tile(joint, (count, 1))
    branches = rooted(model, ready, [model.bones(params)] * count, given)
    wanted = (given if spare is None else spare)[:, ready.columns]
    for link in range(len(ready.reach)):
        row = branches.source
        targets = np.ascontiguousarray(positions[row, link][:, None, :])
        missed = np.zeros((len(row), 1), dtype=np.int8)
        branches = extended(
            ready, branches, link, targets, missed, np.ascontiguousarray(wanted[row]), tolerance=tolerance
        )  # fmt: skip
    found = given[branches.source]
    found[:, ready.columns] = branches.angles
    inside = within_limits(model.limits, found)
    return found[inside], branches.source[inside]


def within_limits(limits: Limits, joint_params: Floats, slack: float = 1e-9) -> Array:
    """Return (N,) whether joint parameters (N, S) are within limits, also those that narrow with another."""
    bounds = limits.bounds(joint_params)
    inside = (joint_params >= bounds[..., 0] - slack) & (joint_params <= bounds[..., 1] + slack)
    return np.asarray(inside.all(axis=1))
