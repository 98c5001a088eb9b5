"""HTML: the moving skeleton in one file that any browser plays, without network."""

from __future__ import annotations

import html
import json
from pathlib import Path
from typing import Any

import numpy as np

from handtrack.export.shown.mesh import joint_links, model_skin
from handtrack.export.table import ResultsTable
from handtrack.files.atomic import replace_text
from handtrack.geometry.rotation import quaternion_wxyz
from handtrack.tracking.frame.result import Status

_PAGE = Path(__file__).with_name("playback.html")
_DIGITS = 5  # of a metre or a quaternion: a hundredth of a millimetre


def write(path: Path, table: ResultsTable) -> None:
    """Write the page: the skin moved by the bones, joints, cameras, timeline with each frame's state and reason."""
    data = json.dumps(scene_of(table), separators=(",", ":")).replace("<", "\\u003c")
    page = _PAGE.read_text(encoding="utf-8")
    page = page.replace("$TITLE", html.escape(table.track.session or "handtrack"))
    replace_text(path, page.replace('"$DATA"', data))


def scene_of(table: ResultsTable) -> dict[str, Any]:
    """Return what the page draws, as JSON has it [m, wxyz]."""
    track, model = table.track, table.model
    skin = model_skin(model)
    turns = quaternion_wxyz(track.T_world_bone[..., :3, :3])
    poses = np.concatenate([track.T_world_bone[..., :3, 3], turns], axis=-1)
    cameras = () if table.rig is None else table.rig
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    return {
        "session": track.session,
        "model": track.model if model.kind == "body" else f"{track.model}, {track.side}",
        "fps": table.fps,
        "frame": track.frame.tolist(),
        "time_s": np.round(track.time_s, 4).tolist(),
        "status": track.status.tolist(),
        "status_names": [status.words for status in Status],
        "reason": [] if track.reason is None else [str(text) for text in track.reason],
        "poses": _rounded(poses.reshape(len(track), -1)),
        "joints": _rounded(track.joint_positions.reshape(len(track), -1)),
        "joint_names": list(track.joint_names),
        "links": joint_links(model),
        "skin": {
            "bone": skin.bone.tolist(),
            "local": _rounded(skin.local),
            "faces": skin.faces.ravel().tolist(),
        },
        "cameras": [
            {
                "name": camera.name,
                "centre": _rounded(camera.centre),
                "corners": _rounded(camera.rays(corners * camera.size - 0.5)),
                "up": _rounded(-camera.rotation[1]),
            }
            for camera in cameras
        ],
    }


def _rounded(values: Any) -> Any:
    return np.round(np.asarray(values, float), _DIGITS).tolist()
