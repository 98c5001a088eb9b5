"""The recording-level estimate: each frame again, by those before and after it, as a list of passes over one immutable estimate."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from handtrack.arrays import D3, Array, C, F, Floats, K, P, array_dataclass, evenly_spread, runs
from handtrack.geometry.rotation import closest_equivalent
from handtrack.model.model_file import SIMPLER_HANDS
from handtrack.model.pose_changes import TURN
from handtrack.observation.observation import Observation
from handtrack.parallel import in_parallel, one_blas_thread
from handtrack.solver.covariance import uncertainty
from handtrack.solver.problem import Problem
from handtrack.tracking.frame.confidence import HISTORY, assessed_as, frame_confidence, moved_sign
from handtrack.tracking.frame.control import Control
from handtrack.tracking.frame.frame_task import posed_result
from handtrack.tracking.frame.frame_terms import by_camera
from handtrack.tracking.frame.result import FrameResult, Status
from handtrack.tracking.search.frame_solve import POOR, free_sign, poor_agreement
from handtrack.tracking.size.cameras import (
    CALIBRATION,
    DETECTOR,
    OUTLINE,
    TIME,
    CameraChanges,
)
from handtrack.tracking.size.estimate import (
    StoppedError,
    WholeEstimate,
    by_change,
    estimate_whole,
    terms_of,
)
from handtrack.tracking.size.person import PersonChange
from handtrack.tracking.whole.alternatives import with_alternatives
from handtrack.tracking.whole.keyframes import with_keyframes
from handtrack.tracking.whole.likelihood import (
    MOSTLY_NEW,
    NEW_POSE_S,
    Recording,
    RecordingLikelihood,
    frame_seconds,
    measured_outlines,
    new_share,
)
from handtrack.tracking.whole.mode_search import ModeSearch, Trellis
from handtrack.tracking.whole.refinement import Refinement
from handtrack.tracking.whole.trajectory_hypotheses import (
    trajectory_hypotheses,
    trajectory_weights,
)

_BESIDE = 7
"""frames to either side by which a cloud's is judged: half a second in all"""
_STILL = 0.4
"""share of these from which depths are doubted, chosen on two damaged recordings (docs/explanation/trajectory.md): made of
`webxr_exact_depth_768` with small holes, 0.25 and 0.4 give 8.8 and 7.0 mm; of `webxr_depth_640` without whole fingers, 6.2 and 6.6"""
_FEWEST = 3
"""frames that have a motion"""
_MEMORY = 2
"""frames before one that say where it goes: its place and its velocity"""
_MOVED_S = 1.0
"""[s] of frames, two movements, that cameras are corrected by: what masks are wrong by at one pose looks like a camera's error"""
_TRIED = 3
"""sweeps after which cameras' corrections are about what they will be"""
_UNSEEN = 7
"""numbers that no frame tells: where, how turned and how large the room is"""
_BY_CHANCE = 0.05
"""of good calibrations that would be corrected if all frames were one. Measured, each half the ratio: clean up to 2.0 (another hand),
0.5°, 2 mm and 0.5 % off, or a camera late, from 11; asked for are 8.5 of two cameras, 13.8 of three"""
_EXPECTED = 0.5
"""share of that gain that a first step must foretell, which is true near the least cost, and the first sweeps bring; else the cameras are
good, and no more is tried"""
_SAMPLES = 8
"""frames, evenly spread, that tell which cameras there are"""
_MOST_LATE = 5
"""frames that a camera may be late by: a fifth of a second at 25 a second, further than a hand's picture reaches its place"""
_LATE_SAMPLES = 40
"""frames, evenly spread, that are looked at"""


