"""A tracked recording once all of it is known: each frame again, by those before and after it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from handtrack.arrays import D3, Array, F, Floats, P
from handtrack.geometry.rotation import closest_equivalent
from handtrack.model.articulated import ArticulatedModel
from handtrack.observation.observation import ImageKeypoints, Observation
from handtrack.parallel import one_blas_thread
from handtrack.solver.covariance import uncertainty
from handtrack.tracking.frame.control import Control
from handtrack.tracking.frame.doubt.judgement import Judgement, judged
from handtrack.tracking.frame.frame_result import judged_result
from handtrack.tracking.frame.result import FrameResult, Status
from handtrack.tracking.frame.settings import TrackerSettings
from handtrack.tracking.search.policy import POOR
from handtrack.tracking.search.poor_cloud import poor_agreement
from handtrack.tracking.size.cameras import ALL, CALIBRATION, OUTLINE, TIME, CameraChanges
from handtrack.tracking.size.estimate import WholeEstimate, estimate_whole
from handtrack.tracking.size.motion import TURN, by_turn
from handtrack.tracking.size.person import OpenPerson, PersonChange
from handtrack.tracking.whole.evidence import (
    MOSTLY_NEW,
    NEW_POSE_S,
    Evidence,
    Observe,
    measured_outlines,
    new_share,
)
from handtrack.tracking.whole.keyframes import with_keyframes
from handtrack.tracking.whole.late import with_late_cameras
from handtrack.tracking.whole.other_ways import with_other_ways
from handtrack.tracking.whole.refinement import Refinement
from handtrack.tracking.whole.several import Way, several_ways
from handtrack.tracking.whole.ways import Ways

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
_PROMISED = 0.5
"""share of that gain that a first step must foretell, which is true near the least cost, and the first sweeps bring; else the cameras are
good, and no more is tried"""
_LOOKS = 8
"""frames, evenly spread, that tell which cameras there are"""


@one_blas_thread
def refined(
    model: ArticulatedModel,
    settings: TrackerSettings,
    observe: Observe,
    tracked: Sequence[FrameResult],
    control: Control = Control(),
    held: Mapping[int, Floats[P]] | None = None,
    corrects_cameras: bool = True,
    pinned: Mapping[int, Floats[P]] | None = None,
    who: OpenPerson | None = None,
) -> list[FrameResult]:
    """Return frames that follow one another, ascending, at the poses that are most probable together; as they are if the
    hand was found in too few of them, or when stopped.

    held: solver parameters by frame of poses that a person set; they are kept, and what lies beside follows, unless they
    are among `tracked` already. They are not returned. pinned: likewise of tracked frames to which a person's pins led: what
    lies beside follows, and they are refined by their pins. corrects_cameras: where two see the hand, what their calibration and
    their time are off by is found with the poses, and told to control; the calibration stays as it is. who: what is found of the
    person, told too: the frames are this person's then.

    tracked: as they came, frame after frame. Where the hand was lost it goes on by its motion from both sides; what was seen
    there is looked at again from such a pose, and counts where the hand is found in it.
    """
    held, live = held or {}, tracked
    if held or pinned:
        tracked = with_keyframes(
            model, settings, observe, tracked, held, _seconds(tracked), control, pinned=pinned
        )
    lost = frozenset(r.frame for r in tracked if r.status == Status.LOST)
    if len(tracked) - len(lost) < _FEWEST:
        return list(live)
    numbers = [result.frame for result in tracked]
    seconds = _seconds(tracked)
    poses = np.array([model.transform.solver_params(r.parameters) for r in tracked])
    poses = _bridged(poses, np.array([number not in lost for number in numbers]))
    around = dict(zip(numbers, poses, strict=True))
    evidence = Evidence(model, settings, observe, around, seconds, silent=lost)
    posed = [n for n, number in enumerate(numbers) if number not in lost]
    outlines = measured_outlines(evidence, [numbers[n] for n in posed], poses[posed])
    evidence = replace(evidence, outline_mm=outlines)
    evidence = replace(evidence, new=new_share(evidence, numbers, poses))
    ways = Ways(evidence, tracked, poses, control)
    gathered = ways.gathered()
    if gathered is None:
        return list(live)
    lattice = ways.moving_as_found(gathered)
    best = lattice.best
    way = [row[k] for row, k in zip(lattice.minima, best.tolist(), strict=True)]
    silent = lost & {n for n, one in zip(numbers, way, strict=True) if one.origin == "bridged"}
    poses = lattice.way(best)
    poor = _poor_still(evidence, tracked, poses)
    changed = [n for n, one in enumerate(way) if one.origin != "tracked"]
    evidence = evidence.elsewhere(
        {numbers[n]: poses[n] for n in changed}, silent, frozenset(numbers[n] for n in poor)
    )
    for n in poor:
        before = model.transform.solver_params(tracked[n].parameters)
        poses[n] = min(poses[n], before, key=lambda pose: evidence.of(numbers[n]).at(pose).cost)
    looks = _looks(evidence, [n for n in numbers if n not in lost])
    if who is not None and looks:
        evidence = replace(evidence, person=PersonChange.of(model, looks, who))
    points = [one for seen, _ in looks for one in seen.keypoints]
    # a body's joints are never let go: one estimate finds all
    detected = model.kind == "hand" and any(isinstance(one, ImageKeypoints) for one in points)
    evidence = replace(evidence, wide=detected)
    lasted = seconds * len(numbers) if corrects_cameras else 0.0
    cameras = CameraChanges.seen([one for one, _ in looks]).finding(
        OUTLINE | TIME if lasted >= NEW_POSE_S else OUTLINE
    )
    evidence = evidence.sharing(evidence.shared.through(cameras))
    found = estimate_whole(evidence, numbers, poses, control.should_stop, control.on_refined)
    if found is not None and cameras.count and lasted >= _MOVED_S:
        cameras = found.cameras.finding(ALL)
        corrected = evidence.sharing(found.shared.through(cameras))
        late = with_late_cameras(corrected, numbers, found.poses)
        corrected = corrected.sharing(found.shared.through(late))
        asked = _asked_gain(cameras)
        promise = float(found.costs.mean()) - _PROMISED * asked
        tried = estimate_whole(
            corrected, numbers, found.poses, control.should_stop, sweeps=_TRIED, promise=promise
        )
        if tried is not None and tried.costs.mean() < promise:
            again = estimate_whole(
                corrected.sharing(tried.shared),
                numbers,
                tried.poses,
                control.should_stop,
                control.on_refined,
            )
            if again is None or found.costs.mean() - again.costs.mean() > asked:
                found = again
    through = found
    if found is not None and detected:
        evidence = replace(
            evidence.sharing(found.shared.through(found.cameras.finding(OUTLINE))), wide=False
        )
        found = estimate_whole(
            evidence, numbers, found.poses, control.should_stop, control.on_refined
        )
    several = list[Way]()
    if found is not None and settings.tracker.hypotheses > 1 and evidence.new <= MOSTLY_NEW:
        several = several_ways(
            Way(found, evidence, "followed"), numbers, settings.tracker.hypotheses, control
        )
        found, evidence = several[0].found, several[0].evidence
    if found is None or through is None or control.should_stop():
        return list(live)
    refinement = Refinement.of(found, through)
    control.on_shared(refinement.text)
    evidence = evidence.sharing(found.shared)
    if who is not None and refinement.scale is not None:
        model = who.build(refinement.scale)
        evidence = evidence.by(model, dict(zip(numbers, found.poses, strict=True)))
    results = [_result(evidence, found, n, tracked) for n in range(len(tracked))]
    results = with_other_ways(model, results, lattice, settings.tracker.hypotheses, several)
    if held or pinned:
        every = {**held, **(pinned or {})}
        again = refined_near(model, settings, observe, results, held, list(every), control, pinned)
        results = {r.frame: r for r in (*results, *again)}.values()
    return [result for result in results if result.frame not in held]


@one_blas_thread
def refined_near(
    model: ArticulatedModel,
    settings: TrackerSettings,
    observe: Observe,
    tracked: Sequence[FrameResult],
    held: Mapping[int, Floats[P]],
    changed: Sequence[int],
    control: Control = Control(),
    pinned: Mapping[int, Floats[P]] | None = None,
) -> list[FrameResult]:
    """Return the frames that follow keyframes and pins; all others stand as they are; no frame when stopped.

    tracked: refined before, ascending; held: all keyframes; pinned: poses to which pins led; changed: frames at which any were
    set since.
    """
    stood, seconds = {result.frame: result for result in tracked}, _seconds(tracked)
    given = {**held, **(pinned or {})}
    new = {frame: given[frame] for frame in changed if frame in given}
    followed = with_keyframes(
        model, settings, observe, tracked, held, seconds, control, new, pinned
    )
    touched = np.array([r is not stood.get(r.frame) and r.frame not in held for r in followed])
    near = np.convolve(touched, np.ones(2 * _MEMORY + 1), "same") > 0
    edges = np.flatnonzero(np.diff(np.r_[0, near, 0]))
    found: list[FrameResult] = []
    for first, stop in zip(edges[::2], edges[1::2], strict=True):
        inside = followed[first:stop]
        numbers = [result.frame for result in inside]
        poses = np.array([model.transform.solver_params(r.parameters) for r in inside])
        around = dict(zip(numbers, poses, strict=True))
        evidence = Evidence(model, settings, observe, around, seconds)
        whole = estimate_whole(evidence, numbers, poses, control.should_stop, sweeps=0)
        if whole is None or control.should_stop():
            return []
        found += [
            _result(evidence, whole, n, inside)
            for n in np.flatnonzero(touched[first:stop]).tolist()
        ]
    return found


def _seconds(tracked: Sequence[FrameResult]) -> float:
    """Return how long a frame lasts [s]; 1 where nobody knows."""
    lasted = abs(tracked[-1].time_s - tracked[0].time_s) if len(tracked) > 1 else 0.0
    return lasted / max(len(tracked) - 1, 1) or 1.0


def _asked_gain(cameras: CameraChanges) -> float:
    """Return by how much corrections of the cameras must lower a frame's cost, to explain more than as many numbers would of nothing: half
    a likelihood ratio, all frames telling as much as one. Masks that are all too wide would move good cameras, too.
    """
    from scipy.special import chdtri

    seen = int((CALIBRATION & cameras.free).sum()) * len(cameras.cameras) - _UNSEEN
    return 0.5 * float(chdtri(seen, _BY_CHANCE)) if seen > 0 else float("inf")


def _looks(evidence: Evidence, posed: Sequence[int]) -> list[tuple[Observation, Floats[D3]]]:
    """Return some frames and where the hand is in them, by which it is told what all share; none where images are looked at."""
    if evidence.settings.looks_at_images:
        return []
    found = []
    for k in np.unique(np.linspace(0, len(posed) - 1, _LOOKS).round().astype(int)):
        bones = evidence.model.bones(evidence.around[posed[k]])
        found.append((evidence.observe(posed[k], bones), bones.position.mean(axis=0)))
    return found


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
    change = np.eye(len(pose))
    change[TURN, TURN] = by_turn(pose)
    covariance = change @ found.covariance[n] @ change.T
    spread = uncertainty(model, pose, np.linalg.inv(covariance))
    found_at = Judgement(before.status, before.reason, spread.joint_covariance)
    seen = frame.terms.has_seen
    terms, problem = frame.seen_by(found.cameras, pose)
    energies = problem.costs(pose) if seen else {}
    if seen and before.frame not in evidence.silent | evidence.poor:
        energy, places = sum(energies.values()), model.joint_positions(model.bones(pose))
        moved_m = float(np.linalg.norm(places - before.joint_positions, axis=1).max())
        found_at = judged(
            terms, pose, energy, energies, spread.joint_covariance, tracked[:n], moved_m
        )
    result = judged_result(
        model, Observation(frame.frame, frame.time_s), pose, found_at, spread.parameter_std,
        float(found.costs[n]) if seen else float("nan"),
        before.iterations + found.sweeps, energies,
    )  # fmt: skip
    return replace(result, views=frame.terms.views)
