"""A BVH that handtrack wrote, back on its model: by the bones' turns, which joint positions alone leave partly open."""

from __future__ import annotations

import numpy as np

from handtrack.arrays import D3, B, F, Floats, P, indices
from handtrack.geometry.rotation import rotation_matrix, rotation_vector
from handtrack.model.articulated import ArticulatedModel
from handtrack.simulation.motion_files.clip import MotionClip

_ITERATIONS, _DONE_RAD = 50, 1e-9


def own_params(model: ArticulatedModel, clip: MotionClip, unit_m: float) -> Floats[F, P] | None:
    """Return solver parameters whose bones are turned as a clip's joints, each named by its bone; None for other clips.

    The clip's turns are from the model's zero pose, as `export.motion.bvh` writes them; the root's place is the clip's.
    """
    names = ["_".join(name.split()) for name in model.skeleton.bone_names]
    if clip.turns is None or not set(names) <= set(clip.names):
        return None
    columns = indices(clip.names, names)
    rest = model.bones(model.params_from({})).rotation
    wanted = clip.turns[:, columns] @ rest
    places = clip.positions[:, columns[0]] * unit_m
    params = model.rest_params()
    found = []
    for turns, place in zip(wanted, places, strict=True):
        params = _turned(model, turns, params)
        joint = model.joint_params(params)
        joint[:3] = place
        joint[3:6] = rotation_vector(rotation_matrix(joint[3:6]))
        params = model.transform.solver_params(joint)
        found.append(params)
    return np.array(found)


def _turned(model: ArticulatedModel, wanted: Floats[B, D3, D3], params: Floats[P]) -> Floats[P]:
    """Return solver parameters of bones' turns, by Gauss and Newton."""
    for _ in range(_ITERATIONS):
        bones, twists, _ = model.linearize(params)
        off = rotation_vector(wanted @ np.swapaxes(bones.rotation, 1, 2))
        turns = (twists[:, 3:] @ model.transform.matrix).reshape(-1, len(params))
        step = np.linalg.lstsq(turns, off.ravel(), rcond=None)[0]
        params = params + step
        if np.abs(step).max() < _DONE_RAD:
            break
    return params
