"""Small pictures of the pose library: the flesh as somebody opposite sees it, drawn as ellipses, the far ones first."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from handtrack.model.articulated import ArticulatedModel
from handtrack.model.pose_library import named_pose, pose_names, pose_title, pose_turn
from handtrack.session.posed_frames import solver_params_of
from handtrack_app.protocol.library import PoseName
from handtrack_app.protocol.palette import colour_of

_SIDE, _EDGE = 100.0, 3.0  # of a picture and its margin; SVG has no size of its own
_EDGE_COLOUR = "#0008"  # fingers of one colour lie apart


def pose_titles(model: ArticulatedModel) -> tuple[PoseName, ...]:
    """Return the library of a model in words."""
    names = pose_names(model.kind)
    return tuple(PoseName(name, *pose_title(name, model.kind)) for name in names)


@lru_cache(maxsize=256)
def pose_picture(model: ArticulatedModel, name: str) -> str:
    """Return a pose of the library as SVG, seen from where its turn shows it; a body from the front. Forearms are left out."""
    values = named_pose(model, name)
    values[:6] = 0.0
    if model.kind != "body":
        values[3:6] = pose_turn(name, model.side)
    flesh = model.flesh["fine"].posed(model.bones(solver_params_of(model, values)))
    kept = ~model.is_forearm(flesh.bone)
    centre, radii = flesh.centre[kept], flesh.radii[kept]
    scaled = flesh.rotation[kept] * radii[:, None, :]
    shapes = (scaled @ scaled.transpose(0, 2, 1))[:, :2, :2]  # seen from +z, without perspective
    reach = np.sqrt(np.stack([shapes[:, 0, 0], shapes[:, 1, 1]], axis=1))
    low, high = (centre[:, :2] - reach).min(axis=0), (centre[:, :2] + reach).max(axis=0)
    factor = (_SIDE - 2 * _EDGE) / float((high - low).max())
    middle, parts = 0.5 * (low + high), list[str]()
    widths, axes = np.linalg.eigh(shapes)
    for n in np.argsort(centre[:, 2]).tolist():
        x, y = _SIDE / 2 + factor * (centre[n, :2] - middle) * (1, -1)
        a, b = factor * np.sqrt(widths[n])
        angle = np.rad2deg(np.arctan2(-axes[n, 1, 0], axes[n, 0, 0]))
        red, green, blue = colour_of(model.skeleton.bone_names[int(flesh.bone[kept][n])])
        parts.append(
            f"<ellipse rx='{a:.1f}' ry='{b:.1f}' fill='#{red:02x}{green:02x}{blue:02x}' "
            f"transform='translate({x:.0f} {y:.0f})rotate({angle:.0f})'/>"
        )
    return (
        f"<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 {_SIDE:g} {_SIDE:g}'>"
        f"<g stroke='{_EDGE_COLOUR}'>{''.join(parts)}</g></svg>"
    )
