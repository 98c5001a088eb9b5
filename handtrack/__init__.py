"""handtrack: the full 3D pose of a hand, by fitting an articulated model to what calibrated cameras saw.

The names below are loaded when first used, so that `import handtrack` is quick. What each is for: docs/library.md.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from handtrack.capture.calibration.formats.read_cameras import read_cameras
    from handtrack.capture.clouds.point_cloud import PointCloud
    from handtrack.diagnostics.metrics import evaluate
    from handtrack.errors import HandtrackError
    from handtrack.export.tables.csv_wide import write_csv
    from handtrack.geometry.camera import Camera, CameraRig
    from handtrack.model.articulated import ArticulatedModel, HandScale
    from handtrack.model.model_file import load_model
    from handtrack.observation.observation import ImageKeypoints, Keypoints, Observation, Silhouette
    from handtrack.session.bundled import bundled_session
    from handtrack.session.formats.tables import read_npz, write_npz
    from handtrack.session.run import TrackingRun
    from handtrack.session.session import Session
    from handtrack.terms.joint_position_term import JointPositionTerm
    from handtrack.tracking.find_pose import FoundPose, find_pose
    from handtrack.tracking.frame.result import FrameResult, Status, TrackResult
    from handtrack.tracking.frame.settings import TrackerSettings
    from handtrack.tracking.state import TrackerState
    from handtrack.tracking.track import track
    from handtrack.tracking.tracker import Tracker

_MODULES = {
    "ArticulatedModel": "model.articulated",
    "Camera": "geometry.camera",
    "CameraRig": "geometry.camera",
    "FoundPose": "tracking.find_pose",
    "FrameResult": "tracking.frame.result",
    "HandScale": "model.articulated",
    "HandtrackError": "errors",
    "ImageKeypoints": "observation.observation",
    "JointPositionTerm": "terms.joint_position_term",
    "Keypoints": "observation.observation",
    "Observation": "observation.observation",
    "PointCloud": "capture.clouds.point_cloud",
    "Session": "session.session",
    "Silhouette": "observation.observation",
    "Status": "tracking.frame.result",
    "TrackResult": "tracking.frame.result",
    "Tracker": "tracking.tracker",
    "TrackerSettings": "tracking.frame.settings",
    "TrackerState": "tracking.state",
    "TrackingRun": "session.run",
    "bundled_session": "session.bundled",
    "evaluate": "diagnostics.metrics",
    "find_pose": "tracking.find_pose",
    "load_model": "model.model_file",
    "read_cameras": "capture.calibration.formats.read_cameras",
    "read_npz": "session.formats.tables",
    "track": "tracking.track",
    "write_csv": "export.tables.csv_wide",
    "write_npz": "session.formats.tables",
}

__all__ = [
    "ArticulatedModel",
    "Camera",
    "CameraRig",
    "FoundPose",
    "FrameResult",
    "HandScale",
    "HandtrackError",
    "ImageKeypoints",
    "JointPositionTerm",
    "Keypoints",
    "Observation",
    "PointCloud",
    "Session",
    "Silhouette",
    "Status",
    "TrackResult",
    "Tracker",
    "TrackerSettings",
    "TrackerState",
    "TrackingRun",
    "bundled_session",
    "evaluate",
    "find_pose",
    "load_model",
    "read_cameras",
    "read_npz",
    "track",
    "write_csv",
    "write_npz",
]


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module 'handtrack' has no attribute '{name}'")
    value = getattr(import_module(f"handtrack.{_MODULES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
