"""How well a pose explains a frame: overlap in each camera, energy by term. Of any pose, tracked or set by hand."""

from __future__ import annotations

from dataclasses import replace

from handtrack.arrays import Floats, P
from handtrack.model.articulated import ArticulatedModel
from handtrack.observation.observation import Observation
from handtrack.terms.silhouettes.outline_overlap import outline_overlap
from handtrack.tracking.frame.descent import stage_problem
from handtrack.tracking.frame.frame_terms import frame_terms
from handtrack.tracking.frame.settings import TrackerSettings


def score(
    model: ArticulatedModel, settings: TrackerSettings, seen: Observation, params: Floats[P]
) -> tuple[dict[str, float], dict[str, float]]:
    """Return what solver parameters are worth in a frame; empty where nothing was seen.

    By camera, the overlap of model and mask: their common area by that of both, 0 to 1. By term, the energy ½ Σ r² in the
    narrowest band; without any pull to a prediction, and without pins: a pose from before them would be blamed for what a
    person said after it.
    """
    bones = model.bones(params)
    terms = frame_terms(model, settings, replace(seen, pins=()), bones)
    if not terms.has_observations:
        return {}, {}
    overlap = dict[str, float]()
    if terms.prepared:
        shares = outline_overlap(terms.prepared, model.ellipsoids["fine"], bones).iou.tolist()
        names = [prepared.camera.name for prepared in terms.prepared]
        overlap = dict(zip(names, shares, strict=True))
    energy = stage_problem(terms, params).costs(params)
    return overlap, {name: float(cost) for name, cost in energy.items()}
