"""2D joints of one camera as somebody's file gives them: hands by side and frame, and bodies, everybody in each frame."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from handtrack.arrays import D2, D3, D21, Floats, K, N, indices
from handtrack.capture.images.openpose import FINGERS, LAYOUTS, height, is_body, write_points
from handtrack.errors import HandtrackError

# ---- Names that people give the 21 points of a hand, and the joints of a body, as ours


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
    if numbers and not parts and 1 <= numbers[0] <= 4:
        parts = [FINGERS[finger][numbers[0] - 1]]
    joint = f"{finger}_{''.join(parts[:1])}"
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
    found = [re.fullmatch(r"\D{0,10}(\d+)", name) for name in names]
    counts = {layout.count for layout in BODY_LAYOUTS.values()}
    return len(found) in counts and all(m and m[1] == str(i) for i, m in enumerate(found))


# ---- What a file says


LARGEST = 1 << 29  # bytes of one file: hours
_LAST_FRAME = 10_000_000
_SHARES = 2.0
Hand = Floats[D21, D3]
"""column and row [px], confidence 0 to 1; NaN and 0 where a point is missing"""
BodyPoints = Floats[K, D3]
"""the same of a body, as many points as its detector has"""
HANDS_IN = {
    133: {
        side: {start + i: joint for i, joint in enumerate(JOINTS)}
        for side, start in (("left", 91), ("right", 112))
    },
    21: {"": dict(enumerate(JOINTS))},
}
"""by how many points a person has: which of them are a hand's, by side"""
_LINKS_M = {
    ("shoulder", "elbow"): 0.283,
    ("elbow", "wrist"): 0.268,
    ("shoulder", "hip"): 0.509,
    ("hip", "knee"): 0.42,
    ("knee", "ankle"): 0.432,
}
"""of body34"""
_LEAST_LINK = 0.01  # of the height: a link that points at the camera has hardly a length
# How far links' off in the image are from a body's proportions, mean of |log|: 0.03 to 0.14 of standing, dancing and real
# people in their own order, 0.3 to 0.9 in the other's of as many points, 0.26 and more in orders drawn at random.
_MOST_OF_A_BODY = 0.35
_CLEARLY = 1.5  # times as far in the other order
_LOOKED_AT = 200  # frames


class UnknownPoints(HandtrackError):
    """Points by names that say neither a hand's joints nor a body's."""

    def __init__(self, message: str, names: tuple[str, ...]) -> None:
        super().__init__(message)
        self.names = names


@dataclass(frozen=True)
class ImportedJoints:
    """What a file says."""

    family: str
    hands: Mapping[str, Mapping[int, Hand]]
    """by side (right, left, or empty where nothing says it), then by frame."""
    layout: str | None = None
    """the session's keypoint_layout; None: hand_left or hand_right."""
    unknown: tuple[str, ...] = ()
    """names of points that are none of a hand's 21."""
    notes: tuple[str, ...] = ()
    bodies: ImportedBodies | None = None

    @property
    def has_hand(self) -> bool:
        """Whether a hand is in some frame."""
        return any(self.hands.values())

    def hand(self, side: str | None, where: str) -> tuple[str, Mapping[int, Hand]]:
        """Return the side and the frames of the hand asked for; where nothing is asked for, of the one that is there.

        Raises HandtrackError where there are two, or not that one.
        """
        there = {name: frames for name, frames in self.hands.items() if frames}
        if not there:
            raise HandtrackError(f"{where}: no hand in any frame.")
        if side is None and len(there) > 1:
            raise HandtrackError(
                f"{where}: two hands, {' and '.join(map(str, there))}; choose one with --side."
            )
        chosen = next(iter(there)) if side is None or side not in there else side
        if side is not None and chosen not in (side, ""):
            raise HandtrackError(f"{where}: no {side} hand; there is a {chosen} one.")
        return chosen, there[chosen]


def hand_of(names: Sequence[str], points: Floats[N, D2], confidence: Floats[N]) -> Hand:
    """Return 21 points from some, by our names. points: column, row [px]."""
    hand = np.full((len(JOINTS), 3), np.nan)
    hand[indices(JOINTS, names)] = np.column_stack([points, confidence])
    return cleaned(hand)


def named_points(
    names: Iterable[str], where: str
) -> tuple[dict[str, dict[int, str]], tuple[str, ...]]:
    """Return by side which of a file's points are which of our joints, and the names of all others.

    Raises HandtrackError where hardly any is known, and where two are the same.
    """
    sides: dict[str, dict[int, str]] = {}
    unknown = list[str]()
    every = list(names)
    for i, name in enumerate(every):
        known = known_joint(name)
        if known is None:
            unknown.append(name)
            continue
        taken = sides.setdefault(known[1], {})
        if known[0] in taken.values():
            other = next(every[k] for k, joint in taken.items() if joint == known[0])
            raise HandtrackError(
                f"{where}: '{other}' and '{name}' are both {known[0]}; rename one of them."
            )
        taken[i] = known[0]
    if not any(len(taken) >= 3 for taken in sides.values()):
        raise UnknownPoints(
            f"{where}: its points ({', '.join(every[:8])}, …) are no hand's; expected names such as {', '.join(JOINTS[:3])}, "
            f"index_mcp, or the numbers 0 to 20 in OpenPose's order. A table can say which of them are which.",
            tuple(every),
        )
    return sides, tuple(unknown)


