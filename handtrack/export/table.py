"""ResultsTable: a tracked sequence and the model it is of, as every format is written from; and the world turned as a format's readers take it to stand."""

from __future__ import annotations

from dataclasses import dataclass, replace
from datetime import datetime
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from handtrack.arrays import D3, Array, F, Floats, J, array_dataclass
from handtrack.capture.calibration.rig_file import rig_from_json
from handtrack.errors import unknown_name
from handtrack.export.registry import AXES
from handtrack.files.toml_table import one_of, read_table, read_toml
from handtrack.geometry.camera import CameraRig
from handtrack.geometry.rotation import rotation_matrix, rotation_vector
from handtrack.model.articulated import JOINT_CENTRES, ArticulatedModel
from handtrack.session.tables import read_npz
from handtrack.tracking.frame.result import COLUMNS, Status, TrackResult, frame_rate, model_of


@dataclass(frozen=True)
class ArchiveMetadata:
    """What an archive (NWB, DANDI) asks of a recording and its subject, and no tracking knows."""

    subject_id: str = ""
    species: str = "Homo sapiens"
    sex: Annotated[str, one_of(("M", "F", "U", "O"))] = "U"
    """male, female, unknown or other"""
    age: str = "P0Y/"
    """ISO 8601, such as P31Y; a range as P18Y/P90Y, here: of any age"""
    start: datetime | None = None
    """when the recording began, with its time zone"""
    description: str = ""
    experimenter: str = ""
    institution: str = ""
    lab: str = ""

    @classmethod
    def read(cls, path: Path) -> ArchiveMetadata:
        """Return what a TOML file with these keys says. Raises HandtrackError."""
        return read_table(cls, read_toml(path, "metadata for archives"), str(path))


@array_dataclass
class ResultsTable:
    """A tracked sequence with what its numbers mean. World frame, metres, radians, seconds, as in poses.npz."""

    track: TrackResult
    source: str = "this result"
    """where it is from, for errors"""
    session_folder: Path | None = None
    """where its images are; None: not known"""
    metadata: ArchiveMetadata | None = None
    """what archives ask of the recording; None: nobody said it"""
    mano: Path | None = None
    """a user's own MANO model, which the format mano fits"""

    @classmethod
    def read(cls, path: Path | str, session_folder: Path | None = None) -> ResultsTable:
        """Return the table of a poses.npz. Raises HandtrackError saying what is wrong with it."""
        return cls(read_npz(path), str(path), session_folder)

    @cached_property
    def model(self) -> ArticulatedModel:
        """The model as large as it was tracked. Raises HandtrackError where the file does not say how it is built."""
        return model_of(self.track, self.source)

    @cached_property
    def rig(self) -> CameraRig | None:
        """The cameras; None where the file does not have them (format 1)."""
        text = self.track.cameras
        return None if text is None else rig_from_json(text, f"{self.source}: cameras")

    @property
    def fps(self) -> float:
        """Frames a second of the recording; of its times where it was not kept."""
        return frame_rate(self.track)

    @property
    def keypoint_definition(self) -> str:
        """Whose points the joints and keypoints are: `joints`, the model's own, or a detector's or marker set's."""
        return self.track.keypoint_definition or JOINT_CENTRES

    @property
    def is_lost(self) -> Array[F]:
        """Whether a frame holds nothing but the last estimate."""
        return self.track.status == Status.LOST

    @property
    def joint_std(self) -> Floats[F, J, D3]:
        """Standard deviation of each joint along the world's axes [m]."""
        spread = np.diagonal(self.track.joint_covariance, axis1=2, axis2=3)
        return np.sqrt(np.maximum(spread, 0.0))

    @cached_property
    def without_gaps(self) -> ResultsTable:
        """The table with every frame number from the first to the last: those that were not tracked are lost ones that hold the
        pose before. For formats that have a rate and no frame numbers.
        """
        track = self.track
        frames = np.arange(track.frame[0], track.frame[-1] + 1)
        if len(frames) == len(track):
            return self
        held = np.searchsorted(track.frame, frames, side="right") - 1
        new = track.frame[held] != frames
        changed: dict[str, Any] = {}
        for name, column in COLUMNS.items():
            array = getattr(track, name)
            if column.gaps == "dropped":
                changed |= {name: None} | ({column.names: None} if column.names else {})
            elif array is not None:
                changed[name] = array[held]
                if column.gaps == "missing":
                    changed[name][new] = column.missing
        changed["frame"], changed["status"][new] = frames, int(Status.LOST)
        changed["time_s"][new] = np.interp(frames[new], track.frame, track.time_s)
        filled = replace(track, **changed)
        return replace(self, track=filled)

    @cached_property
    def misfit_m(self) -> float:
        """How far the model, posed by the parameters, has some joint from where the file has it [m]: takes of hands of different
        sizes may be one track, and formats with one skeleton for all frames have it so far off.
        """
        transform = self.model.transform
        posed = [
            self.model.joint_positions(self.model.bones(transform.solver_params(values)))
            for values in self.track.parameters
        ]
        return float(np.linalg.norm(np.stack(posed) - self.track.joint_positions, axis=2).max())


# ---- A sequence in a world that stands as the readers take it to stand


def axis(name: str) -> Floats[D3]:
    """Return the direction of one of AXES. Raises HandtrackError naming them."""
    if name not in AXES:
        raise unknown_name("axis", name, AXES, "--up")
    return (-1.0 if name.startswith("-") else 1.0) * np.eye(3)["xyz".index(name[-1])]


def turn_between(up: str, wanted: str) -> Floats[D3, D3]:
    """Return the turn that brings an axis of AXES to another on the short way; about x or y where they are opposite, as from a camera's
    axes (x right, y down) to a screen's.
    """
    start, end = axis(up), axis(wanted)
    if start @ end == 0.0:
        about = np.cross(start, end)
        return np.outer(about, about) + np.outer(end, start) - np.outer(start, end)
    kept = np.eye(3)[1 if up[-1] == "x" else 0]
    return np.eye(3) if start @ end > 0 else 2.0 * np.outer(kept, kept) - np.eye(3)


def upright(track: TrackResult, up: str, wanted: str) -> TrackResult:
    """Return the sequence with the world turned so that what is up points along `wanted`.

    Poses, joints, their covariance and the root's parameters; what else is of the world (cameras, pins, other hypotheses, the
    root's standard deviations) is left out or unknown.
    """
    turn = turn_between(up, wanted)
    arrays = {name: getattr(track, name) for name in COLUMNS}
    changed = {name: COLUMNS[name].turned(a, turn) for name, a in arrays.items() if a is not None}
    parameters, std = track.parameters.copy(), track.parameter_std.copy()
    parameters[:, :3] = parameters[:, :3] @ turn.T
    parameters[:, 3:6] = rotation_vector(turn @ rotation_matrix(track.parameters[:, 3:6]))
    std[:, :6] = np.nan
    changed |= {"parameters": parameters, "parameter_std": std, "cameras": None, "pins": None}
    return replace(track, **changed)
