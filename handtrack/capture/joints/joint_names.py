"""Names that people give the 21 points of a hand, as ours."""

from __future__ import annotations

import re
from collections.abc import Sequence

from handtrack.capture.images.openpose import LAYOUTS

JOINTS: tuple[str, ...] = tuple(LAYOUTS["mediapipe21"].points)
"""our names, in the order of OpenPose, MediaPipe and COCO-WholeBody"""
_FINGERS = {
    "thumb": "thumb", "index": "index", "forefinger": "index", "pointer": "index", "middle": "middle", "mid": "middle",
    "ring": "ring", "little": "little", "pinky": "little", "pinkie": "little", "small": "little",
}  # fmt: skip
_WRIST = {"wrist", "root", "palmbase", "carpus"}
_PARTS = {
    "cmc": "cmc", "tmc": "cmc", "tm": "cmc", "mcp": "mcp", "mp": "mcp", "knuckle": "mcp", "knuckles": "mcp", "pip": "pip",
    "dip": "dip", "ip": "ip", "tip": "tip", "end": "tip", "fingertip": "tip",
}  # fmt: skip
_BY_NUMBER = {"thumb": ("cmc", "mcp", "ip", "tip")}
_USUAL = ("mcp", "pip", "dip", "tip")
_WORD = re.compile(r"[a-z]+|\d+")
_SIDES = {"right": "right", "r": "right", "rh": "right", "left": "left", "l": "left", "lh": "left"}
_FILLING = {
    "hand",
    "finger",
    "joint",
    "landmark",
    "keypoint",
    "kp",
    "point",
    "lm",
    "marker",
    "id",
    "no",
}


def known_joint(name: str) -> tuple[str, str] | None:
    """Return our name of a point, and the side in its name, empty where there is none; None for a point that is none of ours.

    Known are finger and joint in any spelling (`INDEX_FINGER_MCP`, `RIndex1Knuckles`, `right_forefinger2`), and numbers 0 to 20.
    """
    words = _words(name)
    side = next((_SIDES[word] for word in words if word in _SIDES), "")
    left = [word for word in words if word not in _SIDES and word not in _FILLING]
    finger = next((_FINGERS[word] for word in left if word in _FINGERS), None)
    numbers = [int(word) for word in left if word.isdecimal()]
    parts = [_PARTS[word] for word in left if word in _PARTS]
    if finger is None:
        if (len(left) == 1 and left[0] in _WRIST) or (not left and name.lower().endswith("hand")):
            return "wrist", side
        is_number = len(left) == 1 and len(numbers) == 1 and numbers[0] < len(JOINTS)
        return (JOINTS[numbers[0]], side) if is_number else None
    usual = _BY_NUMBER.get(finger, _USUAL)
    part = (
        parts[0] if parts else usual[numbers[0] - 1] if numbers and 1 <= numbers[0] <= 4 else None
    )
    joint = f"{finger}_{part}"
    return (joint, side) if joint in JOINTS else None


def _words(name: str) -> list[str]:
    """Return the words of a name: `RThumb1CMC` is r, thumb, 1, cmc."""
    spaced = re.sub(r"([a-z])([A-Z])", r"\1 \2", re.sub(r"\b([RL])([A-Z][a-z])", r"\1 \2", name))
    words = _WORD.findall(spaced.lower())
    return [part for word in words for part in _without_finger(word)]


def _without_finger(word: str) -> Sequence[str]:
    """Return `thumbtip` as thumb and tip, `indexfinger` as index and finger."""
    for start in _FINGERS:
        if word.startswith(start) and word[len(start) :] in (_PARTS.keys() | _FILLING):
            return start, word[len(start) :]
    return (word,)
