"""Names that people give the 21 points of a hand, and the joints of a body, as ours."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence

from handtrack.capture.images.openpose import LAYOUTS, is_body

JOINTS: tuple[str, ...] = tuple(LAYOUTS["mediapipe21"].points)
"""our names, in the order of OpenPose, MediaPipe and COCO-WholeBody"""


def _by_word(words: Mapping[str, str]) -> dict[str, str]:
    """Return our name of each word that people write. words: those with one meaning, with commas between them, by our name."""
    return {word: ours for ours, theirs in words.items() for word in theirs.split(", ")}


_FINGERS = _by_word(
    {
        "thumb": "thumb",
        "index": "index, forefinger, pointer",
        "middle": "middle, mid",
        "ring": "ring",
        "little": "little, pinky, pinkie, small",
    }
)
_WRIST = {"wrist", "root", "palmbase", "carpus"}
_PARTS = _by_word(
    {
        "cmc": "cmc, tmc, tm",
        "mcp": "mcp, mp, knuckle, knuckles",
        "pip": "pip",
        "dip": "dip",
        "ip": "ip",
        "tip": "tip, end, fingertip",
    }
)
_BY_NUMBER = {"thumb": ("cmc", "mcp", "ip", "tip")}
_USUAL = ("mcp", "pip", "dip", "tip")
_SIDES = _by_word({"right": "right, r, rh", "left": "left, l, lh"})
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
    words = [part for word in _words(name) for part in _without_finger(word)]
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
    return re.findall(r"[a-z]+|\d+", spaced.lower())


def _without_finger(word: str) -> Sequence[str]:
    """Return `thumbtip` as thumb and tip, `indexfinger` as index and finger."""
    for start in _FINGERS:
        if word.startswith(start) and word[len(start) :] in (_PARTS.keys() | _FILLING):
            return start, word[len(start) :]
    return (word,)


# ---- bodies

_MIDDLE = _by_word(
    {
        "nose": "nose",
        "neck": "neck",
        "head_top": "head top, top head, top of head, headtop, vertex",
        "pelvis": "pelvis, hip, hips, mid hip, midhip, middle hip, hip center",
        "chest": "chest",
    }
)
_PAIRED = _by_word(
    {name: name for name in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")}
    | {"toe": "toe, toes, big toe, bigtoe, toe base, foot index"}
)
_BODY_FILLING = {"joint", "keypoint", "kp", "point", "marker", "landmark", "pose", "body"}
NAMED = "body22"
"""the layout of points that were given by name"""
BODY_LAYOUTS = {n: layout for n, layout in LAYOUTS.items() if is_body(layout) and n != NAMED}
"""those of detectors"""
_FEWEST = 5
"""joints, wrists not counted, that make a body: a hand's file may have an elbow beside"""


def known_body_joint(name: str) -> str | None:
    """Return our name of a joint in any usual spelling (`LShoulder`, `left_shoulder`, `shoulder.L`, `LEFT_FOOT_INDEX`), or None."""
    words = [word for word in _words(name) if word not in _BODY_FILLING]
    sides = [_SIDES[word] for word in words if word in _SIDES]
    text = " ".join(word for word in words if word not in _SIDES)
    if len(sides) == 1 and text in _PAIRED:
        return f"{sides[0]}_{_PAIRED[text]}"
    return _MIDDLE.get(text) if not sides else None


def named_bodies(names: Sequence[str]) -> dict[int, int] | None:
    """Return which of a file's points are which rows of the layout `body22`; None where they make no body."""
    rows = LAYOUTS[NAMED].points
    found = {i: rows[joint] for i, name in enumerate(names) if (joint := known_body_joint(name))}
    twice = len(set(found.values())) < len(found)
    sure = [i for i in found if "wrist" not in names[i].lower()]
    return None if twice or len(sure) < _FEWEST else found


def is_numbered(names: Iterable[str]) -> bool:
    """Return whether points have the numbers 0, 1, 2 … for names, as many as some body's layout has."""
    words = [
        re.sub(r"\D", "", name) if re.fullmatch(r"\D{0,10}\d+", name) else "" for name in names
    ]
    counts = {layout.count for layout in BODY_LAYOUTS.values()}
    return len(words) in counts and words == [str(i) for i in range(len(words))]
