"""Several people from one mesh: hands longer, thicker, with other shares of palm and fingers."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from handtrack.arrays import D3, Floats, N
from tests.experiments.honesty.meshes import FINGERS, HandMesh


@dataclass(frozen=True)
class Person:
    """How a hand differs from the mesh, in factors."""

    scale: float = 1.0
    girth: float = 1.0
    """of fingers and of the palm's thickness, beside the scale"""
    fingers: tuple[float, float, float, float, float] = (1.0, 1.0, 1.0, 1.0, 1.0)
    """lengths, thumb first, beside the scale"""
    palm_width: float = 1.0
    left: bool = False


def somebody(rng: np.random.Generator) -> Person:
    """Return a person: spreads of length, girth and shares about as of adults (ANSUR II; Gordon et al. 2014)."""
    return Person(
        scale=float(rng.uniform(0.85, 1.12)),
        girth=float(np.clip(rng.normal(1.0, 0.08), 0.85, 1.18)),
        fingers=tuple(np.clip(rng.normal(1.0, 0.04, FINGERS), 0.9, 1.1).tolist()),
        palm_width=float(np.clip(rng.normal(1.0, 0.05), 0.9, 1.1)),
        left=bool(rng.random() < 0.4),
    )


def as_person(mesh: HandMesh, who: Person) -> HandMesh:
    """Return the right hand of this person; its mirror image is the left (`Person.left` is for who draws it)."""
    maps = np.zeros((1 + 3 * FINGERS, 3, 4))
    maps[0, :, :3] = palm = np.diag([who.palm_width, 1.0, who.girth])
    for f in range(FINGERS):
        start, tip = mesh.keypoints[[1 + 4 * f, 4 + 4 * f]]
        along = (tip - start) / np.linalg.norm(tip - start)
        long = np.outer(along, along)
        stretch = who.fingers[f] * long + who.girth * (np.eye(3) - long)  # about the knuckle
        bones = slice(3 * f + 1, 3 * f + 4)
        maps[bones, :, :3], maps[bones, :, 3] = stretch, palm @ start - stretch @ start
    vertices, points = mesh.carried(maps)
    hinge = maps[[[3 * f + k for k in (1, 1, 2, 3)] for f in range(FINGERS)]]
    pivots = np.einsum("fhij,fhj->fhi", hinge[..., :3], mesh.pivots) + hinge[..., 3]
    return replace(
        mesh,
        vertices=who.scale * vertices,
        pivots=who.scale * pivots,
        keypoints=who.scale * points,
    )


def mirrored(points: Floats[N, D3]) -> Floats[N, D3]:
    """Return a left hand's points for a right hand's, in the hand frame."""
    return points * np.array([-1.0, 1.0, 1.0])
