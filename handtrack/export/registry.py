"""All formats a tracked sequence can be written in: what each is called and for, and where it is written."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from handtrack.errors import HandtrackError, unknown_name

if TYPE_CHECKING:  # the list alone is wanted by the page, which solves nothing
    from handtrack.export.table import ResultsTable

Write = Callable[[Path, "ResultsTable"], list[Path] | None]
"""writes a file, and those that belong to it beside; returns the latter, if there are any. Raises HandtrackError."""


AXES = ("x", "y", "z", "-x", "-y", "-z")
"""of the world, one of which points up: nobody can tell from a calibration which"""


@dataclass(frozen=True)
class ExportFormat:
    """One way in which results leave."""

    name: str
    """of `handtrack export --to`"""
    ending: str
    """of the default file name, after that of poses.npz"""
    purpose: str
    """what it is for, in a sentence"""
    group: str
    """of formats for like programs"""
    units: str
    """of lengths and angles; empty: it holds none"""
    module: str
    """below handtrack.export; it has `write`, or the function named behind a colon"""
    needs: tuple[str, ...] = ()
    """packages that are not installed with handtrack"""
    has_parts: bool = False
    """whether the files beside it are needed, and do not merely explain it"""
    up: str = ""
    """the axis that its readers take for up, one of AXES; empty: they ask for none"""
    one_skeleton: bool = False
    """whether all frames share one skeleton, which angles move: takes of hands of different sizes do not fit into it"""

    @property
    def suffix(self) -> str:
        """The file's suffix, whatever it is called."""
        return Path(f"poses{self.ending}").suffix

    def write(
        self, path: Path, table: ResultsTable, up: str = "", landmarks: str = ""
    ) -> list[Path]:
        """Write the file and what belongs to it; return them.

        Parameters
        ----------
        up
            Which axis of the recording's world points up, one of AXES: the world is turned so that
            it does for those who read the file. Empty: nothing is turned.
        landmarks
            The definition in which joints and keypoints are written, as `TrackResult.in_landmarks`
            takes it. Empty: as the table has them.

        Raises
        ------
        HandtrackError
        """
        missing = [name for name in self.needs if find_spec(name.replace("-", "_")) is None]
        if missing:
            raise HandtrackError(
                f"--to {self.name}: needs {' and '.join(missing)}, which is not installed. Install with `pip install "
                f"{' '.join(missing)}`, or choose another format."
            )
        if landmarks:
            from handtrack.model.articulated import JOINT_CENTRES

            if self.one_skeleton and landmarks != JOINT_CENTRES:
                pointed = ", ".join(known.name for known in FORMATS if not known.one_skeleton)
                raise HandtrackError(
                    f"--landmarks {landmarks}: {self.name} holds a skeleton, whose joints are the model's own. Formats that hold points: "
                    f"{pointed}. Leave out --landmarks."
                )
            table = replace(table, track=table.track.in_landmarks(landmarks, table.source))
        if up:
            from handtrack.export.table import upright

            if not self.up:
                turned = ", ".join(known.name for known in FORMATS if known.up)
                raise HandtrackError(
                    f"--up {up}: {self.name} keeps the world's axes, as the calibration has them: its readers ask for none that points "
                    f"up. Those that do: {turned}. Leave out --up."
                )
            table = replace(table, track=upright(table.track, up, self.up))
        module, _, function = self.module.partition(":")
        write: Write = getattr(import_module(f"handtrack.export.{module}"), function or "write")
        return [path, *(write(path, table) or ())]