@array_dataclass
class RecordingEstimate:
    """What is known of a recording after a pass."""

    tracked: Sequence[FrameResult]
    """as they came, frame after frame, ascending"""
    likelihood: RecordingLikelihood
    """what frames say, and what they share"""
    poses: Floats[F, P]
    """solver parameters"""
    trellis: Trellis | None = None
    """modes of each frame, joined; `poses` lie on its Viterbi path"""
    calibrated: WholeEstimate | None = None
    """all poses, and what they share, found together, cameras too"""
    hypotheses: Sequence[WholeEstimate] = ()
    """trajectories of the calibrated recording, the best first: one, or as many as were asked for"""
    results: Sequence[FrameResult] = ()

    @property
    def frames(self) -> list[int]:
        return [result.frame for result in self.tracked]

    @property
    def control(self) -> Control:
        return self.likelihood.recording.control

    @property
    def solution(self) -> WholeEstimate:
        """The best of all poses so far, after `descend`."""
        assert self.calibrated is not None, "passes come in order"
        return self.hypotheses[0] if self.hypotheses else self.calibrated

    @property
    def refinement(self) -> Refinement:
        """What all frames share, after `descend`."""
        return Refinement.of(self.solution, self.calibrated)

    @property
    def duration_s(self) -> float:
        return self.likelihood.seconds * len(self.tracked)

    def solved(self, likelihood: RecordingLikelihood, poses: Floats[F, P]) -> WholeEstimate:
        """Return the least cost near some poses. Raises StoppedError."""
        stop, progress = self.control.should_stop, self.control.observer.progress
        return estimate_whole(likelihood, self.frames, poses, stop, progress)


@one_blas_thread
def refine(recording: Recording, tracked: Sequence[FrameResult]) -> list[FrameResult]:
    """Return frames that follow one another at the poses that are most probable together.

    Parameters
    ----------
    recording
        Model, settings and observations; keyframes and pins hold, and the frames beside follow. What all frames share is reported to the
        observer of its `control`. Keyframes are not returned.
    tracked
        As they came, frame after frame, ascending. Where the hand was lost it goes on by its motion from both sides; what was observed
        there is looked at again from such a pose, and counts where the hand is found in it.

    Returns
    -------
    list
        `tracked` itself where the hand was found in too few frames, or when stopped.
    """
    held, posed = recording.keyframes, [*recording.keyframes, *recording.pinned]
    begun = with_keyframes(recording, tracked) if posed else tracked
    if sum(result.status != Status.LOST for result in begun) < _FEWEST:
        return list(tracked)
    estimate = bridge_gaps(replace(recording, cameras=()), begun)
    try:
        for one in PASSES:
            estimate = one(estimate)
            if recording.control.should_stop():
                raise StoppedError
    except StoppedError:
        return list(tracked)
    found = replace(estimate.likelihood.recording, cameras=estimate.refinement.cameras)
    free = [result for result in estimate.results if result.frame not in held]
    again = refine_near(found, free, posed) if posed else []
    results = {r.frame: r for r in (*free, *again)}.values()
    return [result for result in results if result.frame not in held]


def bridge_gaps(recording: Recording, tracked: Sequence[FrameResult]) -> RecordingEstimate:
    """Return where the estimate begins: tracked poses, and between them straight on where the hand was lost."""
    solver_params = recording.model.solver_params
    lost = frozenset(r.frame for r in tracked if r.status == Status.LOST)
    numbers = [result.frame for result in tracked]
    found = [n for n, number in enumerate(numbers) if number not in lost]
    poses = _bridged(
        np.array([solver_params(r.parameters) for r in tracked]),
        np.array([number not in lost for number in numbers]),
    )
    around = dict(zip(numbers, poses, strict=True))
    likelihood = RecordingLikelihood(recording, around, frame_seconds(tracked), silent=lost)
    outlines = measured_outlines(likelihood, [numbers[n] for n in found], poses[found])
    likelihood = likelihood.knowing(outline_mm=outlines)
    likelihood = likelihood.knowing(new=new_share(likelihood, numbers, poses))
    return RecordingEstimate(tracked, likelihood, poses)


def choose_modes(estimate: RecordingEstimate) -> RecordingEstimate:
    """Return the estimate on the Viterbi path through the modes of its frames. Raises StoppedError."""
    tracked, numbers, likelihood = estimate.tracked, estimate.frames, estimate.likelihood
    search = ModeSearch(likelihood, tracked)
    gathered = search.gathered()
    if gathered is None:
        raise StoppedError
    trellis = search.with_observed_change(gathered)
    path = [row[k] for row, k in zip(trellis.minima, trellis.best.tolist(), strict=True)]
    bridged = {n for n, one in zip(numbers, path, strict=True) if one.origin == "bridged"}
    poses = trellis.path(trellis.best)
    poor = _poor_still(likelihood, tracked, poses)
    changed = [n for n, one in enumerate(path) if one.origin != "tracked"]
    likelihood = likelihood.elsewhere(
        {numbers[n]: poses[n] for n in changed}, likelihood.silent & bridged, frozenset(numbers[n] for n in poor)
    )  # fmt: skip
    estimate.likelihood.forget()  # the trellis still has it
    for n in poor:
        before = likelihood.model.solver_params(tracked[n].parameters)
        poses[n] = min(poses[n], before, key=lambda pose: likelihood.of(numbers[n]).at(pose).cost)
    return replace(estimate, likelihood=likelihood, poses=poses, trellis=trellis)


