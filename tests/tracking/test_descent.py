"""When a band of the schedule has gained enough."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from handtrack.model.model_file import load_model
from handtrack.observation.observation import Observation
from handtrack.simulation.scenes.simulated_views import mask_views
from handtrack.simulation.simulate import simulated_rig
from handtrack.tracking.frame import descent
from handtrack.tracking.frame.frame_terms import frame_terms
from handtrack.tracking.frame.settings import TrackerSettings


@pytest.fixture(scope="module")
def seen():
    model = load_model()
    truth = model.rest_params()
    truth[1] -= 0.09
    views = mask_views(model, truth, simulated_rig(2, (160, 120), 0.4).cameras)
    rng = np.random.default_rng(1)
    start = model.clipped(truth + rng.normal(scale=0.03, size=len(truth)))
    start[:3] = truth[:3] + 0.003
    observation = Observation(frame=0, time_s=0.0, silhouettes=tuple(views.silhouettes))
    settings = TrackerSettings()
    return (
        model,
        settings,
        frame_terms(model, settings, observation, model.bones(start), None),
        start,
    )


def test_silhouettes_alone_stop_when_little_is_gained(monkeypatch, seen):
    model, settings, terms, start = seen
    short, problem, few = descent.descend(model, settings.solver, terms, start)
    monkeypatch.setattr(descent, "_enough", lambda chosen, *_: chosen.cost_tolerance)
    long, _, many = descent.descend(model, settings.solver, terms, start)
    assert few < many
    assert problem.cost(short.params) == pytest.approx(long.cost, rel=0.01)


def test_no_band_stops_sooner_than_asked(seen):
    _, settings, terms, _ = seen
    patient = replace(settings.solver, cost_tolerance=0.1)
    assert descent._enough(patient, terms, 0) == 0.1
    assert descent._enough(settings.solver, terms, 0) > descent._enough(
        settings.solver, terms, terms.stages - 1
    )
