"""The 2007 paper's field images of a known pose."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from handtrack import ArticulatedModel, Camera, Silhouette
from handtrack.arrays import Floats, P
from handtrack.model.ellipsoids import field_image
from handtrack.simulation.scenes.simulated_views import everything
from handtrack.terms.silhouettes import PreparedSilhouette, prepare


def field_views(
    model: ArticulatedModel,
    params: Floats[P],
    cameras: Sequence[Camera],
    depth_scaled: bool = False,
) -> list[PreparedSilhouette]:
    """Return each camera's field image of a pose, ready for ConicFieldTerm.

    depth_scaled: the paper's scale 1/C*₃₃ [m⁻²]; otherwise fields are −1 at their centres.
    """
    flesh = model.ellipsoids["fine"].posed(model.bones(params))
    seen = []
    for camera in cameras:
        field = field_image(camera, flesh, depth_scaled=depth_scaled)
        silhouette = Silhouette(camera, (field < 0).astype(np.float32), everything(camera))
        seen.append(prepare(silhouette, observation=field))
    return seen
