"""FrameResult: the pose found for one frame. TrackResult: those of a whole sequence, stacked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from enum import IntEnum
from functools import cached_property

import numpy as np

from handtrack.arrays import D2, D3, D4, D21, Array, B, F, Floats, Ints, J, K, L, N, S
from handtrack.errors import HandtrackError
from handtrack.model.articulated import FINGERS, JOINT_CENTRES, keypoint_names
from handtrack.tracking.frame.reason import Reason
from handtrack.tracking.frame.stacked import (
    stacked_alternatives,
    stacked_probabilities,
    stacked_reasons,
)
from handtrack.tracking.frame.tables.named_track import NamedTrack
from handtrack.tracking.frame.tables.track_model import model_of

PARTS = ("palm", *FINGERS)
"""of a hand, of which it is said how probably each is off"""

_STACKED = (
    "frame", "time_s", "parameters", "T_world_bone", "joint_positions", "keypoints21", "status",
    "energy", "iterations", "views", "parameter_std", "joint_covariance", "energies", "reason",
    "reason_kind", "reason_where", "reason_numbers", "p_off_25mm", "p_off_10mm",
    "hypothesis_parameters", "hypothesis_energy", "hypothesis_weight", "hypothesis_parent",
    "hypothesis_origin",
)  # fmt: skip
"""arrays of TrackResult with a row for each frame"""


class Status(IntEnum):
    """How far a frame's pose can be trusted, and where it comes from."""

    TRACKED = 0
    DOUBTFUL = 1
    LOST = 2
    KEYFRAME = 3
    INTERPOLATED = 4


@dataclass(frozen=True, eq=False)
class Alternative:
    """One of several poses that may be a frame's, where `tracker.hypotheses` is above 1."""

    parameters: Floats[S]
    """joint parameters [m, rad]"""
    energy: float
    weight: float
    """share of the posterior among the frame's hypotheses"""
    parent: int
    """which of the frame before's it continues; −1 in a first frame"""
    origin: str
    """how it was found: followed, or by which jump"""


@dataclass(frozen=True, eq=False, repr=False)
class FrameResult:
    """The pose of one frame, all of which is saved. A lost frame holds the last estimate, with infinite parameter_std."""

    frame: int
    time_s: float
    parameters: Floats[S]
    """joint parameters [m, rad], all of the model's, whatever the coupling."""
    status: Status
    energy: float
    """final cost; NaN where nothing was seen."""
    iterations: int
    parameter_std: Floats[S]
    """[m, rad]; infinite where unobservable."""
    joint_covariance: Floats[J, D3, D3]
    """[m²]."""
    T_world_bone: Floats[B, D4, D4]
    """bone → world."""
    joint_positions: Floats[J, D3]
    """world [m]."""
    keypoints21: Floats[D21, D3] | None
    """world [m]; hands only."""
    energies: Mapping[str, float] = field(default_factory=dict)
    """each term's part of the energy, by the term's name."""
    reason: Reason | None = None
    """why the frame is doubtful or lost."""
    p_off_25mm: float = float("nan")
    """probability that some joint is more than 25 mm off; NaN where nothing is said."""
    p_off_10mm: Floats[K] | None = None
    """that some joint of each of PARTS is more than 10 mm off; hands only."""
    views: int = 0
    """silhouettes, clouds and images that the energy is of; 0: not known."""
    alternatives: tuple[Alternative, ...] = ()
    """all poses carried on, heaviest first, where `tracker.hypotheses` is above 1; the first is this result's pose."""

    def __repr__(self) -> str:
        note = f": {self.note}" if self.note else ""
        return f"<FrameResult: frame {self.frame}, {self.status.name.lower()}{note}>"

    @property
    def note(self) -> str:
        """Why the frame is doubtful or lost, in words; empty where it is neither."""
        return "" if self.reason is None else self.reason.words

    @property
    def poor_cloud(self) -> bool:
        """Whether its cloud agreed with the hand so badly that the depths were doubted."""
        return self.reason is not None and self.reason.kind == "poor cloud"

    @property
    def is_simplified(self) -> bool:
        """Whether a simpler hand took the whole one's place, so that nothing is said of the fingers."""
        return self.poor_cloud and self.reason is not None and self.reason.part != ""

    @property
    def fits(self) -> bool:
        """Whether the pose explains what was seen, be it much or little: nothing is gained by looking for another."""
        if self.status == Status.TRACKED or self.is_unconfirmed:
            return True
        return self.is_open or self.is_odd or self.is_unlikely

    @property
    def is_unconfirmed(self) -> bool:
        """Whether it is doubtful only because the pose that tracking began with is."""
        return self.reason is not None and self.reason.kind == "start"

    @property
    def is_odd(self) -> bool:
        """Whether it is doubtful only because nobody has such a hand."""
        return self.reason is not None and self.reason.kind == "size"

    @property
    def is_unlikely(self) -> bool:
        """Whether it is doubtful only because it may well be off, for all that it fits."""
        return self.reason is not None and self.reason.kind in ("off", "far off")

    @property
    def is_open(self) -> bool:
        """Whether it is doubtful only because what was seen leaves the joints open."""
        return self.reason is not None and self.reason.kind == "open"


