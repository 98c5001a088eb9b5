"""Opening a session for the workbench: the copy to work in, where the model first stands, what is missing to track."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from handtrack.arrays import Floats, P
from handtrack.errors import HandtrackError
from handtrack.geometry.rotation import rotation_vector
from handtrack.session import bundled
from handtrack.session.layout import INIT_FILE, SESSION_FILE, TRUTH_FILE
from handtrack.session.run import TrackingRun
from handtrack.session.session import Session
from handtrack.session.video_audits import count_beside
from handtrack_app.engine.document import Document
from handtrack_app.engine.document_snapshots import scene_centre
from handtrack_app.engine.run import Run

# the share of points that are nearest, and how far behind them a hand may reach
_NEAR, _DEEP_M = (0.02, 0.15)


def open_document(folder: Path, overrides: Mapping[str, object]) -> Document:
    """Return the document of a session folder. Raises HandtrackError.

    Fitting the hand's size takes long, and posing needs none: it waits until something is tracked.
    """
    session = Session.open(folder)
    count_beside(session.folder, session.videos)
    run = TrackingRun.open(session, {**overrides, "model.fit_size": False})
    wanted = session.settings.model.fit_size
    run = run.with_values({"model.fit_size": wanted})
    pending = wanted and session.hand_scale == "fit"
    if run.first is None:
        return Document(run, 0, placed_in_view(run), pending)
    frame, params = run.initial()
    return Document(run, frame, params, pending)


def placed_in_view(run: TrackingRun) -> Floats[P]:
    """Return solver parameters of the relaxed hand in the first frame's cloud, or where the cameras look, its back to
    the first one.
    """
    cameras = list(run.session.rig.cameras)
    centre = _middle_of_cloud(run.session)
    if centre is None:
        centre = scene_centre(cameras)
    first = cameras[0]
    up, forward = -first.rotation[1], first.rotation[2]
    # +y up, back of the hand to the camera
    turn = np.stack([np.cross(up, -forward), up, -forward], axis=1)
    joint = run.model.rest.copy()
    joint[3:6] = rotation_vector(turn)
    joint[:3] = centre - 0.09 * up  # the wrist, half a hand below
    return run.model.clipped(run.model.transform.solver_params(joint))


def _middle_of_cloud(session: Session) -> Floats | None:
    """Return the middle (3,) [m] of what is nearest to the cameras in the first cloud; None without one."""
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


def working_folder(folder: Path) -> Path:
    """Return the folder to work in: a copy in the user's data folder for a recording that lies in a checkout.

    The copy's name carries a stamp of the recording, so that a changed recording gets a new one. An installed
    program's bundled session is such a copy already; any other folder is returned as it is.
    """
    source = Path(folder).resolve()
    if source.parent != bundled.checkout_shelf():
        return Path(folder)
    stamp = hashlib.sha256()
    for name in (SESSION_FILE, INIT_FILE, TRUTH_FILE):
        if (source / name).is_file():
            stamp.update((source / name).read_bytes())
    return bundled.working_copy(source, f"{source.name}-{stamp.hexdigest()[:8]}")


_NOTHING = (
    "Nothing tells where the {kind} is yet: this session has neither masks nor clouds. In the tab Cloud, match a pair of "
    "cameras ('Clouds from this pair'); or give the cameras masks in session.toml, a folder of files or a method such as "
    "'skin_ycrcb', and open it again. Edges of the images, with a first pose, do without both (tab Settings, Weights)."
)


def nothing_seen(run: Run) -> str:
    """Return what to do about a session in which nothing is observed; empty where something is."""
    session, settings = run.session, run.settings
    if session.has_clouds or settings.looks_at_images:
        return ""
    cameras = [view.settings for view in session.views]
    if any(camera.masks is not None or camera.keypoints is not None for camera in cameras):
        return ""
    return _NOTHING.format(kind=run.model.kind)