def open_shared_parameters(estimate: RecordingEstimate) -> RecordingEstimate:
    """Return the estimate in which what some frames tell of the person and of the cameras' times and masks is to be found."""
    likelihood = estimate.likelihood
    subject = likelihood.recording.subject
    samples = _samples(likelihood, [r.frame for r in estimate.tracked if r.status != Status.LOST])
    if subject is not None and samples:
        likelihood = likelihood.knowing(person=PersonChange.of(likelihood.model, samples, subject))
    timed = estimate.duration_s >= NEW_POSE_S and likelihood.model.name not in SIMPLER_HANDS
    later = [likelihood.frames_later[frame] for frame in estimate.frames]  # `new_share` read all
    cameras = CameraChanges.of([one for one, _ in samples], later)
    likelihood = likelihood.knowing(wide=cameras.detected and likelihood.model.kind == "hand")
    # a camera in which a detector sees the whole hand to one side seems to be late
    at = TIME | DETECTOR if cameras.detected else TIME
    cameras = cameras.finding(OUTLINE | at if timed else OUTLINE)
    return replace(estimate, likelihood=likelihood.sharing(likelihood.shared.through(cameras)))


def descend(estimate: RecordingEstimate) -> RecordingEstimate:
    """Return the estimate at the least cost nearby, of all poses and of what they share. Raises StoppedError."""
    return replace(estimate, calibrated=estimate.solved(estimate.likelihood, estimate.poses))


def correct_cameras(estimate: RecordingEstimate) -> RecordingEstimate:
    """Return the estimate with cameras corrected, where that explains more than as many numbers would of nothing. Raises StoppedError."""
    found, numbers = estimate.solution, estimate.frames
    too_short = estimate.duration_s < _MOVED_S
    if not found.cameras.count or too_short or estimate.likelihood.model.name in SIMPLER_HANDS:
        return estimate
    cameras = found.cameras.finding(found.cameras.free | CALIBRATION | TIME)
    likelihood = estimate.likelihood.sharing(found.shared.through(cameras))
    nearest = _nearest_images(likelihood, numbers, found.poses)
    likelihood = likelihood.sharing(found.shared.through(nearest))
    asked = _asked_gain(cameras)
    at_most = float(found.costs.mean()) - _EXPECTED * asked
    stop = estimate.control.should_stop
    try:
        tried = estimate_whole(
            likelihood, numbers, found.poses, stop, sweeps=_TRIED, at_most=at_most
        )
    except StoppedError:  # also where a first step foretells less
        return estimate
    if tried.costs.mean() >= at_most:
        return estimate
    again = estimate.solved(likelihood.sharing(tried.shared), tried.poses)
    better = found.costs.mean() - again.costs.mean() > asked
    return replace(estimate, calibrated=again) if better else estimate


def let_outliers_go(estimate: RecordingEstimate) -> RecordingEstimate:
    """Return the estimate once detected joints far off the model no longer pull, neither at poses nor at what frames share. Raises
    StoppedError.
    """
    if not estimate.likelihood.wide:  # a body's are never let go: one descent finds all
        return estimate
    found = estimate.solution
    likelihood = estimate.likelihood.sharing(found.shared).knowing(wide=False)
    again = estimate.solved(likelihood, found.poses)
    return replace(estimate, likelihood=likelihood, calibrated=again, hypotheses=(again,))


def flip_limbs(estimate: RecordingEstimate) -> RecordingEstimate:
    """Return the estimate of the trajectories that one camera's joints leave open, where several are asked for."""
    count, likelihood = estimate.likelihood.settings.tracker.hypotheses, estimate.likelihood
    if count <= 1 or likelihood.new > MOSTLY_NEW:
        return estimate
    several = trajectory_hypotheses(
        likelihood, estimate.solution, estimate.frames, count, estimate.control
    )
    return replace(estimate, hypotheses=several)


