"""The three papers' experiments side by side: what is compared, and that nothing is hidden where a part cannot be run."""

from __future__ import annotations

import numpy as np
import pytest

from handtrack.errors import HandtrackError
from handtrack.tracking.frame.methods import METHODS
from handtrack.tracking.frame.settings import TrackerSettings
from tests.experiments import papers


def test_each_method_is_compared_with_ours(monkeypatch):
    """Of each experiment the settings that were tracked by: the paper's method, and none."""
    asked = []

    def told(cameras, settings):
        plain = isinstance(settings, TrackerSettings)
        asked.append(settings if plain else TrackerSettings().with_values(settings))
        return np.zeros(100)

    monkeypatch.setattr(papers, "fist_errors", told)
    figures = papers.fist()
    assert {s.method for s in asked} == {"paper2007", "default"}
    assert {"paper2007_2cam_mean_mm", "ours_6cam_fist_mm"} <= set(figures)
    assert {s.solver.limits for s in asked} == {"none", "bounds"}
    for values in (*(v for _, v in papers.POOR.values()), *papers.STEREO.values()):
        assert TrackerSettings().with_values(values).method in ("paper2004", "default")
    assert {s.method for s in asked} | {"paper2004", "paper2003"} == set(METHODS)


def test_what_cannot_be_run_is_said(monkeypatch):
    def nothing(*_):
        raise HandtrackError("no shared test data")

    def one(*_):
        return {"mean_mm": 1.0}

    for name in ("fields", "fist", "poor", "table1"):
        monkeypatch.setattr(papers, name, one)
    for name in ("stereo", "why", "dance", "person"):
        monkeypatch.setattr(papers, name, nothing)
    figures = papers.papers()
    assert figures["paper2007_fist_mean_mm"] == 1.0
    assert figures["paper2004_real_stereo_left_out"] == "no shared test data"
    assert figures["paper2003_dance_left_out"] == "no shared test data"
    assert sum(key.endswith("cpu_s") for key in figures) == 9


def test_field_images_are_found_again_in_either_scale():
    figures = papers.fields(3)
    assert set(figures) == {"paper_scale_found", "normalised_scale_found"}
    assert all(0.0 <= float(share) <= 1.0 for share in figures.values())


@pytest.mark.parametrize("way", ["glove9_paper2004"])
def test_the_simple_model_follows_a_poor_cloud_by_the_papers_method(way):
    truth, seen = papers.poor_clouds.scene(0, frames=2)
    found = papers.poor_clouds.track(way, truth, seen, papers.POOR)
    assert papers.poor_clouds.palm_mm(way, found, truth, papers.POOR).max() < 40.0
