"""Kinematic jumps beside random samplers, a small Table 1: docs/explanation/one_camera.md has the whole one."""

import pytest

from handtrack.simulation.scenes.jump_scene import full_scene
from tests.experiments.jumps.minima import table


@pytest.fixture(scope="module")
def scene():
    return full_scene()


@pytest.fixture(scope="module")
def rows(scene):
    return {(each.row.name, each.row.scale): each.row for each in table(scene, samples=32)}


@pytest.mark.parametrize("name", ["KJS1", "KJS2"])
def test_every_leaf_is_a_minimum_of_its_own(rows, name):
    row = rows[name, ""]
    assert row.converged == 1.0
    assert row.minima == row.samples


def test_the_order_of_samplers(rows):
    """At equal samples jumps find more minima than covariance-scaled samples, and these more than spherical ones."""
    most = {
        name: max(r.minima_at_equal for (n, _), r in rows.items() if n == name) for name in ("SS", "CSS")
    }  # fmt: skip
    assert rows["KJS1", ""].minima > most["CSS"] >= most["SS"]
    for scale in ("1", "4", "8", "16", "1/HT"):
        css, ss = rows["CSS", scale], rows["SS", scale]
        assert css.minima >= ss.minima
    assert sum(rows["CSS", s].minima for s in ("4", "8", "16", "1/HT")) > 1.2 * sum(
        rows["SS", s].minima for s in ("4", "8", "16", "1/HT")
    )
