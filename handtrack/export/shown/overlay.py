"""MP4: the model's outline and joints drawn over every camera's images, side by side."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from handtrack.arrays import D3, Array, Floats, H, J, W
from handtrack.diagnostics.residuals import outline_polygons
from handtrack.errors import HandtrackError
from handtrack.export.shown.mesh import joint_links
from handtrack.export.table import ResultsTable
from handtrack.files.atomic import replacing
from handtrack.files.films import check_film
from handtrack.model.ellipsoids import Ellipsoids
from handtrack.model.kinematics import BonePoses
from handtrack.session.session import Session
from handtrack.tracking.frame.result import Status

_HEIGHT_PX = 480  # of a camera's picture: two side by side fill a usual screen
_CODEC = "vp09"  # the one that opencv-python writes and browsers play
_TINT = 0.25
_MASK = 0.4
_FAR_PX = 1e5  # OpenCV draws in whole numbers of 32 bits, less its fraction
# BGR; those of the workbench's lanes
_COLOURS = {
    Status.TRACKED: (110, 200, 90),
    Status.DOUBTFUL: (40, 170, 240),
    Status.LOST: (60, 60, 230),
}
_MODEL_COLOUR = (230, 190, 120)


def write(path: Path, table: ResultsTable) -> None:
    """Write a film with a picture for every frame: outline and bones over the image as it was taken, the frame's number and state.

    A camera without images shows its masks, one without either is left out. Raises HandtrackError where nothing is there.
    """
    if table.session_folder is None:
        raise HandtrackError(
            f"{table.source} lies in no session, so there are no images to draw on. Name the session with --session DIR."
        )
    session, table = Session.open(table.session_folder), table.without_gaps
    track = table.track
    asked = track.frame[[0, len(track) // 2, -1]].tolist()
    cameras = [
        view.name
        for view in session.views
        if any(_image_or_mask(session, view.name, frame) is not None for frame in asked)
    ]
    if not cameras:
        raise HandtrackError(
            f"{table.session_folder}: no camera has images or masks in frames {track.frame[0]} to {track.frame[-1]}, so that there is "
            "nothing to draw on. `--to html` shows the track without images."
        )
    links, ellipsoids = joint_links(table.model), table.model.ellipsoids["fine"]
    with replacing(path) as part:
        film = None
        for row, frame in enumerate(track.frame):
            poses = track.T_world_bone[row]
            bones = BonePoses(poses[0, :3, 3], poses[:, :3, :3], poses[:, :3, 3])
            drawn = ellipsoids.posed(bones), track.joint_positions[row], links
            status = Status(int(track.status[row]))
            pictures = [
                _picture(session, name, int(frame), drawn, status, table.is_lost[row])
                for name in cameras
            ]
            picture = np.ascontiguousarray(np.concatenate(pictures, axis=1))
            if film is None:
                size = (picture.shape[1], picture.shape[0])
                code = cv2.VideoWriter.fourcc(*_CODEC)
                film = cv2.VideoWriter(str(part), code, table.fps, size)
                if not film.isOpened():
                    raise HandtrackError(
                        f"{path}: OpenCV here cannot write {_CODEC} films. If the disk is not full, install opencv-python-headless as pip has it."
                    )
            film.write(picture)
        assert film is not None, "a track has frames"
        film.release()
        check_film(part, len(track))


_Drawn = tuple[Ellipsoids, Floats[J, D3], list[tuple[int, int]]]
"""flesh, joints in the world [m] and links between them: what is drawn over an image"""


def _image_or_mask(session: Session, name: str, frame: int) -> Array | None:
    """Return an image BGR as it was taken; where there is none the mask, darker; None where there is neither."""
    image = session.image(name, frame)
    if image is None:
        mask = session.mask(name, frame)
        image = None if mask is None else (_MASK * mask).astype(np.uint8)
    return (
        cv2.cvtColor(image, cv2.COLOR_GRAY2BGR) if image is not None and image.ndim == 2 else image
    )


def _picture(
    session: Session, name: str, frame: int, drawn: _Drawn, status: Status, lost: bool
) -> Array[H, W, D3]:
    """Return an image as it was taken, made smaller, with the model over it; dark where there is none. A lost pose is not drawn."""
    image, camera = _image_or_mask(session, name, frame), session.rig[name]
    across = 2 * round(_HEIGHT_PX * camera.size[0] / camera.size[1] / 2)  # codecs want even ones
    if image is None:
        shown = np.zeros((_HEIGHT_PX, across, 3), np.uint8)
    else:
        shown = cv2.resize(image, (across, _HEIGHT_PX), interpolation=cv2.INTER_AREA)
    small = camera.scaled((across, _HEIGHT_PX))
    ink = _COLOURS.get(status, _COLOURS[Status.TRACKED])
    if not lost:
        ellipsoids, joints, links = drawn
        lines = outline_polygons(small.without_distortion(), ellipsoids)
        lines = [small.distort_points(line) for line in lines]
        whole = [np.rint(line).astype(np.int32) for line in lines if np.isfinite(line).all()]
        tinted = cv2.fillPoly(shown.copy(), whole, _MODEL_COLOUR)
        shown = cv2.addWeighted(tinted, _TINT, shown, 1.0 - _TINT, 0.0)
        cv2.polylines(shown, whole, True, ink, 1, cv2.LINE_AA)
        places = small.project(joints)
        places[~(np.abs(places) < _FAR_PX).all(axis=1)] = np.nan
        for a, b in links:
            if np.isfinite(places[[a, b]]).all():
                ends = np.rint(places[[a, b]]).astype(int).tolist()
                cv2.line(shown, ends[0], ends[1], (255, 255, 255), 1, cv2.LINE_AA)
    words = f"{name}  {frame}  {status.words}"
    for thickness, colour in ((3, (0, 0, 0)), (1, ink)):
        cv2.putText(
            shown, words, (10, 24), cv2.FONT_HERSHEY_SIMPLEX, 0.6, colour, thickness, cv2.LINE_AA
        )
    return shown
