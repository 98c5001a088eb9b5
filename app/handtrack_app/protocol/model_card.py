"""What the page needs to know of a model beside its bones: whose it is, how large, the parts of a body."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from handtrack.arrays import Floats, Ints
from handtrack.model.articulated import ArticulatedModel

HAND_REACH_M = 0.11
"""how far a hand extends around its middle"""
_BODY_REACH_M = 0.9
_PART_GRID = (20, 16)  # points around and steps along a part that is drawn


@dataclass(frozen=True)
class PartCard:
    """A part of a body as the scene draws it: a closed mesh, fixed to a bone."""

    bone: int
    vertices: Floats
    """(V, 3) in that bone's frame [m]"""
    faces: Ints


def model_words(model: ArticulatedModel) -> str:
    """Return whose model it is, for the page."""
    whose = "" if model.kind == "body" else f", {model.side} hand"
    return f"{model.name}{whose}, size {model.scale.overall:.2f}"


def model_reach(model: ArticulatedModel) -> float:
    """Return how far a model extends around its middle [m]: what is drawn is sized by it."""
    return _BODY_REACH_M * model.scale.overall if model.kind == "body" else HAND_REACH_M


def part_cards(model: ArticulatedModel) -> tuple[PartCard, ...]:
    """Return a body's superquadrics as meshes; nothing for a hand."""
    parts = model.superquadrics
    if parts is None:
        return ()
    mesh = parts.mesh(*_PART_GRID)
    vertices = np.split(mesh.local, len(parts))
    faces = mesh.faces[: len(mesh.faces) // len(parts)]
    return tuple(PartCard(int(b), v, faces) for b, v in zip(parts.bone, vertices, strict=True))
