"""FrameResult: the pose found for one frame. TrackResult: those of a whole sequence, stacked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import IntEnum

import numpy as np

from handtrack.arrays import Floats, Ints
from handtrack.errors import HandtrackError
from handtrack.sampling.hypotheses import Hypothesis

_STACKED = (
    "frame",
    "time_s",
    "parameters",
    "T_world_bone",
    "joint_positions",
    "keypoints21",
    "status",
    "energy",
    "iterations",
    "parameter_std",
    "joint_covariance",
    "energies",
)


class Status(IntEnum):
    """How far a frame's pose can be trusted, and where it comes from."""

    TRACKED = 0
    DOUBTFUL = 1
    LOST = 2
    KEYFRAME = 3
    INTERPOLATED = 4


@dataclass(frozen=True, eq=False)
class FrameResult:
    """The pose of one frame. A lost frame holds the last estimate, with infinite parameter_std."""

    frame: int
    time_s: float
    parameters: Floats
    """(S,) joint parameters [m, rad], all of the model's, whatever the coupling."""
    status: Status
    energy: float
    """final cost; NaN where nothing was seen."""
    iterations: int
    parameter_std: Floats
    """(S,) [m, rad]; infinite where unobservable."""
    joint_covariance: Floats
    """(J, 3, 3) [m²]."""
    T_world_bone: Floats
    """(B, 4, 4) bone → world."""
    joint_positions: Floats
    """(J, 3) world [m]."""
    keypoints21: Floats | None
    """(21, 3) world [m]; hands only."""
    note: str = ""
    """why the frame is doubtful or lost, in words; not saved in poses.npz."""
    covariance: Floats | None = None
    """(P, P) of the solver parameters, which the next frame's prediction inherits; not saved in poses.npz."""
    unknown: bool = False
    """whether it is doubtful only because what was seen leaves the joints open; not saved in poses.npz."""
    poor_cloud: bool = False
    """whether its cloud agreed with the hand so badly that the depths were doubted; not saved in poses.npz."""
    energies: Mapping[str, float] = field(default_factory=dict)
    """each term's part of the energy, by the term's name."""
    hypotheses: tuple[Hypothesis, ...] = ()
    """all poses carried on, heaviest first, where `tracker.hypotheses` is above 1; the first is this result's pose."""
    parents: tuple[int, ...] = ()
    """which of the last frame's hypotheses each of them continues; −1 in a first frame."""

    @property
    def fits(self) -> bool:
        """Whether the pose explains what was seen, be it much or little: nothing is gained by looking for another."""
        return self.status == Status.TRACKED or self.unknown


@dataclass(frozen=True, eq=False)
class TrackResult:
    """A tracked sequence of F frames in ascending order; the arrays of poses.npz (contracts §5)."""

    frame: Ints
    """(F,)"""
    time_s: Floats
    """(F,) [s]"""
    parameter_names: tuple[str, ...]
    parameters: Floats
    """(F, S) [m, rad]"""
    bone_names: tuple[str, ...]
    T_world_bone: Floats
    """(F, B, 4, 4) bone → world"""
    joint_names: tuple[str, ...]
    joint_positions: Floats
    """(F, J, 3) world [m]"""
    keypoints21: Floats | None
    """(F, 21, 3) world [m]; hands only"""
    status: Ints
    """(F,) values of Status"""
    energy: Floats
    """(F,)"""
    iterations: Ints
    """(F,)"""
    parameter_std: Floats
    """(F, S) [m, rad]"""
    joint_covariance: Floats
    """(F, J, 3, 3) [m²]"""
    model: str
    side: str
    scale: str
    """JSON: the hand's size, overall and by finger"""
    session: str
    settings: str
    """JSON: every setting by its dotted name"""
    version: str
    energy_names: tuple[str, ...] | None = None
    """(T,) terms of the energy; None where they were not kept"""
    energies: Floats | None = None
    """(F, T) each term's part of the energy, NaN where a frame has no such term"""

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
            energy_names=terms or None,
            energies=np.array(parts, dtype=float) if terms else None,
        )

    def __len__(self) -> int:
        return len(self.frame)

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
        )

    def _energies(self, row: int) -> dict[str, float]:
        if self.energies is None or self.energy_names is None:
            return {}
        pairs = zip(self.energy_names, self.energies[row].tolist(), strict=True)
        return {name: value for name, value in pairs if np.isfinite(value)}
