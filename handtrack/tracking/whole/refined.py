"""A tracked recording once all of it is known: each frame again, by those before and after it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from handtrack.arrays import Array, F, Floats, P
from handtrack.geometry.rotation import closest_equivalent
from handtrack.model.articulated import ArticulatedModel
from handtrack.solver.covariance import uncertainty
from handtrack.tracking.frame.control import Control
from handtrack.tracking.frame.frame_result import judged, posed_result
from handtrack.tracking.frame.result import FrameResult, Status
from handtrack.tracking.frame.settings import TrackerSettings
from handtrack.tracking.search.policy import POOR
from handtrack.tracking.search.poor_cloud import poor_agreement
from handtrack.tracking.whole.estimate import WholeEstimate, estimate_whole
from handtrack.tracking.whole.evidence import Evidence, Observe
from handtrack.tracking.whole.motion import TURN, by_change
from handtrack.tracking.whole.other_ways import with_other_ways
from handtrack.tracking.whole.ways import Ways

_BESIDE = 7
"""frames to either side by which a cloud's is judged: half a second in all"""
_STILL = 0.4
"""share of these from which depths are doubted, chosen on two damaged recordings (docs/derivations/whole_recording.md): made of
`webxr_exact_depth_768` with small holes, 0.25 and 0.4 give 8.8 and 7.0 mm; of `webxr_depth_640` without whole fingers, 6.2 and 6.6"""
_FEWEST = 3
"""frames that have a motion"""


def refined(
    model: ArticulatedModel,
    settings: TrackerSettings,
    observe: Observe,
    tracked: Sequence[FrameResult],
    control: Control = Control(),
) -> list[FrameResult]:
    """Return frames that follow one another, ascending, at the poses that are most probable together; as they are if the
    hand was found in too few of them, or when stopped.

    tracked: as they came, frame after frame. Where the hand was lost it goes on by its motion from both sides; what was seen
    there is looked at again from such a pose, and counts where the hand is found in it.
    """
    lost = frozenset(r.frame for r in tracked if r.status == Status.LOST)
    if len(tracked) - len(lost) < _FEWEST:
        return list(tracked)
    numbers = [result.frame for result in tracked]
    seconds = abs(tracked[-1].time_s - tracked[0].time_s) / (len(tracked) - 1)
    poses = np.array([model.transform.solver_params(r.parameters) for r in tracked])
    poses = _bridged(poses, np.array([number not in lost for number in numbers]))
    around = dict(zip(numbers, poses, strict=True))
    evidence = Evidence(model, settings, observe, around, seconds or 1.0, silent=lost)
    ways = Ways(evidence, tracked, poses, control)
    lattice = ways.gathered()
    if lattice is None:
        return list(tracked)
    best = ways.best(lattice)
    way = [row[k] for row, k in zip(lattice.minima, best.tolist(), strict=True)]
    silent = lost & {n for n, one in zip(numbers, way, strict=True) if one.origin == "bridged"}
    poses = lattice.way(best)
    poor = _poor_still(evidence, tracked, poses)
    changed = [n for n, one in enumerate(way) if one.origin != "tracked"]
    doubting = evidence.elsewhere(
        {numbers[n]: poses[n] for n in changed}, silent, frozenset(numbers[n] for n in poor)
    )
    for n in poor:
        frame, before = (
            doubting.of(numbers[n]),
            model.transform.solver_params(tracked[n].parameters),
        )
        poses[n] = min(poses[n], before, key=lambda pose: frame.at(pose).cost)
    evidence = doubting
    found = estimate_whole(evidence, numbers, poses, control.should_stop, control.on_refined)
    if found is None or control.should_stop():
        return list(tracked)
    results = [_result(evidence, found, n, tracked) for n in range(len(tracked))]
    return with_other_ways(model, results, lattice, best, settings.tracker.hypotheses)


def _poor_still(
    evidence: Evidence, tracked: Sequence[FrameResult], poses: Floats[F, P]
) -> list[int]:
    """Return the rows of frames whose cloud was poor, and of which many beside them agree badly with the hand on the best way, too:
    fingers in the wrong place let a good cloud seem poor; a sensor that is poor does not change from frame to frame.
    """
    once = [result.poor_cloud for result in tracked]
    still = np.zeros(len(tracked), bool)
    for n in np.flatnonzero(once).tolist():
        terms = evidence.of(tracked[n].frame).terms
        still[n] = poor_agreement(terms, poses[n], POOR) is not None
    share = [still[max(n - _BESIDE, 0) : n + _BESIDE + 1].mean() for n in range(len(tracked))]
    return [n for n in range(len(tracked)) if once[n] and share[n] > _STILL]


def _bridged(poses: Floats[F, P], known: Array[F]) -> Floats[F, P]:
    """Return poses with a straight way between those that are known, for a start; the root's turn by the shorter way."""
    every, posed, poses = np.arange(len(poses)), np.flatnonzero(known), poses.copy()
    for before, here in pairwise(posed):
        poses[here, TURN] = closest_equivalent(poses[here, TURN], poses[before, TURN])
    columns = [np.interp(every, posed, column[posed]) for column in poses.T]
    return np.stack(columns, axis=1)


def _result(
    evidence: Evidence, found: WholeEstimate, n: int, tracked: Sequence[FrameResult]
) -> FrameResult:
    """Return a frame at its pose of all, with what all say of it."""
    before, model = tracked[n], evidence.model
    pose, frame = found.poses[n], evidence.of(before.frame)
    change = by_change(pose)
    covariance = change @ found.covariance[n] @ change.T
    spread = uncertainty(model, pose, np.linalg.inv(covariance))
    status, reason = before.status, before.reason
    if frame.terms.has_seen and before.frame not in evidence.silent | evidence.poor:
        energy = frame.problem.cost(pose)
        status, reason = judged(frame.terms, pose, energy, spread.joint_covariance, tracked[:n])
    std, seen = spread.parameter_std, frame.terms.has_seen
    refined = posed_result(
        model, frame.observation, pose, status, reason,
        energy=float(found.costs[n]) if seen else float("nan"),
        iterations=before.iterations + found.sweeps,
        std=np.full_like(std, np.inf) if status == Status.LOST else std,
        joint_covariance=spread.joint_covariance,
    )  # fmt: skip
    energies = frame.problem.costs(pose) if seen else {}
    return replace(refined, energies=energies, views=frame.terms.views)