def unconfirmed(result: FrameResult, confidence: float) -> FrameResult:
    """Return a frame as doubtful for the pose that tracking began with. confidence: of that, 0 to 1."""
    return replace(result, status=Status.DOUBTFUL, reason=Reason("start", number=confidence))


@dataclass(frozen=True)
class TrackLabels:
    """What the numbers of a tracked sequence mean, and where they come from: the same for all its frames."""

    parameter_names: tuple[str, ...]
    bone_names: tuple[str, ...]
    joint_names: tuple[str, ...]
    model: str = ""
    side: str = ""
    scale: str = ""
    """JSON, as in TrackResult; so are the settings"""
    session: str = ""
    settings: str = ""
    version: str = ""
    start_confidence: float | None = None
    hand_length_mm: float | None = None
    hand_length_std_mm: float | None = None
    definition: str | None = None
    fps: float | None = None
    cameras: str | None = None
    refinement: str | None = None

    def track(self, frames: Sequence[FrameResult]) -> TrackResult:
        """Return frames as one result; see TrackResult.from_frames."""
        named = {entry.name: getattr(self, entry.name) for entry in fields(self)}
        return TrackResult.from_frames(frames, **named)


@dataclass(frozen=True, eq=False, repr=False)
class TrackResult(NamedTrack):
    """A tracked sequence of F frames in ascending order; the arrays of poses.npz (contracts §5)."""

    frame: Ints[F]
    time_s: Floats[F]
    """[s]"""
    parameter_names: tuple[str, ...]
    parameters: Floats[F, S]
    """[m, rad]"""
    bone_names: tuple[str, ...]
    T_world_bone: Floats[F, B, D4, D4]
    """bone → world"""
    joint_names: tuple[str, ...]
    joint_positions: Floats[F, J, D3]
    """world [m]"""
    keypoints21: Floats[F, D21, D3] | None
    """world [m]; hands only"""
    status: Ints[F]
    """values of Status"""
    energy: Floats[F]
    iterations: Ints[F]
    parameter_std: Floats[F, S]
    """[m, rad]"""
    joint_covariance: Floats[F, J, D3, D3]
    """[m²]"""
    model: str
    side: str
    scale: str
    """JSON: the hand's size, overall and by finger"""
    session: str
    settings: str
    """JSON: every setting by its dotted name"""
    version: str
    views: Ints[F] | None = None
    """silhouettes, clouds and images that each energy is of, 0 where not known; None where no frame's are"""
    energy_names: tuple[str, ...] | None = None
    """(T,) terms of the energy; None where they were not kept"""
    energies: Floats[F, L] | None = None
    """(F, T) each term's part of the energy, NaN where a frame has no such term"""
    reason: Array[F] | None = None
    """why a frame is doubtful or lost, in words"""
    reason_kind: Array[F] | None = None
    """the same as a key of reason.KINDS, with what follows"""
    reason_where: Array[F, D2] | None = None
    """part and camera, where the reason names them"""
    reason_numbers: Floats[F, D2] | None = None
    """numbers of the reason, NaN where it has none"""
    p_off_25mm: Floats[F] | None = None
    """probability that some joint is more than 25 mm off, NaN where nothing is said"""
    p_off_10mm: Floats[F, N] | None = None
    """(F, 6) that some joint of each part is more than 10 mm off"""
    part_names: tuple[str, ...] | None = None
    """(6,) PARTS"""
    hypothesis_parameters: Floats[F, K, S] | None = None
    """(F, H, S) joint parameters of the poses carried along, heaviest first; NaN beyond a frame's last one"""
    hypothesis_energy: Floats[F, K] | None = None
    """(F, H)"""
    hypothesis_weight: Floats[F, K] | None = None
    """(F, H) share of the posterior"""
    hypothesis_parent: Ints[F, K] | None = None
    """(F, H) which of the frame before's each continues; −1 in a first frame and beyond the last"""
    hypothesis_origin: Array[F, K] | None = None
    """(F, H) how each was found"""
    start_confidence: float | None = None
    """how sure the first pose was, 0 to 1, where the program found it"""
    hand_length_mm: float | None = None
    """from the wrist to the middle finger's tip, where the size was fitted"""
    hand_length_std_mm: float | None = None
    """its standard deviation"""
    refinement: str | None = None
    """JSON of `tracking.whole.refinement.Refinement`: what was found that all frames share"""
    definition: str | None = None
    """JSON of the model's definition: with side and scale the model can be built again"""
    fps: float | None = None
    """[1/s] of the recording; the median where frames have times of their own"""
    cameras: str | None = None
    """JSON: name, size, matrix, distortions, rotation, translation [m] of each, as calibration.toml has them"""
    take: int | None = None
    """number of the take in the session's store that it is"""
    pins: str | None = None
    """JSON, as the session's pins.json: where a person pointed at joints"""
    keypoint_definition: str | None = None
    """whose points `joint_positions` and `keypoints21` are, where `in_landmarks` was asked for others than the model's own"""

    @classmethod
    def from_frames(
        cls,
        frames: Sequence[FrameResult],
        *,
        parameter_names: Sequence[str],
        bone_names: Sequence[str],
        joint_names: Sequence[str],
        model: str = "",
        side: str = "",
        scale: str = "",
        session: str = "",
        settings: str = "",
        version: str = "",
        start_confidence: float | None = None,
        hand_length_mm: float | None = None,
        hand_length_std_mm: float | None = None,
        refinement: str | None = None,
        definition: str | None = None,
        fps: float | None = None,
        cameras: str | None = None,
    ) -> TrackResult:
        """Return the frames stacked. They are in ascending order, each once, and at least one."""
        numbers = np.array([f.frame for f in frames], dtype=np.int64)
        assert len(numbers), "no frames"
        assert (np.diff(numbers) > 0).all(), "frames must ascend, each once"
        names = (len(parameter_names), len(bone_names), len(joint_names))
        first = frames[0]
        found = (len(first.parameters), len(first.T_world_bone), len(first.joint_positions))
        assert found == names, f"{found} parameters, bones, joints; {names} names"
        terms = tuple(dict.fromkeys(name for f in frames for name in f.energies))
        parts = [[f.energies.get(name, np.nan) for name in terms] for f in frames]
        keypoints = [f.keypoints21 for f in frames if f.keypoints21 is not None]
        views = np.array([f.views for f in frames], dtype=np.int64)
        assert len(keypoints) in (0, len(frames)), "keypoints21 of some frames only"
        return cls(
            frame=numbers,
            time_s=np.array([f.time_s for f in frames], dtype=float),
            parameter_names=tuple(parameter_names),
            parameters=np.stack([f.parameters for f in frames]).astype(float),
            bone_names=tuple(bone_names),
            T_world_bone=np.stack([f.T_world_bone for f in frames]).astype(float),
            joint_names=tuple(joint_names),
            joint_positions=np.stack([f.joint_positions for f in frames]).astype(float),
            keypoints21=np.stack(keypoints).astype(float) if keypoints else None,
            status=np.array([int(f.status) for f in frames], dtype=np.int64),
            energy=np.array([f.energy for f in frames], dtype=float),
            iterations=np.array([f.iterations for f in frames], dtype=np.int64),
            parameter_std=np.stack([f.parameter_std for f in frames]).astype(float),
            joint_covariance=np.stack([f.joint_covariance for f in frames]).astype(float),
            model=model,
            side=side,
            scale=scale,
            session=session,
            settings=settings,
            version=version,
            start_confidence=start_confidence,
            hand_length_mm=hand_length_mm,
            hand_length_std_mm=hand_length_std_mm,
            refinement=refinement,
            definition=definition,
            fps=fps,
            cameras=cameras,
            views=views if views.any() else None,
            energy_names=terms or None,
            energies=np.array(parts, dtype=float) if terms else None,
            **stacked_reasons(frames),
            **stacked_probabilities(frames, PARTS),
            **stacked_alternatives(frames),
        )

    def __len__(self) -> int:
        return len(self.frame)

    def __getitem__(self, row: int) -> FrameResult:
        """Return the frame in a row, from 0 or from the end; `at` takes frame numbers."""
        return self._row(range(len(self))[row])

    def __repr__(self) -> str:
        counts = [(int((self.status == s).sum()), s.name.lower()) for s in Status]
        found = ", ".join(f"{count} {name}" for count, name in counts if count)
        what = " ".join(filter(None, (self.side, self.model)))
        return (
            f"<TrackResult: {len(self)} frames of {what or 'a model'}, {self.frame[0]} to {self.frame[-1]} ({found}); "
            f"{len(self.parameter_names)} parameters, {len(self.joint_names)} joints>"
        )

    @cached_property
    def landmark_definition(self) -> str | None:
        """Whose points `landmarks` are, such as `mediapipe21`; None where nobody knows where a detector sees this person's joints."""
        try:
            known = model_of(self).landmark_definitions
        except HandtrackError:  # of a program that does not say how its model is built
            return None
        return next((name for name in known if name != JOINT_CENTRES), None)

    @cached_property
    def landmarks(self) -> Floats[F, D21, D3] | None:
        """The keypoints as a detector or a marker set means them, world [m]: joint centres plus what was fitted beside them; hands only."""
        name = self.landmark_definition
        return None if name is None else self.in_landmarks(name).keypoints21

    @property
    def landmark_covariance(self) -> Floats[F, D21, D3, D3] | None:
        """[m²] of the landmarks: of their joints, on whose bones they are. With the pose alone unknown theirs is the same to a tenth
        (standard deviations, marked real hand); of the offset itself nothing is said.
        """
        if self.landmarks is None:
            return None
        return self.joint_covariance[:, [self.joint_names.index(n) for n in keypoint_names()]]

    def in_landmarks(self, definition: str, source: str = "this result") -> TrackResult:
        """Return the same with the points of another definition as joints and keypoints: `joints`, or `landmark_definition`.

        source: where it is from, for errors. Raises HandtrackError for a definition in which it has none.
        """
        if definition == (self.keypoint_definition or JOINT_CENTRES):
            return self
        model = model_of(self, source)
        known = model.landmark_definitions
        if definition not in known:
            raise HandtrackError(
                f"{source}: no landmarks '{definition}'; it has {' and '.join(known)}. Those of a detector are found where two "
                "cameras or more see its joints from different sides, or come with a person's saved hand."
            )
        T = self.T_world_bone[:, model.joint_bone]
        places = np.einsum("fjab,jb->fja", T[..., :3, :3], known[definition]) + T[..., :3, 3]
        rows = [self.joint_names.index(n) for n in keypoint_names() if n in self.joint_names]
        keypoints = None if self.keypoints21 is None else places[:, rows]
        return replace(
            self,
            joint_positions=places,
            keypoints21=keypoints,
            keypoint_definition=None if definition == JOINT_CENTRES else definition,
        )

    @property
    def labels(self) -> TrackLabels:
        """What its numbers mean, without the numbers."""
        return TrackLabels(
            **{entry.name: getattr(self, entry.name) for entry in fields(TrackLabels)}
        )

    def between(self, frames: range) -> TrackResult:
        """Return the part whose frame numbers lie in `frames`. HandtrackError when there is none."""
        rows = np.flatnonzero(np.isin(self.frame, np.asarray(frames)))
        if not len(rows):
            raise HandtrackError(
                f"no tracked frame between {frames.start} and {frames.stop - 1}; "
                f"this result has frames {self.frame[0]} to {self.frame[-1]}."
            )
        part = {name: getattr(self, name) for name in _STACKED}
        return replace(self, **{n: None if a is None else a[rows] for n, a in part.items()})

    def at(self, frame: int) -> FrameResult:
        """Return one frame, by its number. HandtrackError when it was not tracked."""
        rows = np.flatnonzero(self.frame == frame)
        if not len(rows):
            raise HandtrackError(
                f"frame {frame} was not tracked; this result has {len(self)} frames from "
                f"{self.frame[0]} to {self.frame[-1]}."
            )
        return self._row(int(rows[0]))

    def frames(self) -> list[FrameResult]:
        """Return every frame as an own result, as the tracker gave them."""
        return [self._row(row) for row in range(len(self))]

    def _row(self, row: int) -> FrameResult:
        return FrameResult(
            frame=int(self.frame[row]),
            time_s=float(self.time_s[row]),
            parameters=self.parameters[row].copy(),
            status=Status(int(self.status[row])),
            energy=float(self.energy[row]),
            iterations=int(self.iterations[row]),
            parameter_std=self.parameter_std[row].copy(),
            joint_covariance=self.joint_covariance[row].copy(),
            T_world_bone=self.T_world_bone[row].copy(),
            joint_positions=self.joint_positions[row].copy(),
            keypoints21=None if self.keypoints21 is None else self.keypoints21[row].copy(),
            energies=self._energies(row),
            reason=self._reason(row),
            p_off_25mm=np.nan if self.p_off_25mm is None else float(self.p_off_25mm[row]),
            p_off_10mm=self._parts_off(row),
            views=0 if self.views is None else int(self.views[row]),
            alternatives=self._alternatives(row),
        )

    def _energies(self, row: int) -> dict[str, float]:
        if self.energies is None or self.energy_names is None:
            return {}
        pairs = zip(self.energy_names, self.energies[row].tolist(), strict=True)
        return {name: value for name, value in pairs if np.isfinite(value)}

    def _parts_off(self, row: int) -> Floats | None:
        known = self.p_off_10mm is not None and np.isfinite(self.p_off_10mm[row]).all()
        return self.p_off_10mm[row].copy() if known and self.p_off_10mm is not None else None

    def _reason(self, row: int) -> Reason | None:
        if self.reason_kind is None or not self.reason_kind[row]:
            return None
        assert self.reason_where is not None and self.reason_numbers is not None
        part, camera = map(str, self.reason_where[row])
        number, other = map(float, self.reason_numbers[row])
        return Reason(str(self.reason_kind[row]), part, camera, number, other)

    def _alternatives(self, row: int) -> tuple[Alternative, ...]:
        if self.hypothesis_parameters is None:
            return ()
        assert self.hypothesis_energy is not None and self.hypothesis_weight is not None
        assert self.hypothesis_parent is not None and self.hypothesis_origin is not None
        return tuple(
            Alternative(
                self.hypothesis_parameters[row, h].copy(),
                float(self.hypothesis_energy[row, h]),
                float(self.hypothesis_weight[row, h]),
                int(self.hypothesis_parent[row, h]),
                str(self.hypothesis_origin[row, h]),
            )
            for h in np.flatnonzero(np.isfinite(self.hypothesis_weight[row]))
        )
