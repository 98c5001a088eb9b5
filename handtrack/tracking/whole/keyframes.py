"""Poses that a person set: they hold, and the frames beside them follow from both sides."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from handtrack.arrays import Floats, P
from handtrack.model.pose_changes import change, moved
from handtrack.tracking.frame.frame_task import posed_result
from handtrack.tracking.frame.result import FrameResult, Status
from handtrack.tracking.size.motion import Motion
from handtrack.tracking.whole.likelihood import Recording
from handtrack.tracking.whole.mode_search import largest_move_m

_REACH = 50
"""frames on either side that a correction may change"""
_MERGED_M = 1e-3
"""a correction of which less is left ends"""
_SIMILAR_RAD = np.deg2rad(12.0)
"""root mean square of what angles of two frames differ by, at which exp(−½) of an error is left: 13° where it is measured, between all
frames up to 15 apart of seven made fists"""


def with_keyframes(
    recording: Recording,
    tracked: Sequence[FrameResult],
    new: Mapping[int, Floats[P]] | None = None,
) -> list[FrameResult]:
    """Return tracked frames with those that a person posed among them, ascending, and those beside
    at poses that follow.

    What is corrected is the change from where the frame was tracked, or where those beside say that
    the hand stood. Frames beside err alike, as far as the hand has not moved: the change is theirs,
    too. What was observed does not limit it, since that has led to the error.

    Parameters
    ----------
    new
        Keyframes and pins that are carried on; all, unless given.
    """
    model, settings, observe = recording.model, recording.settings, recording.observe
    held, pinned = recording.keyframes, recording.pinned
    known = {result.frame: result for result in tracked}
    posed = {
        frame: posed_result(model, observe(frame, model.bones(pose)), pose, Status.KEYFRAME)
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
        step = change(stood, pose)
        usual = Motion.usual(settings.prior, len(step), 1.0).process_noise.diagonal()
        for way in (numbers[at + 1 : at + 1 + _REACH], numbers[:at][: -1 - _REACH : -1]):
            for n in way:
                if n in given:
                    break
                share = _share(step, change(stood, around[n]), usual)
                there = model.clipped(moved(around[n], share * step))
                if largest_move_m(model, around[n], there) < _MERGED_M:
                    break
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


def _share(step: Floats[P], since: Floats[P], usual: Floats[P]) -> float:
    """Return the share of a correction that is another frame's, too, by what the tracked hand moves until then: none where that is all of the
    correction itself, and less the more it is beside.

    Parameters
    ----------
    usual
        Variances of what parameters change from a frame to the next, which weigh them.
    """
    along, size = float(step @ (since / usual)), float(step @ (step / usual))
    if along >= size:
        return 0.0
    beside = (since - along / size * step)[3:]
    similar = np.exp(-0.5 * (beside @ beside) / (len(beside) * _SIMILAR_RAD**2))
    return min(1.0 - along / size, 1.0) * float(similar)