FORMATS: tuple[ExportFormat, ...] = (
    ExportFormat(
        "csv",
        ".csv",
        "Joint angles and positions, a row a frame, for spreadsheets.",
        "Spreadsheets and statistics",
        "m, °",
        "tables_and_arrays:write_wide",
    ),
    ExportFormat(
        "csv-long",
        "_long.csv",
        "Tidy tables for statistics (R, pandas): joints, angles (handtrack's and ISB's) and bones' quaternions, with standard deviations.",
        "Spreadsheets and statistics",
        "m, °",
        "tables_and_arrays:write_long",
        has_parts=True,
    ),
    ExportFormat(
        "npz",
        "_export.npz",
        "Everything, for Python and NumPy.",
        "Python, MATLAB and R",
        "m, rad",
        "tables_and_arrays:write_result",
    ),
    ExportFormat(
        "keypoints",
        "_keypoints.npz",
        "Joint positions alone, in the form of a session's truth.npz.",
        "Python, MATLAB and R",
        "m",
        "tables_and_arrays:write_keypoints",
    ),
    ExportFormat(
        "openpose",
        "_openpose.json",
        "Keypoints in space in OpenPose's order (hands 21, bodies BODY_25), all frames in one file.",
        "Keypoints of detectors",
        "m",
        "openpose",
    ),
    ExportFormat(
        "openpose-files",
        "_openpose.zip",
        "The same as OpenPose's own folder of JSON, a file a frame, zipped.",
        "Keypoints of detectors",
        "m",
        "openpose:write_files",
    ),
    ExportFormat(
        "mediapipe",
        "_mediapipe.json",
        "Landmarks in MediaPipe's order (hands 21, bodies 33), all frames in one file.",
        "Keypoints of detectors",
        "m",
        "openpose:write_mediapipe",
    ),
    ExportFormat(
        "pose",
        ".pose",
        "MediaPipe's points in space for sign language research, which pose-format reads.",
        "Keypoints of detectors",
        "mm",
        "openpose:write_pose",
        ("pose-format",),
        up="-y",
    ),
    ExportFormat(
        "bvh",
        ".bvh",
        "An animated skeleton for Blender, Maya, MotionBuilder.",
        "Animation",
        "cm, °",
        "motion:write_bvh",
        one_skeleton=True,
        up="y",
    ),
    ExportFormat(
        "bvh-humanik",
        "_humanik.bvh",
        "The same with HumanIK's bone names, as MotionBuilder, Maya and Mixamo's tools know them.",
        "Animation",
        "cm, °",
        "motion:write_humanik",
        one_skeleton=True,
        up="y",
    ),
    ExportFormat(
        "glb",
        ".glb",
        "A skinned, animated mesh for Blender, game engines and viewers on the web.",
        "Animation",
        "m",
        "shown:write_glb",
        one_skeleton=True,
        up="y",
    ),
    ExportFormat(
        "trc",
        ".trc",
        "Joints as markers for OpenSim and Pose2Sim.",
        "Biomechanics",
        "mm",
        "motion:write_trc",
        up="y",
    ),
    ExportFormat(
        "mot",
        ".mot",
        "Joint angles as motion of the OpenSim model that `--to osim` writes.",
        "Biomechanics",
        "m, °",
        "motion:write_mot",
        one_skeleton=True,
        up="y",
    ),
    ExportFormat(
        "osim",
        ".osim",
        "The model itself for OpenSim: bones, joints with limits, markers; an inverse kinematics set-up with marker weights beside.",
        "Biomechanics",
        "m, rad",
        "motion:write_osim",
        one_skeleton=True,
    ),
    ExportFormat(
        "c3d",
        ".c3d",
        "Joints as markers for motion capture programs (Vicon Nexus, Visual3D, Mokka).",
        "Biomechanics",
        "mm",
        "motion:write_c3d",
        ("ezc3d",),
        up="z",
    ),
    ExportFormat(
        "urdf",
        ".urdf",
        "The model as a robot for ROS, MuJoCo, Isaac; joint states in a CSV file beside.",
        "Robotics",
        "m, rad",
        "motion:write_urdf",
        has_parts=True,
        one_skeleton=True,
        up="z",
    ),
    ExportFormat(
        "mcap",
        ".mcap",
        "Joint states, /tf and the robot's description as ROS 2 messages, for Foxglove, RViz and `ros2 bag`.",
        "Robotics",
        "m, rad",
        "motion:write_mcap",
        ("mcap",),
        one_skeleton=True,
        up="z",
    ),
    ExportFormat(
        "mano",
        "_mano.npz",
        "Shape and pose of your own MANO model, for machine learning (--mano FILE).",
        "Keypoints of detectors",
        "m, rad",
        "mano",
    ),
    ExportFormat(
        "anipose",
        "_anipose.csv",
        "Joints as Anipose's 3D table; `movement` reads it.",
        "Neuroscience",
        "mm",
        "tables_and_arrays:write_anipose",
    ),
    ExportFormat(
        "netcdf",
        ".nc",
        "Labelled arrays with units and standard deviations, for xarray, MATLAB, R.",
        "Python, MATLAB and R",
        "m, rad",
        "tables_and_arrays:write_netcdf",
    ),
    ExportFormat(
        "nwb",
        ".nwb",
        "Joints and angles for neuroscience archives: Neurodata Without Borders with ndx-pose.",
        "Neuroscience",
        "m, rad",
        "nwb",
        ("pynwb", "ndx-pose"),
    ),
    ExportFormat(
        "mp4",
        ".mp4",
        "The model drawn over every camera's images, as a film.",
        "Films and reports",
        "",
        "shown:write_film",
    ),
    ExportFormat(
        "html",
        ".html",
        "The moving skeleton in one file that any browser plays without network.",
        "Films and reports",
        "",
        "shown:write_playback",
    ),
    ExportFormat(
        "report",
        "_report.html",
        "A page on the tracking: status, confidence, curves.",
        "Films and reports",
        "",
        "shown:write_report",
    ),
)


def export_format(name: str) -> ExportFormat:
    """Return a format by its name. Raises HandtrackError naming the known ones."""
    for known in FORMATS:
        if known.name == name:
            return known
    raise unknown_name("format", name, [known.name for known in FORMATS], "--to")