def side_in(text: str) -> str:
    """Return the side that a text says, left or right; empty where it says none."""
    found = re.search(r"left|right", text.lower())
    return found[0] if found else ""


def frame_of(value: float, where: str) -> int:
    """Return a frame number. Raises HandtrackError for what is none."""
    if not (np.isfinite(value) and value == int(value) and 0 <= value < _LAST_FRAME):
        raise HandtrackError(f"{where}: frame {value:g}; expected a whole number from 0.")
    return int(value)


def in_pixels(
    frames: Mapping[int, Floats[N, D3]], size: tuple[int, int]
) -> dict[int, Floats[N, D3]]:
    """Return somebody's points in pixels of images of a size, width and height; of those that are given as shares of an image, from
    edge to edge, all lie within two pixels.
    """
    largest = [np.nanmax(np.abs(p[:, :2])) for p in frames.values() if np.isfinite(p[:, :2]).any()]
    if not largest or max(largest) > _SHARES:
        return dict(frames)
    scale, edge = np.array([*size, 1.0]), np.array([0.5, 0.5, 0.0])
    return {frame: points * scale - edge for frame, points in frames.items()}


def write_joints(frames: Mapping[int, Floats[N, D3]], layout: str, folder: Path) -> None:
    """Write a file a frame, as a session reads them by a `keypoint_layout`, to a new folder. frames: in pixels."""
    folder.mkdir(parents=True)
    for frame, points in frames.items():
        path = folder / f"{frame:06d}.json"
        write_points(path, np.nan_to_num(points), LAYOUTS[layout], "handtrack new")


# ---- Bodies, in a detector's order of points


@dataclass(frozen=True)
class ImportedBodies:
    """What a file says of bodies."""

    frames: Mapping[int, tuple[BodyPoints, ...]]
    """the people of each frame, one number of points in all"""
    layout: str | None = None
    """of the points, where the file says it; None: to be recognised by `layout_of`"""
    unknown: tuple[str, ...] = ()
    """names of points that are none of a body's"""

    @property
    def count(self) -> int:
        """How many points a person has."""
        return next((len(person) for people in self.frames.values() for person in people), 0)


def checked_bodies(
    frames: Mapping[int, Iterable[BodyPoints]],
    where: str,
    layout: str | None = None,
    unknown: tuple[str, ...] = (),
) -> ImportedBodies | None:
    """Return people by frame; None where there is none. Raises HandtrackError where they have different numbers of points."""
    found = {frame: kept for frame, people in frames.items() if (kept := tuple(people))}
    counts = {len(person) for people in found.values() for person in people}
    if len(counts) > 1:
        raise HandtrackError(
            f"{where}: people of {' and of '.join(map(str, sorted(counts)))} points; expected one detector's, with the same number throughout."
        )
    return ImportedBodies(found, layout, unknown) if found else None


def layout_of(
    bodies: ImportedBodies, said: str | None, where: str, likely: str | None = None
) -> str:
    """Return the name of the layout of a file's points: as the user said, else the one that makes
    bodies of them.

    Parameters
    ----------
    likely
        Taken where that leaves it open.

    Raises
    ------
    HandtrackError
        Where none does, or several do and nobody said which.
    """
    if bodies.layout is not None:
        return bodies.layout
    fit = [name for name, layout in BODY_LAYOUTS.items() if layout.count == bodies.count]
    if said is not None:
        if said in fit:
            return said
        known = (
            f"layouts of {bodies.count}: {', '.join(fit)}"
            if fit
            else f"known are {known_layouts()}"
        )
        raise HandtrackError(
            f"--layout {said}: {where} has people of {bodies.count} points, expected {LAYOUTS[said].count}; {known}."
        )
    if not fit:
        raise HandtrackError(
            f"{where}: people of {bodies.count} points, an order that is not known here. Known are {known_layouts()}; or a CSV "
            "with the columns frame, joint, x, y, confidence and joints named such as left_shoulder."
        )
    off = {name: _misproportion(bodies, name) for name in fit}
    best, *others = sorted(fit, key=off.__getitem__)
    if np.isfinite(off[best]) and off[best] > _MOST_OF_A_BODY:
        raise HandtrackError(
            f"{where}: its {bodies.count} points make no bodies in the order of {' or '.join(fit)}: their limbs have no "
            f"body's proportions. If it is that order all the same, confirm it with --layout {best}."
        )
    if others and not off[others[0]] > _CLEARLY * off[best]:  # nor where nobody is seen
        if likely in fit:
            return likely
        raise HandtrackError(
            f"{where}: {bodies.count} points may be {' or '.join(fit)}, and the points do not show which; choose it with --layout, such as --layout {best}."
        )
    return best


