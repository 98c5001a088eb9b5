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
from handtrack.tracking.frame.assessment import assess
from handtrack.tracking.frame.control import Control
from handtrack.tracking.frame.descent import descend
from handtrack.tracking.frame.doubt.judgement import Judgement, judged
from handtrack.tracking.frame.frame_result import judged_result
from handtrack.tracking.frame.result import FrameResult, Status
from handtrack.tracking.frame.settings import TrackerSettings
from handtrack.tracking.whole.estimate import WholeEstimate, estimate_whole
from handtrack.tracking.whole.evidence import Evidence, Observe
from handtrack.tracking.whole.motion import TURN, by_change

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
    evidence = Evidence(
        model, settings, observe, dict(zip(numbers, poses, strict=True)), seconds or 1.0,
        frozenset(r.frame for r in tracked if r.poor_cloud), lost,
    )  # fmt: skip
    found = estimate_whole(evidence, numbers, poses, control.should_stop, control.on_refined)
    again = {} if found is None else _found_again(evidence, numbers, found, lost, control)
    if found is not None and again:
        around = {**dict(zip(numbers, found.poses, strict=True)), **again}
        poses = np.array([around[number] for number in numbers])
        evidence = replace(evidence, around=around, silent=lost - set(again))
        found = estimate_whole(evidence, numbers, poses, control.should_stop, control.on_refined)
    if found is None or control.should_stop():
        return list(tracked)
    return [_result(evidence, found, n, tracked) for n in range(len(tracked))]


def _bridged(poses: Floats[F, P], known: Array[F]) -> Floats[F, P]:
    """Return poses with a straight way between those that are known, for a start; the root's turn by the shorter way."""
    every, posed, poses = np.arange(len(poses)), np.flatnonzero(known), poses.copy()
    for before, here in pairwise(posed):
        poses[here, TURN] = closest_equivalent(poses[here, TURN], poses[before, TURN])
    columns = [np.interp(every, posed, column[posed]) for column in poses.T]
    return np.stack(columns, axis=1)


def _found_again(
    evidence: Evidence,
    numbers: Sequence[int],
    found: WholeEstimate,
    lost: frozenset[int],
    control: Control,
) -> dict[int, Floats[P]]:
    """Return the poses of frames in which the hand was lost and is found from where the others put it."""
    again = {}
    for n, number in enumerate(numbers):
        if number not in lost or control.should_stop():
            continue
        frame, pose = evidence.of(number), found.poses[n]
        if not frame.terms.has_seen:
            continue
        summary, _, _ = descend(
            evidence.model, evidence.settings.solver, frame.terms, pose, control.should_stop
        )
        bones = evidence.model.bones(summary.params)
        if assess(frame.terms, bones, summary.cost, ())[0] != Status.LOST:
            again[number] = summary.params
    return again


def _result(
    evidence: Evidence, found: WholeEstimate, n: int, tracked: Sequence[FrameResult]
) -> FrameResult:
    """Return a frame at its pose of all, with what all say of it."""
    before, model = tracked[n], evidence.model
    pose, frame = found.poses[n], evidence.of(before.frame)
    change = by_change(pose)
    covariance = change @ found.covariance[n] @ change.T
    spread = uncertainty(model, pose, np.linalg.inv(covariance))
    found_at = Judgement(before.status, before.reason, spread.joint_covariance)
    energies = frame.problem.costs(pose) if frame.terms.has_seen else {}
    if frame.terms.has_seen and before.frame not in evidence.silent | evidence.poor:
        energy, places = frame.problem.cost(pose), model.joint_positions(model.bones(pose))
        moved_m = float(np.linalg.norm(places - before.joint_positions, axis=1).max())
        found_at = judged(
            frame.terms, pose, energy, energies, spread.joint_covariance, tracked[:n], moved_m
        )
    return judged_result(
        model, frame.observation, pose, found_at, spread.parameter_std,
        float(found.costs[n]) if frame.terms.has_seen else float("nan"),
        before.iterations + found.sweeps, energies,
    )  # fmt: skip
