"""Names that people give the joints of a body, as ours."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

import numpy as np

from handtrack.arrays import D3, Floats, N
from handtrack.capture.joints.body_points import BODY_LAYOUTS, NAMED, BodyPoints

_SIDES = {"right": "right", "r": "right", "left": "left", "l": "left"}
_MIDDLE = {
    "nose": "nose", "neck": "neck", "head top": "head_top", "top head": "head_top", "top of head": "head_top",
    "headtop": "head_top", "vertex": "head_top", "pelvis": "pelvis", "hip": "pelvis", "hips": "pelvis", "mid hip": "pelvis",
    "midhip": "pelvis", "middle hip": "pelvis", "hip center": "pelvis", "chest": "chest",
}  # fmt: skip
_PAIRED = {
    "shoulder": "shoulder", "elbow": "elbow", "wrist": "wrist", "hip": "hip", "knee": "knee", "ankle": "ankle",
    "toe": "toe", "toes": "toe", "big toe": "toe", "bigtoe": "toe", "toe base": "toe", "foot index": "toe",
}  # fmt: skip
_FILLING = {"joint", "keypoint", "kp", "point", "marker", "landmark", "pose", "body"}
_FEWEST = 5
"""joints, wrists not counted, that make a body: a hand's file may have an elbow beside"""


def known_body_joint(name: str) -> str | None:
    """Return our name of a joint in any usual spelling (`LShoulder`, `left_shoulder`, `shoulder.L`, `LEFT_FOOT_INDEX`), or None."""
    spaced = re.sub(r"([a-z])([A-Z])", r"\1 \2", re.sub(r"\b([RL])([A-Z][a-z])", r"\1 \2", name))
    words = [word for word in re.findall(r"[a-z]+|\d+", spaced.lower()) if word not in _FILLING]
    sides = [_SIDES[word] for word in words if word in _SIDES]
    text = " ".join(word for word in words if word not in _SIDES)
    if len(sides) == 1 and text in _PAIRED:
        return f"{sides[0]}_{_PAIRED[text]}"
    return _MIDDLE.get(text) if not sides else None


def named_bodies(names: Sequence[str]) -> dict[int, int] | None:
    """Return which of a file's points are which rows of the layout `body22`; None where they make no body."""
    rows = BODY_LAYOUTS[NAMED].points
    found = {i: rows[joint] for i, name in enumerate(names) if (joint := known_body_joint(name))}
    twice = len(set(found.values())) < len(found)
    sure = [i for i in found if "wrist" not in names[i].lower()]
    return None if twice or len(sure) < _FEWEST else found


def is_numbered(names: Iterable[str]) -> bool:
    """Return whether points have the numbers 0, 1, 2 … for names, as many as some body's layout has."""
    words = [
        re.sub(r"\D", "", name) if re.fullmatch(r"\D{0,10}\d+", name) else "" for name in names
    ]
    counts = {layout.count for name, layout in BODY_LAYOUTS.items() if name != NAMED}
    return len(words) in counts and words == [str(i) for i in range(len(words))]


def body_of(points: Floats[N, D3], places: dict[int, int]) -> BodyPoints:
    """Return a person's named points as `body22` has them. points: column and row [px], confidence."""
    body = np.full((BODY_LAYOUTS[NAMED].count, 3), np.nan)
    body[list(places.values())] = points[list(places)]
    return cleaned(body)


def cleaned(points: Floats[N, D3]) -> BodyPoints:
    """Return points of which those without a place or confidence are missing, and none is surer than 1."""
    missing = ~np.isfinite(points[:, :2]).all(axis=1) | ~(points[:, 2] > 0)
    kept = np.where(missing[:, None], (np.nan, np.nan, 0.0), points)
    kept[:, 2] = np.minimum(kept[:, 2], 1.0)
    return kept