def assess_frames(estimate: RecordingEstimate) -> RecordingEstimate:
    """Return the estimate with each frame's result, of the person and by the cameras that were found; these are reported."""
    found, refinement, tracked = estimate.solution, estimate.refinement, estimate.tracked
    estimate.control.observer.shared(refinement.text)
    likelihood = estimate.likelihood.sharing(found.shared)
    recording = likelihood.recording
    if recording.subject is not None and refinement.scale is not None:
        recording = replace(recording, model=recording.subject.build(refinement.scale))
        around = dict(zip(estimate.frames, found.poses, strict=True))
        estimate.likelihood.forget()
        likelihood = replace(likelihood, recording=recording, around=around, person=None)
    results = in_parallel(lambda n: _result(likelihood, found, n, tracked), range(len(tracked)))
    return replace(estimate, likelihood=likelihood, results=results)


def keep_alternatives(estimate: RecordingEstimate) -> RecordingEstimate:
    """Return the estimate whose frames have the other poses that all frames together leave open, and are as unsure."""
    assert estimate.trellis is not None, "passes come in order"
    likelihood, hypotheses = estimate.likelihood, estimate.hypotheses or [estimate.solution]
    weights = trajectory_weights(likelihood, hypotheses).tolist()
    results = with_alternatives(
        likelihood.model, estimate.results, estimate.trellis, likelihood.settings.tracker.hypotheses,
        list(zip(hypotheses, weights, strict=True)),
    )  # fmt: skip
    return replace(estimate, results=results)


PASSES: tuple[Callable[[RecordingEstimate], RecordingEstimate], ...] = (
    choose_modes,
    open_shared_parameters,
    descend,
    correct_cameras,
    let_outliers_go,
    flip_limbs,
    assess_frames,
    keep_alternatives,
)


@one_blas_thread
def refine_near(
    recording: Recording, tracked: Sequence[FrameResult], changed: Sequence[int]
) -> list[FrameResult]:
    """Return the frames that follow keyframes and pins; all others stand as they are; no frame when
    stopped.

    Parameters
    ----------
    tracked
        Refined before, ascending.
    changed
        At which frames keyframes or pins were set since.
    """
    stood, seconds = {result.frame: result for result in tracked}, frame_seconds(tracked)
    posed = {**recording.keyframes, **recording.pinned}
    new = {frame: posed[frame] for frame in changed if frame in posed}
    followed = with_keyframes(recording, tracked, new)
    held, model = recording.keyframes, recording.model
    touched = np.array([r is not stood.get(r.frame) and r.frame not in held for r in followed])
    near = np.convolve(touched, np.ones(2 * _MEMORY + 1), "same") > 0
    around = {result.frame: model.solver_params(result.parameters) for result in followed}
    found: list[FrameResult] = []
    for first, stop in runs(near):
        inside = followed[first:stop]
        numbers = [result.frame for result in inside]
        poses = np.array([around[number] for number in numbers])
        likelihood = RecordingLikelihood(replace(recording, keyframes={}), around, seconds)
        stop_asked = recording.control.should_stop
        try:
            whole = estimate_whole(likelihood, numbers, poses, stop_asked, sweeps=0)
        except StoppedError:
            return []
        if stop_asked():
            return []
        found += [
            _result(likelihood, whole, n, inside)
            for n in np.flatnonzero(touched[first:stop]).tolist()
        ]
    return found


def _asked_gain(cameras: CameraChanges) -> float:
    """Return by how much corrections of the cameras must lower a frame's cost, to explain more than as many numbers would of nothing: half
    a likelihood ratio, all frames telling as much as one. Masks that are all too wide would move good cameras, too.
    """
    from scipy.special import chdtri

    seen = int((CALIBRATION & cameras.free).sum()) * len(cameras.cameras) - _UNSEEN
    return 0.5 * float(chdtri(seen, _BY_CHANCE)) if seen > 0 else float("inf")


def _samples(
    likelihood: RecordingLikelihood, posed: Sequence[int]
) -> list[tuple[Observation, Floats[D3]]]:
    """Return some frames and where the hand is in them, by which it is told what all share; none where images are looked at."""
    if likelihood.settings.uses_images:
        return []
    found = []
    for k in evenly_spread(len(posed), _SAMPLES):
        bones = likelihood.model.bones(likelihood.around[posed[k]])
        found.append((likelihood.recording.observe(posed[k], bones), bones.position.mean(axis=0)))
    return found


