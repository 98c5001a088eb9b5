"""What tests of tracking share: points of a hand's surface, joints as cameras see them, and how far a result is off."""

import numpy as np
from scipy.stats import chi2

from handtrack import ImageKeypoints
from handtrack.model.articulated import keypoint_names
from handtrack.model.metaballs import MetaballSurface, sample_surface
from handtrack.model.pose_library import named_pose
from handtrack.terms.clouds import visible_from
from handtrack.tracking.frame.control import Control, Observer
from handtrack.tracking.sequence import track_frames

QUICK = {"tracker.escape": False, "tracker.recovery": False}
"""settings of tracking that looks for nothing"""


class Told(list, Observer):
    """Reports of searches, and what frames share."""

    search = shared = list.append  # type: ignore[assignment]


def posed(model, pose, turn=(0.0, 0.0, 0.0)):
    """Return parameters of a named pose, the palm near the world's origin."""
    joint = named_pose(model, pose)
    joint[1], joint[3:6] = -0.09, turn
    return model.transform.solver_params(joint)


def bent(model, params, finger, degrees):
    """Return params with all joints of a finger bent by so much."""
    own = [n.startswith(finger) and n.endswith("_flex") for n in model.parameter_names]
    return model.clipped(np.where(own, np.deg2rad(degrees), params))


def on_surface(model, params, count, rng, eye=None):
    """Return points (N, 3) and normals on a posed model's surface; eye: only what a camera there sees."""
    points, normals = sample_surface(MetaballSurface.of(model), model.bones(params), count, rng)
    seen = slice(None) if eye is None else visible_from(points, normals, [eye[None]])
    return points[seen], normals[seen]


def joints_seen(cameras, points, off_px=0.0, sigma_px=2.0):
    """Return a hand's keypoints (21, 3) as cameras see them; off_px: how far beside, of all or of each camera (C, 21, 2)."""
    beside = np.broadcast_to(off_px, (len(cameras), 21, 2))
    return tuple(
        ImageKeypoints(c, keypoint_names(), c.project(points) + off, sigma_px)
        for c, off in zip(cameras, beside, strict=True)
    )


def inside_stated(result, model, params):
    """Return (J,) whether each joint of a result is as near as nine tenths are by its stated covariance."""
    off = result.joint_positions - model.joint_positions(model.bones(params))
    squared = np.einsum("ji,jik,jk->j", off, np.linalg.inv(result.joint_covariance), off)
    return squared < chi2(3).ppf(0.9)


def followed(tracker, seen, start, control=Control()):
    """Return the results of all frames, from the first one on; seen: what is seen in each."""
    numbers = range(len(seen))
    return list(track_frames(tracker, lambda n, *_: seen[n], 0, start, numbers, control))


def off_mm(result, model, params):
    """Return how far each joint of a result is from where parameters have it [mm]."""
    true = model.joint_positions(model.bones(params))
    return 1e3 * np.linalg.norm(result.joint_positions - true, axis=1)
