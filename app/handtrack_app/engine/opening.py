"""Opening a session for the workbench: the copy to work in, where the model first stands, what is missing to track."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from handtrack.arrays import D3, Floats, P
from handtrack.errors import HandtrackError
from handtrack.geometry.camera import Camera
from handtrack.geometry.rotation import rotation_vector
from handtrack.model.articulated import keypoint_names
from handtrack.observation.observation import Keypoints
from handtrack.session.first_pose import FirstPose
from handtrack.session.layout import TRACKS_FOLDER
from handtrack.session.run import TrackingRun
from handtrack.session.session import Session
from handtrack.session.sources.video_audits import count_beside
from handtrack.store.store import Store
from handtrack.tracking.search.keypoint_start import FEWEST, placed_on_points
from handtrack_app.engine.document import Document
from handtrack_app.engine.document_snapshots import observed_kinds
from handtrack_app.engine.persistence import show_track_file
from handtrack_app.protocol import IMAGES

# the share of points that are nearest, and how far behind them a hand may reach
_NEAR, _DEEP_M = (0.02, 0.15)


def preview(session: Session) -> Document:
    """Return a document to be looked at, its hand laid where the first pose is about, with a track that no workbench has opened yet.
    Raises HandtrackError.

    Nothing is searched or fitted, and no image is read.
    """
    run = TrackingRun.open(session, {}, use_init=False)
    frame, params = near_first_pose(run, session.init)
    shown = Document(run, frame, params)
    if not list(Store(session.folder / TRACKS_FOLDER).takes()):
        show_track_file(shown)
    return shown


def document(session: Session) -> Document:
    """Return the document of a session, its first pose fitted to what was given. Raises HandtrackError.

    Fitting the hand's size takes long, and posing needs none: it waits until something is tracked.
    """
    run = TrackingRun.open(session, {"model.fit_size": False})
    wanted = session.settings.model.fit_size
    run = run.with_values({"model.fit_size": wanted})
    pending = run.sizes_first
    if run.first is None:
        middle = _middle_of_cloud(session)
        return Document(run, 0, placed_in_view(run, middle), pending)
    frame, params = run.initial()
    return Document(run, frame, params, pending)


def opened(folder: Path) -> Session:
    """Return a session whose videos are being counted. Raises HandtrackError also for one without frames."""
    session = Session.open(folder)
    session.check_frames()
    count_beside(session.folder, session.videos)
    return session


def near_first_pose(run: TrackingRun, first: FirstPose | None) -> tuple[int, Floats[P]]:
    """Return a first pose's frame, and solver parameters of the hand about there: by its parameters as far as the model
    has them, relaxed and laid on its points in space, or relaxed where the cameras look.
    """
    frame, model = 0 if first is None else first.frame, run.model
    if first is not None and first.xyz is not None and model.has_keypoints21:
        observed = Keypoints(
            keypoint_names(), first.xyz, 1.0
        )  # [m] how sure they are counts for nothing
        if np.isfinite(first.xyz).all(axis=1).sum() >= FEWEST:
            return frame, model.clipped(placed_on_points(model, observed, model.rest))
    if first is not None and first.parameters:
        known = {n: v for n, v in first.parameters.items() if n in model.parameter_names}
        return frame, model.params_from(known, nearest=True)
    return frame, placed_in_view(run)


def placed_in_view(run: TrackingRun, centre: Floats[D3] | None = None) -> Floats[P]:
    """Return solver parameters of the relaxed hand around a point, or where the cameras look, its back to the first one."""
    cameras = list(run.session.rig.cameras)
    if centre is None:
        centre = _scene_centre(cameras)
    first = cameras[0]
    up, forward = -first.rotation[1], first.rotation[2]
    # +y up, back of the hand to the camera
    turn = np.stack([np.cross(up, -forward), up, -forward], axis=1)
    joint = run.model.rest.copy()
    joint[3:6] = rotation_vector(turn)
    joint[:3] = centre - 0.09 * up  # the wrist, half a hand below
    return run.model.clipped(run.model.transform.solver_params(joint))


def _scene_centre(cameras: Sequence[Camera]) -> Floats[D3]:
    """Return the point nearest to all optical axes, world [m]; for one camera, half a metre before it."""
    system, right = 1e-3 * np.eye(3), np.zeros(3)
    for camera in cameras:
        centre, axis = camera.centre, camera.rotation[2]
        across = np.eye(3) - np.outer(axis, axis)
        system += across
        right += across @ centre + 1e-3 * (centre + 0.5 * axis) / len(cameras)
    return np.asarray(np.linalg.solve(system, right), dtype=float)


def _middle_of_cloud(session: Session) -> Floats[D3] | None:
    """Return the middle [m] of what is nearest to the cameras in the first cloud; None without one."""
    if not session.has_clouds:
        return None
    try:
        cloud = session.cloud(session.known_frames.start)[0]
    except HandtrackError:  # said when the cloud is shown; the hand stands elsewhere till then
        return None
    if cloud is None or not len(cloud):
        return None
    points, centres = cloud.points, session.cloud_camera_centres
    if centres is not None and len(centres):
        away = np.linalg.norm(points[:, None] - centres, axis=2).min(axis=1)
        points = points[away <= np.quantile(away, _NEAR) + _DEEP_M]
    return np.median(points, axis=0)


_BY_HAND = (
    "go to a frame that shows the {kind} well, and turn the {kind} by the arcs of its handle. Open a camera view (key 1), drag the "
    "{middle} onto the picture, and press 'Fit frame' (F), then 'Save as first-frame pose'. '{pose} as' has other poses to begin with."
)
NO_POSE = {
    "hand": "Press 'Detect hand' at the timeline, or in the tab Pose. Or pose it: "
    + _BY_HAND.format(kind="hand", middle="palm", pose="Fingers"),
    "body": "Press 'Detect body' at the timeline, if the recording has detected joints. Or pose it: "
    + _BY_HAND.format(kind="body", middle="trunk", pose="Pose"),
}
"""what to do where nobody said where the hand or the body is, by kind of model"""

_NOTHING = (
    "There is nothing to fit the {kind} to yet: this session has neither masks nor clouds. In the tab Cloud, match a pair of "
    "cameras ('Clouds from this pair'); or give the cameras masks in session.toml, a folder of files or a method such as "
    "'skin_ycrcb', and open it again. Edges of the images, with a first pose, do without both (tab Settings, Weights)."
)


def nothing_observed(run: TrackingRun) -> str:
    """Return what to do about a session in which nothing is observed; empty where something is."""
    if run.settings.uses_images or observed_kinds(run.session) - {IMAGES}:
        return ""
    return _NOTHING.format(kind=run.model.kind)
