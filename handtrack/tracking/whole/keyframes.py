"""Poses that a person set: they hold, and the frames beside them follow from both sides."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from handtrack.arrays import Floats, P
from handtrack.model.pose_changes import change, moved
from handtrack.solver.levenberg_marquardt import solve
from handtrack.tracking.frame.confidence import FrameConfidence
from handtrack.tracking.frame.control import Control
from handtrack.tracking.frame.frame_task import posed_result
from handtrack.tracking.frame.result import FrameResult, Status
from handtrack.tracking.frame.terms.priors import motion_prior
from handtrack.tracking.whole.likelihood import Recording, RecordingLikelihood, frame_seconds
from handtrack.tracking.whole.mode_search import APART_M, largest_move_m

_REACH = 50
"""frames on either side that a correction may change"""
_MERGED_M = 1e-3
"""a correction of which less is left ends"""
_ITERATIONS, _TRIED = 12, 6
_SIMILAR_RAD = np.deg2rad(12.0)
"""root mean square of what angles of two frames differ by, at which exp(−½) of an error is left. With 5, 10, 15 and 40° a corrected frame
of six made fists lowers the mean error of the ten on either side by 27, 33, 33 and 25 %"""
_SIGNIFICANT = 2.0
"""[log-likelihood] by which two poses must differ to be told apart"""


def with_keyframes(
    recording: Recording,
    tracked: Sequence[FrameResult],
    new: Mapping[int, Floats[P]] | None = None,
) -> list[FrameResult]:
    """Return tracked frames with those that a person posed among them, ascending, and those beside
    at poses that follow.

    What is corrected is the change from where the frame was tracked, or where those beside say that
    the hand stood. Frames beside err alike, as far as the hand has not moved: the change is theirs,
    too.

    Parameters
    ----------
    new
        Keyframes and pins that are carried on; all, unless given.
    """
    model, settings, observe = recording.model, recording.settings, recording.observe
    held, pinned, control = recording.keyframes, recording.pinned, recording.control
    seconds = frame_seconds(tracked)
    known = {result.frame: result for result in tracked}
    posed = {
        frame: posed_result(
            model, observe(frame, model.bones(pose)), pose, FrameConfidence(Status.KEYFRAME)
        )
        for frame, pose in held.items()
    }
    numbers = sorted(known | posed)
    around = {n: model.solver_params(known[n].parameters) for n in known}
    given = {**held, **{n: pose for n, pose in pinned.items() if n in known}}
    found = {n: (n, pose) for n, pose in given.items() if n not in held}
    for frame, pose in (given if new is None else new).items():
        at = numbers.index(frame)
        beside = [n for n in numbers[max(at - 1, 0) : at + 2] if n != frame] or [frame]
        stood = around.get(frame)
        if stood is None:
            stood = _between([{**around, **held}[n] for n in beside])
        likelihood = RecordingLikelihood(
            model, settings, observe, {**around, frame: stood}, seconds, known=recording.cameras
        )
        for way in (numbers[at + 1 : at + 1 + _REACH], numbers[:at][: -1 - _REACH : -1]):
            for n, there in _followed(likelihood, way, frame, pose, given, control).items():
                other, one = found.get(n, (frame, there))
                nearer = abs(n - other) / (abs(n - other) + abs(n - frame))
                found[n] = frame, moved(one, nearer * change(one, there))
    moved_to = {
        n: replace(known[n], parameters=model.joint_params(x)) for n, (_, x) in found.items()
    }
    everything = known | moved_to | posed
    return [everything[number] for number in numbers]


def _between(beside: Sequence[Floats[P]]) -> Floats[P]:
    """Return the middle of the poses on either side, or the only one's."""
    return moved(beside[0], 0.5 * change(beside[0], beside[-1]))


def _followed(
    likelihood: RecordingLikelihood,
    way: Sequence[int],
    frame: int,
    pose: Floats[P],
    held: Mapping[int, Floats[P]],
    control: Control,
) -> dict[int, Floats[P]]:
    """Return the frames along a way that follow a correction.

    A correction leads to another minimum of what was seen, and on from there. That minimum is looked for in the next frame beside the
    last one's, until it is none or the same. By what the correction goes on, what was seen errs: so it does beside, less
    the further the hand has moved, and at most as surely.
    """
    model, stop = likelihood.model, control.should_stop
    settings = replace(likelihood.settings.solver, iterations=_ITERATIONS)

    def settled(n: int, at: Floats[P]) -> Floats[P]:
        """Return the minimum near a pose, where what nothing shows stays."""
        seen = likelihood.of(n).problem
        pull = motion_prior(model.joint_params(at), likelihood.settings.prior, 1.0, 1)
        pulled = replace(seen, parameter_terms=(*seen.parameter_terms, pull))
        return solve(pulled, at, settings, stop).params

    def change_of_minimum(n: int, before: Floats[P], after: Floats[P]) -> Floats[P]:
        """Return by what the minimum near a pose differs from that near the one before; by nothing where it is no better."""
        # without the correction, too: a pose by all frames is not what one alone would have
        without, there = settled(n, before), settled(n, after)
        cost = likelihood.of(n).problem.cost
        same = largest_move_m(model, without, there) < APART_M
        worse = same or cost(there) > cost(without) + _SIGNIFICANT
        return np.zeros_like(before) if worse else change(without, there)

    stood = likelihood.around[frame]
    step = change_of_minimum(frame, stood, pose)
    middle = model.clipped(moved(stood, step))
    problem, correlation = likelihood.of(frame).problem, 1.0
    if problem.cost(pose) < problem.cost(middle) - _SIGNIFICANT:  # it stood beside a minimum
        middle = settled(frame, pose)
    agrees = problem.cost(middle) < problem.cost(settled(frame, stood)) - _SIGNIFICANT
    # where such a minimum is found beside, and where none is: by what the correction leaves what was seen, and what that costs
    errors = [
        (
            change(begin, pose),
            max(problem.cost(pose) - problem.cost(begin), 0.0) + _SIGNIFICANT,
        )
        for begin in (middle, middle if agrees else stood)
    ]
    found: dict[int, Floats[P]] = {}
    for beside in way:
        if beside in held or stop():
            break
        problem, before, last = (
            likelihood.of(beside).problem,
            likelihood.around[beside],
            correlation,
        )
        apart = change(stood, before)[3:]
        correlation = float(np.exp(-0.5 * (apart @ apart) / (len(apart) * _SIMILAR_RAD**2)))
        if step.any():
            less = min(correlation / max(last, correlation), 1.0) * step
            step = change_of_minimum(beside, before, model.clipped(moved(before, less)))
        middle = model.clipped(moved(before, step))
        error, against = errors[0 if step.any() else 1]
        beyond = correlation * error
        for _ in range(_TRIED):  # of a robust loss half the way costs more than a quarter
            there = model.clipped(moved(middle, beyond))
            worse = problem.cost(there) - problem.cost(middle)
            if worse <= against:
                break
            beyond = beyond * (against / worse) ** 0.5
        if largest_move_m(model, before, there) < _MERGED_M:
            break
        found[beside] = there
    return found
