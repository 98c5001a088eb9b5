"""NWB with ndx-pose: joints for neuroscience archives. Written by pynwb."""

from __future__ import annotations

import re
import uuid
from datetime import UTC, datetime
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from handtrack.export.shown import joint_links
from handtrack.export.table import ArchiveMetadata, ResultsTable
from handtrack.files.atomic import replacing
from handtrack.session.tables import AXES
from handtrack.tracking.frame.result import is_length, joint_confidence


def write(path: Path, table: ResultsTable) -> None:
    """Write the joints as an ndx-pose `PoseEstimation` in the module `behavior` [m], with confidences, and the parameters with
    their standard deviations as TimeSeries [m, rad]; NaN in lost frames. `handtrack export --metadata` says of subject and session
    what archives ask for; without it the subject is a person of unknown age and sex, and the begin of the session is when its
    poses were written.
    """
    import h5py
    import ndx_pose  # pyright: ignore[reportMissingImports]
    import pynwb  # pyright: ignore[reportMissingImports]

    made: Any = ndx_pose  # its classes are made of a specification when it is imported: no type checker knows them
    whole: Any = pynwb
    track, sure = table.track, joint_confidence(table.track)
    times = _times(table)
    places = np.where(table.is_lost[:, None, None], np.nan, track.joint_positions)
    points = table.keypoint_definition
    series = [
        made.PoseEstimationSeries(
            name=name,
            description=f"{name.replace('_', ' ')} of the {track.side} hand or body, world frame; points: {points}",
            data=places[:, j],
            unit="meters",
            reference_frame=AXES,
            confidence=sure[:, j],
            confidence_definition="1 - P(error > 10 mm), 0 where the frame is lost",
            **times,
        )
        for j, name in enumerate(track.joint_names)
    ]
    links = np.array(joint_links(table.model), np.uint8).reshape(-1, 2)
    skeleton = made.Skeleton(name=track.model, nodes=list(track.joint_names), edges=links)
    estimate = made.PoseEstimation(
        name="PoseEstimation",
        pose_estimation_series=series,
        description=f"{track.model} ({track.side}) fitted to calibrated cameras; points: {points}",
        scorer="handtrack",
        source_software="handtrack",
        source_software_version=track.version,
        skeleton=skeleton,
    )
    file = _file(whole, table)
    module = file.create_processing_module("behavior", "poses by handtrack")
    module.add(made.Skeletons(skeletons=[skeleton]))
    module.add(estimate)
    lengths = np.array([is_length(name) for name in track.parameter_names])
    for unit, chosen in (("meters", lengths), ("radians", ~lengths)):
        names = ", ".join(n for n, own in zip(track.parameter_names, chosen, strict=True) if own)
        for kind, what, values in (
            ("parameters", "The model's parameters", track.parameters),
            (
                "parameters_std",
                "Standard deviations of the model's parameters",
                track.parameter_std,
            ),
        ):
            data = np.where(table.is_lost[:, None] | ~np.isfinite(values), np.nan, values)[
                :, chosen
            ]
            module.add(
                whole.TimeSeries(
                    name=f"{kind}_{unit}",
                    data=data,
                    unit=unit,
                    description=f"{what}, a column each: {names}",
                    **times,
                )
            )
    held = BytesIO()  # HDF5 itself may end the process where a disk is full
    with h5py.File(held, "w") as target, whole.NWBHDF5IO(file=target, mode="w") as writer:
        writer.write(file)
    with replacing(path) as part:
        part.write_bytes(held.getvalue())


def _times(table: ResultsTable) -> dict[str, Any]:
    """Return when samples were: a rate where it is one, else a time for each."""
    time_s = table.track.time_s
    steps = np.diff(time_s)
    if len(steps) and np.ptp(steps) < 1e-6 * steps.mean():
        return {"rate": float(1 / steps.mean()), "starting_time": float(time_s[0])}
    return {"timestamps": time_s}


def _file(whole: Any, table: ResultsTable) -> Any:
    said, track = table.metadata or ArchiveMetadata(), table.track
    begun = said.start or datetime.now(UTC)
    if said.start is None and Path(table.source).is_file():
        begun = datetime.fromtimestamp(Path(table.source).stat().st_mtime, UTC)
    if begun.tzinfo is None:
        begun = begun.replace(tzinfo=UTC)
    name = track.session or "recording"
    described = (
        said.description
        or f"{track.model} ({track.side}) in the recording {name}, tracked by handtrack."
    )
    subject = whole.file.Subject(
        subject_id=said.subject_id or re.sub(r"[^A-Za-z0-9-]+", "-", name).strip("-") or "subject",
        species=said.species,
        sex=said.sex,
        age=said.age,
        description="whose hand or body was tracked",
    )
    people = [said.experimenter] if said.experimenter else None
    return whole.NWBFile(
        session_description=described,
        experiment_description=described,
        identifier=str(uuid.uuid4()),
        session_id=re.sub(r"[^A-Za-z0-9-]+", "-", f"{name}-{track.frame[0]}-{track.frame[-1]}"),
        session_start_time=begun,
        experimenter=people,
        institution=said.institution or None,
        lab=said.lab or None,
        keywords=["hand", "pose", "kinematics"],
        subject=subject,
    )
