"""Whether joints in space are a left or a right hand's: fingers bend to one side only, and the thumb is on one."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import lru_cache

import numpy as np

from handtrack.arrays import D3, D21, Floats
from handtrack.model.articulated import HandScale, keypoint_names
from handtrack.model.model_file import load_model
from handtrack.observation.observation import Keypoints
from handtrack.tracking.search.keypoint_start import fit_keypoints

_SIDES = ("right", "left")
_FEWEST = 16  # keypoints: fewer fit either hand
_WRIST, _KNUCKLES = 0, [5, 9, 13, 17]  # rows of the 21 keypoints
# two meshes' hands with 2 mm of noise fit their own side to 3–8 mm, the other to 6–32
_LEAST_OFF_M, _LARGEST_SHARE = 0.004, 0.65
# Of several frames' geometric mean. The network's joints in real images: 0.39 to 0.68; in simulated ones, where it errs by
# a centimetre and the open hand is flat: 0.94 to 1.00
_SHARE_OF_FRAMES, _FEWEST_FRAMES = 0.78, 4
_KEYPOINT_SIGMA_M = 0.003


def misfits_m(xyz: Floats[D21, D3]) -> dict[str, float]:
    """Return by side how far joints are from those of a hand fitted to them, root mean square [m]; empty for too few joints."""
    if np.isfinite(xyz).all(axis=1).sum() < _FEWEST:
        return {}
    points = np.asarray(xyz, float).tobytes()
    return {side: _misfit_m(points, side) for side in _SIDES}


def side_told(misfits: Mapping[str, float], largest_share: float = _LARGEST_SHARE) -> str:
    """Return the side whose hand fits decisively better; empty where none does. largest_share: of the other's misfit."""
    if not misfits:
        return ""
    best, other = sorted(_SIDES, key=lambda side: misfits[side])
    clear = misfits[other] > _LEAST_OFF_M and misfits[best] < largest_share * misfits[other]
    return best if clear else ""


def side_of_frames(frames: Iterable[Floats[D21, D3]]) -> str:
    """Return the side that the joints of several frames tell together; empty where they do not."""
    found = [one for xyz in frames if (one := misfits_m(xyz))]
    if len(found) < _FEWEST_FRAMES:
        return ""
    mean = {side: float(np.exp(np.mean([np.log(one[side]) for one in found]))) for side in _SIDES}
    return side_told(mean, _SHARE_OF_FRAMES)


# the same first pose is asked for before tracking, as it begins, and afterwards
@lru_cache(maxsize=4)
def _misfit_m(points: bytes, side: str) -> float:
    xyz = np.frombuffer(points).reshape(-1, 3)
    mean = load_model("hand26", side)
    usual = mean.keypoints21(mean.bones(mean.rest_params()))
    sizes = _palm_lengths(xyz) / _palm_lengths(usual)
    size = float(np.nanmedian(sizes)) if np.isfinite(sizes).any() else 1.0
    model = load_model("hand26", side, HandScale(min(max(size, 0.5), 2.0)))
    fitted = fit_keypoints(model, Keypoints(keypoint_names(), xyz, _KEYPOINT_SIGMA_M))
    found = model.keypoints21(model.bones(fitted))
    return float(np.sqrt(np.nanmean(((found - xyz) ** 2).sum(axis=1))))


def _palm_lengths(xyz: Floats) -> Floats:
    """Return (4,) from the wrist to the knuckles of the fingers [m]: the same in every pose."""
    return np.linalg.norm(xyz[_KNUCKLES] - xyz[_WRIST], axis=1)
