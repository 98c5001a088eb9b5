"""The paper's Fig. 1, and what the drawings are made of."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from docs.pictures import figures, jump_figures
from docs.pictures.model_pictures import model_pictures, segments
from docs.pictures.plotting import saved
from handtrack.errors import HandtrackError
from handtrack.model.model_file import load_model
from handtrack.simulation.scenes.jump_scene import KJS1, jump_scene


def test_the_four_pictures_show_the_hand():
    model = load_model()
    params = model.rest_params()
    params[1] -= 0.09
    pictures = model_pictures(model, params, (320, 240))
    assert list(pictures) == ["skeleton", "flesh", "field seen by cam2", "all three"]
    for picture in pictures.values():
        assert picture.shape == (240, 320, 3)
        assert picture.dtype == np.uint8
    skeleton, flesh = (pictures[name].min(axis=2) < 240 for name in ("skeleton", "flesh"))
    assert 0.05 < (skeleton & flesh).sum() / flesh.sum() < 0.6
    assert (skeleton & ~flesh).sum() < 0.02 * skeleton.sum()  # bones lie within the flesh


def test_segments_are_the_bones_lengths():
    """One to each bone with a parent, one to each fingertip; joints bend, lengths stay."""
    model = load_model()
    rest, bent = (
        segments(model, model.bones(x)) for x in (model.rest_params(), 2 * model.rest_params())
    )
    assert rest.shape == (len(model.skeleton.parent) - 1 + 5, 2, 3)
    lengths = [np.linalg.norm(s[:, 1] - s[:, 0], axis=1) for s in (rest, bent)]
    np.testing.assert_allclose(*lengths, atol=1e-12)


def test_a_figure_is_drawn(tmp_path):
    pytest.importorskip("matplotlib")
    figures.saved(figures.draw_recovery(load_model(), seeds=2), tmp_path / "figure.png")
    assert (tmp_path / "figure.png").stat().st_size > 5000


def test_without_matplotlib_it_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(HandtrackError, match=r"pip install 'handtrack3d\[docs\]'"):
        figures.draw_recovery(load_model(), seeds=1)


def test_the_flips_are_drawn(tmp_path):
    """The picture of docs/explanation/one_camera.md: three panels, a line for each bone of each minimum and of the start."""
    pytest.importorskip("matplotlib")
    scene = jump_scene(1)
    figure = jump_figures.draw_flips(scene)
    minima = len(scene.tree(KJS1))
    assert minima > 1
    lines = [len(axis.get_lines()) for axis in figure.get_axes()]
    assert lines == [7 * (minima + 1) + 1, 7 * (minima + 1), 7 * (minima + 1)]
    saved(figure, tmp_path / "flips.png")
    assert (tmp_path / "flips.png").stat().st_size > 5_000


def test_distances_are_drawn_of_all_samples_and_minima():
    pytest.importorskip("matplotlib")
    figure = jump_figures.draw_distances(poses=2, samples=20)
    labels = [
        text.get_text() for axis in figure.get_axes() for text in axis.get_legend().get_texts()
    ]
    leaves = sum(len(jump_scene(seed).tree(KJS1)) for seed in range(2))
    assert labels[0] == labels[2] == f"samples ({leaves})"
    assert labels[1] == f"minima ({leaves})"
    assert labels[4] == "samples (20)"
