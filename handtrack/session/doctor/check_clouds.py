"""The doctor's look at point clouds: whether there are any, and what the filters leave of them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from handtrack.capture.images.frame_notes import listed
from handtrack.session.doctor.check_views import spread
from handtrack.session.doctor.finding import Finding, error, ok, warning

if TYPE_CHECKING:
    from handtrack.session.session import Session

_FEW, _SOME = 4, 12  # frames looked at: matching a pair takes its time
_LEAST_POINTS = 300  # below that, a hand's pose cannot be told from its cloud


def check_clouds(session: Session) -> Iterator[Finding]:
    """Yield findings about a few clouds of a session: points measured and left by the filters."""
    if not session.has_clouds:
        return
    measured, left, poor = [], [], []
    settings = session.file.clouds
    few = settings is not None and settings.stereo
    for frame in spread(session.frame_count, _FEW if few else _SOME):
        cloud, _ = session.cloud(frame)
        whole = session.measured_cloud(frame)
        if cloud is None or whole is None:
            continue
        measured.append(len(whole))
        left.append(len(cloud))
        if len(cloud) < _LEAST_POINTS:
            poor.append(frame)
    if not measured:
        yield error("clouds: none of the frames looked at has a cloud.")
        return
    text = (
        f"clouds: {np.median(measured):.0f} points measured, {np.median(left):.0f} left by the "
        f"filters (median of {len(measured)} frames)"
    )
    if poor:
        yield warning(
            f"{text}; fewer than {_LEAST_POINTS} are left in frames {listed(poor)}. Look at the "
            "settings in [clouds]: near_m, far_m, component, outlier_neighbours."
        )
    else:
        yield ok(f"{text}.")
