"""Who is who in 2D joints of several people: the same person from frame to frame, the one who stays first."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from handtrack.arrays import Floats
from handtrack.capture.images.openpose import height
from handtrack.capture.joints.given_joints import BodyPoints

Person = dict[int, BodyPoints]
"""one person's points by frame"""
_FAR = 0.5  # of their height: nobody's joints move further from one frame to the next that has them
_GONE = 30  # frames after which who comes back counts as somebody else, until pieces are joined
_ALIKE = 1.5  # ratio of heights within which two pieces may be one person


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
            if not person.keys() & piece.keys() and 1 / _ALIKE < ratio < _ALIKE:
                person |= piece
                break
        else:
            whole.append(dict(piece))
    return [dict(sorted(person.items())) for person in sorted(whole, key=_presence, reverse=True)]


def _presence(person: Person) -> float:
    return sum(height(points) for points in person.values())


def _usual_height(person: Person) -> float:
    heights: Floats = np.array([height(points) for points in person.values()])
    return float(np.median(heights))