def known_layouts() -> str:
    """Return the layouts of bodies with their numbers of points, in words."""
    return ", ".join(f"{name} ({layout.count})" for name, layout in BODY_LAYOUTS.items())


def _misproportion(bodies: ImportedBodies, name: str) -> float:
    """Return how far limbs are from a body's proportions, the median over frames' tallest people; NaN where nobody is seen well."""
    points = LAYOUTS[name].points
    sides = [f"{side}_" for side in ("left", "right")]
    rows = np.array([[points[s + a], points[s + b]] for s in sides for a, b in _LINKS_M])
    usual = np.array([*_LINKS_M.values()] * len(sides))
    everybody = [max(people, key=height) for people in bodies.frames.values()]
    found = []
    for person in everybody[:: max(len(everybody) // _LOOKED_AT, 1)]:
        links = np.linalg.norm(person[rows[:, 0], :2] - person[rows[:, 1], :2], axis=1)
        known = np.asarray(np.isfinite(links))
        if known.sum() >= len(rows) // 2 and height(person) > 0:
            ratios = np.log((links[known] + _LEAST_LINK * height(person)) / usual[known])
            found.append(np.abs(ratios - np.median(ratios)).mean())
    return float(np.median(found)) if found else float("nan")


def body_of(points: Floats[N, D3], places: dict[int, int]) -> BodyPoints:
    """Return a person's named points as `body22` has them. points: column and row [px], confidence."""
    body = np.full((LAYOUTS[NAMED].count, 3), np.nan)
    body[list(places.values())] = points[list(places)]
    return cleaned(body)


def cleaned(points: Floats[N, D3]) -> BodyPoints:
    """Return points of which those without a place or confidence are missing, and none is surer than 1."""
    missing = ~np.isfinite(points[:, :2]).all(axis=1) | ~(points[:, 2] > 0)
    kept = np.where(missing[:, None], (np.nan, np.nan, 0.0), points)
    kept[:, 2] = np.minimum(kept[:, 2], 1.0)
    return kept


# ---- Who is who in 2D joints of several people: the same person from frame to frame, the one who stays first


Person = dict[int, BodyPoints]
"""one person's points by frame"""
_FAR = 0.5  # of their height: nobody's joints move further from one frame to the next that has them
_GONE = 30  # frames after which who comes back counts as somebody else, until pieces are joined
_SIMILAR = 1.5  # ratio of heights within which two pieces may be one person


def people(frames: Mapping[int, Sequence[BodyPoints]]) -> list[Person]:
    """Return everybody, first who fills most of the image for longest: heights summed over frames.

    In each frame people are matched with those before by the median distance of the joints that both have, as a share of their
    height, best pairs first. Pieces of which none is seen beside another, of about one height, are one person who was away.
    """
    pieces: list[Person] = []
    for frame in sorted(frames):
        near = sorted(
            (off, p, i)
            for p, piece in enumerate(pieces)
            if frame - (last := next(reversed(piece))) <= _GONE
            for i, person in enumerate(frames[frame])
            if (off := _apart(piece[last], person)) < _FAR
        )
        taken, matched = set[int](), set[int]()
        for _, p, i in near:
            if p not in matched and i not in taken:
                pieces[p][frame] = frames[frame][i]
                matched.add(p)
                taken.add(i)
        pieces += [{frame: person} for i, person in enumerate(frames[frame]) if i not in taken]
    return _joined(sorted(pieces, key=_presence, reverse=True))


def _apart(before: BodyPoints, now: BodyPoints) -> float:
    off = np.linalg.norm(before[:, :2] - now[:, :2], axis=1)
    known = np.isfinite(off)
    tall = max(height(before), height(now))
    return float(np.median(off[known])) / tall if known.any() and tall > 0 else np.inf


def _joined(pieces: list[Person]) -> list[Person]:
    whole: list[Person] = []
    for piece in pieces:
        for person in whole:
            ratio = _usual_height(person) / max(_usual_height(piece), 1.0)
            if not person.keys() & piece.keys() and 1 / _SIMILAR < ratio < _SIMILAR:
                person |= piece
                break
        else:
            whole.append(dict(piece))
    return [dict(sorted(person.items())) for person in sorted(whole, key=_presence, reverse=True)]


def _presence(person: Person) -> float:
    return sum(height(points) for points in person.values())


def _usual_height(person: Person) -> float:
    return float(np.median([height(points) for points in person.values()]))
