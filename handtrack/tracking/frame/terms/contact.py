"""A model's parts keep out of each other: a body's limbs, a hand's fingers."""

from __future__ import annotations

from functools import lru_cache

from handtrack.model.articulated import ArticulatedModel
from handtrack.terms.collision import CollisionTerm

_SOFT_M = 0.002
"""how far a finger's flesh gives way under a light touch: its pulp by 2 mm at a newton, and hardly further (Serina et al. 1997); as
much again costs ½"""


@lru_cache(maxsize=8)
def contact(model: ArticulatedModel) -> CollisionTerm:
    """Return the term that keeps a model's parts out of each other."""
    if model.kind == "body":
        return CollisionTerm.of(model)
    return CollisionTerm.of(model, "fine", _SOFT_M, _SOFT_M)
