"""2D joints of bodies as somebody's file gives them: everybody in each frame, in a detector's order of points."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from handtrack.arrays import D3, Floats, K
from handtrack.capture.images.openpose import LAYOUTS, is_body
from handtrack.errors import HandtrackError

BodyPoints = Floats[K, D3]
"""column and row [px], confidence 0 to 1; NaN and 0 where a point is missing"""
BODY_LAYOUTS = {name: layout for name, layout in LAYOUTS.items() if is_body(layout)}
NAMED = "body22"
"""the layout of points that were given by name"""
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


@dataclass(frozen=True)
class GivenBodies:
    """What a file says of bodies."""

    frames: Mapping[int, tuple[BodyPoints, ...]]
    """the people of each frame, one number of points in all"""
    is_share: bool = False
    """whether columns and rows are shares of the image, 0 to 1 from edge to edge"""
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
    is_share: bool = False,
    layout: str | None = None,
    unknown: tuple[str, ...] = (),
) -> GivenBodies | None:
    """Return people by frame; None where there is none. Raises HandtrackError where they have different numbers of points."""
    found = {frame: kept for frame, people in frames.items() if (kept := tuple(people))}
    counts = {len(person) for people in found.values() for person in people}
    if len(counts) > 1:
        raise HandtrackError(
            f"{where}: people of {' and of '.join(map(str, sorted(counts)))} points; expected one detector's, all alike."
        )
    return GivenBodies(found, is_share, layout, unknown) if found else None


def layout_of(bodies: GivenBodies, said: str | None, where: str, likely: str | None = None) -> str:
    """Return the name of the layout of a file's points: as the user said, else the one that makes bodies of them.

    likely: taken where that leaves it open.

    Raises HandtrackError where none does, or several do and nobody said which.
    """
    if bodies.layout is not None:
        return bodies.layout
    fit = [
        name
        for name, layout in BODY_LAYOUTS.items()
        if layout.count == bodies.count and name != NAMED
    ]
    if said is not None:
        if said in fit:
            return said
        raise HandtrackError(
            f"--layout {said}: {where} has people of {bodies.count} points, expected {LAYOUTS[said].count}; "
            + (
                f"layouts of {bodies.count}: {', '.join(fit)}."
                if fit
                else f"known are {known_layouts()}."
            )
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
            f"body's proportions. If it is that order all the same, say so with --layout {best}."
        )
    if others and not off[others[0]] > _CLEARLY * off[best]:  # nor where nobody is seen
        if likely in fit:
            return likely
        raise HandtrackError(
            f"{where}: {bodies.count} points may be {' or '.join(fit)}, and what is seen does not tell which; say it with "
            f"--layout, such as --layout {best}."
        )
    return best


def height(person: BodyPoints) -> float:
    """Return how many pixels a person's points reach from the highest to the lowest."""
    rows = person[np.isfinite(person[:, 1]), 1]
    return float(np.ptp(rows)) if len(rows) else 0.0


def known_layouts() -> str:
    """Return the layouts of bodies with their numbers of points, in words."""
    return ", ".join(
        f"{name} ({layout.count})" for name, layout in BODY_LAYOUTS.items() if name != NAMED
    )


def _misproportion(bodies: GivenBodies, name: str) -> float:
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
