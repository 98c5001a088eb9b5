"""Poses that a person set: they hold, and the frames beside them follow from both sides."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from handtrack.arrays import F, Floats, P
from handtrack.model.articulated import ArticulatedModel
from handtrack.solver.levenberg_marquardt import solve
from handtrack.terms.priors.priors import GaussianPrior
from handtrack.tracking.frame.control import Control
from handtrack.tracking.frame.frame_result import posed_result
from handtrack.tracking.frame.result import FrameResult, Status
from handtrack.tracking.frame.settings import TrackerSettings
from handtrack.tracking.size.motion import Motion, changes, moved
from handtrack.tracking.whole.evidence import Evidence, Observe

KEYFRAME_REACH = 50
"""frames on either side that a keyframe may change"""
_MERGED_M = 1e-3
"""where what was seen undoes the correction to a millimetre, it ends"""
_ITERATIONS = 12
_HELD_M, _HELD_RAD = 1e-4, 1e-3
"""how exactly a keyframe is kept: nothing that was seen, in so many pixels, moves it by a tenth of a millimetre"""


def keyframe_prior(model: ArticulatedModel, pose: Floats[P]) -> GaussianPrior:
    """Return what keeps a frame at a pose."""
    joint = model.joint_params(pose)
    sigma = np.full(len(joint), _HELD_RAD)
    sigma[:3] = _HELD_M
    return GaussianPrior(joint, sigma, "keyframe")


def with_keyframes(
    model: ArticulatedModel,
    settings: TrackerSettings,
    observe: Observe,
    tracked: Sequence[FrameResult],
    held: Mapping[int, Floats[P]],
    seconds: float,
    control: Control = Control(),
    new: Mapping[int, Floats[P]] | None = None,
    pinned: Mapping[int, Floats[P]] | None = None,
) -> list[FrameResult]:
    """Return tracked frames with those that a person posed among them, ascending, and those beside at poses that follow.

    held: solver parameters by frame. From each on, in both directions, what it corrects is carried to the next frame and
    fitted there to what was seen; until that leads back to the pose that stood, or the pose that stood fits better by more
    than a hand moves in a frame. seconds: from one frame to the next; new: those from which it is carried; all, unless given.
    pinned: others, to which their pins led: they are tracked frames that stand there.
    """
    pinned = pinned or {}
    known = {result.frame: result for result in tracked}
    posed = {
        frame: posed_result(model, observe(frame, model.bones(pose)), pose, Status.KEYFRAME, None)
        for frame, pose in held.items()
    }
    numbers = sorted(known | posed)
    around = {n: model.transform.solver_params(known[n].parameters) for n in known}
    given = {**held, **{n: pose for n, pose in pinned.items() if n in known}}
    evidence = Evidence(model, settings, observe, {**around, **given}, seconds)
    found = {n: pose for n, pose in given.items() if n not in held}
    for frame, pose in (given if new is None else new).items():
        at = numbers.index(frame)
        for way in (
            numbers[at + 1 : at + 1 + KEYFRAME_REACH],
            numbers[:at][: -1 - KEYFRAME_REACH : -1],
        ):
            found |= _followed(evidence, way, around.get(frame, pose), pose, given, control)
    moved_to = {n: replace(known[n], parameters=model.joint_params(x)) for n, x in found.items()}
    everything = known | moved_to | posed
    return [everything[number] for number in numbers]


def _followed(
    evidence: Evidence,
    way: Sequence[int],
    stood: Floats[P],
    pose: Floats[P],
    held: Mapping[int, Floats[P]],
    control: Control,
) -> dict[int, Floats[P]]:
    """Return the frames along a way that follow a correction, the pose that stood and the one that stands now."""
    model = evidence.model
    push = Motion.usual(evidence.settings.prior, len(pose), evidence.seconds).pushes.diagonal()
    settings = replace(evidence.settings.solver, iterations=_ITERATIONS)
    found: dict[int, Floats[P]] = {}
    for frame in way:
        if frame in held or frame not in evidence.around or control.should_stop():
            break
        problem, before = evidence.of(frame).problem, evidence.around[frame]
        carried = model.clipped(moved(before[None], changes(np.array([stood, pose])))[0])
        # without the correction, too: a pose by all frames is not what one alone would have
        without, there = (
            solve(problem, start, settings, control.should_stop).params
            for start in (before, carried)
        )
        if _largest_m(model, without, there) < _MERGED_M:
            break
        jump = 0.5 * float((changes(np.array([without, there]))[0] ** 2 / push).sum())
        if problem.cost(there) > problem.cost(without) + jump:
            break
        found[frame] = there
        stood, pose = without, there
    return found


def _largest_m(model: ArticulatedModel, one: Floats[P], other: Floats[P]) -> float:
    """Return how far the joint that moves most moves between two poses."""
    places: Floats[F, P] = np.array([one, other])
    before, after = (model.joint_positions(model.bones(pose)) for pose in places)
    return float(np.linalg.norm(after - before, axis=1).max())
