"""Whether a session shows anything that a hand could be fitted to."""

from __future__ import annotations

from typing import Any

_NOTHING = (
    "Nothing tells where the {kind} is yet: this session has neither masks nor clouds. In the tab Cloud, match a pair of "
    "cameras ('Clouds from this pair'); or give the cameras masks in session.toml, a folder of files or a method such as "
    "'skin_ycrcb', and open it again. Edges of the images, with a first pose, do without both (tab Settings, Weights)."
)


def nothing_seen(run: Any) -> str:
    """Return what to do about a session in which nothing is observed; empty where something is."""
    session, settings = run.session, run.settings
    if getattr(session, "has_clouds", True) or settings.looks_at_images:
        return ""
    cameras = [view.settings for view in session.views]
    if any(camera.masks is not None or camera.keypoints is not None for camera in cameras):
        return ""
    return _NOTHING.format(kind=run.model.kind)
