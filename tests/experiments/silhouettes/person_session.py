"""The real person of pose2sim_body_4cam as a session: OpenPose joints in four cameras, whose calibration is off (its README)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from handtrack.bench.measuring import data_folder
from handtrack.capture.calibration.formats.read_calibration import read_calibration
from handtrack.capture.calibration.formats.settle import named
from handtrack.capture.calibration.rig_file import write_rig
from handtrack.model.model_file import load_model, write_scale
from handtrack.session.session import Session

DATA = "pose2sim_body_4cam"
CAMERAS = ("cam01", "cam02", "cam03", "cam04")
_UNIT_M = 1e-3  # of the calibration


def write_session(folder: Path, cameras: Sequence[str]) -> Session:
    """Write a session of the recording, seen by some of its cameras, into an empty folder; return it opened."""
    data = data_folder() / DATA
    file = data / "Calib.qca.txt"
    given, _ = named(read_calibration([file]), CAMERAS, str(file))
    write_rig(folder / "calibration.toml", given.rig(_UNIT_M))
    lines = ["[session]", "format = 1", 'name = "balancing"', "fps = 60.0", "", "[hand]"]
    lines += ['model = "body34"', 'scale = "body.json"']
    for name in cameras:
        (folder / "pose" / name).mkdir(parents=True)
        for file in (data / "pose" / f"{name}_json").glob("*.json"):
            (folder / "pose" / name / file.name).write_bytes(file.read_bytes())
        lines += ["", "[[camera]]", f'name = "{name}"']
        lines += [f'keypoints = "pose/{name}/*.json"', 'keypoint_layout = "body_25b"']
    (folder / "session.toml").write_text("\n".join(lines) + "\n")
    write_scale(folder / "body.json", load_model("body34").scale)
    return Session.open(folder)