def _poor_still(
    likelihood: RecordingLikelihood, tracked: Sequence[FrameResult], poses: Floats[F, P]
) -> list[int]:
    """Return the rows of frames whose cloud was poor, and of which many beside them agree badly with the hand on the best way, too:
    fingers in the wrong place let a good cloud seem poor; a sensor that is poor does not change from frame to frame.
    """
    once = [result.poor_cloud for result in tracked]
    still = np.zeros(len(tracked), bool)
    for n in np.flatnonzero(once).tolist():
        terms = likelihood.of(tracked[n].frame).terms
        still[n] = poor_agreement(terms, terms.model.bones(poses[n]), POOR) is not None
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
    likelihood: RecordingLikelihood, found: WholeEstimate, n: int, tracked: Sequence[FrameResult]
) -> FrameResult:
    """Return a frame at its pose of all, with what all say of it."""
    before, model = tracked[n], likelihood.model
    pose, frame = found.poses[n], likelihood.of(before.frame)
    change = by_change(pose)
    covariance = change @ found.covariance[n] @ change.T
    _, std, joints = uncertainty(model, pose, np.linalg.inv(covariance))
    seen = frame.terms.has_observations
    terms, problem = frame.observed_by(found, n)
    energies = problem.costs(pose) if seen else {}
    result = replace(
        posed_result(model, before, pose, std=std),
        joint_covariance=joints,
        energy=float(found.costs[n]) if seen else float("nan"),
        energies=energies,
        iterations=before.iterations + found.sweeps,
        views=frame.terms.views,
    )
    counts = before.frame not in likelihood.silent and before.frame not in likelihood.poor
    if seen and counts:
        energy, places = sum(energies.values()), model.joint_positions(model.bones(pose))
        moved_m = float(np.linalg.norm(places - before.joint_positions, axis=1).max())
        previous = tracked[max(n - HISTORY, 0) : n]
        free = free_sign(terms, pose) if model.has_keypoints21 else 0.0
        refined = {"moved": moved_sign(moved_m), "free": free}
        return frame_confidence(result, terms, pose, energy, previous, refined)
    return assessed_as(result, before.status, before.reason)


def _nearest_images(
    likelihood: RecordingLikelihood, numbers: Sequence[int], poses: Floats[F, P]
) -> CameraChanges:
    """Return the evidence's cameras with those images looked at beside a frame that fit its pose best, in the widest band and better in
    the narrowest, too: of fingers that curl at one place the widest may tell any.

    Only a start: poses that were found with a late camera lie between it and the others.
    """
    cameras = likelihood.cameras
    if not cameras.count or len(numbers) <= 2 * _MOST_LATE:
        return cameras
    best = _costs_of_images(likelihood, numbers, poses, range(2 * _MOST_LATE + 1), 0).argmin(axis=1)
    if (best == _MOST_LATE).all():
        return cameras
    tried = sorted({_MOST_LATE, *best.tolist()})
    narrow = _costs_of_images(likelihood, numbers, poses, tried, -1)
    own = narrow[np.arange(len(best)), np.searchsorted(tried, best)]
    later = np.where(own < narrow[:, tried.index(_MOST_LATE)], best - _MOST_LATE, 0)
    # the recording's time is that of most cameras; of two, the first one's
    common = min(later.tolist(), key=lambda one: int(np.abs(later - one).sum()))
    return replace(cameras, ahead=tuple((common - later).tolist()))


def _costs_of_images(
    likelihood: RecordingLikelihood,
    numbers: Sequence[int],
    poses: Floats[F, P],
    later: Sequence[int],
    stage: int,
) -> Floats[C, K]:
    """Return what each camera's pictures of some frames cost at poses of frames beside them, the K-th `later` less _MOST_LATE frames after;
    stage: of the bands, the widest first, −1 the narrowest.
    """
    names, model = likelihood.cameras.names, likelihood.shared.person.model
    found = np.zeros((len(names), len(later)))
    observations = np.unique(
        np.linspace(_MOST_LATE, len(numbers) - 1 - _MOST_LATE, _LATE_SAMPLES).round().astype(int)
    )
    for n in observations.tolist():
        terms = likelihood.of(numbers[n]).terms
        seen, _ = by_camera(terms.stage(likelihood.model.bones(poses[n]), stage % terms.stages))
        for c, name in enumerate(names):
            problem = Problem(model, seen.get(name, []))
            problem = replace(problem, observation_terms=terms_of(problem, model))
            for k, frames in enumerate(later):
                found[c, k] += problem.cost(poses[n + frames - _MOST_LATE])
    return found
