"""Kinematic jumps beside random samplers, a small Table 1: docs/explanation/one_camera.md has the whole one."""

import numpy as np
import pytest

from handtrack.bench.jump_polish import DenseKeypoints
from handtrack.sampling.hypotheses import angle_distance
from handtrack.simulation.scenes.jump_scene import KJS1, KJS2, LIMBS, full_scene, jump_scene
from tests.derivatives import check_jacobian
from tests.experiments.jumps.minima import EVERYTHING, markdown, sampled, share_of_leaves, table


@pytest.fixture(scope="module")
def scene():
    return full_scene()


@pytest.fixture(scope="module")
def rows(scene):
    return {(each.row.name, each.row.scale): each.row for each in table(scene, samples=32)}


def test_the_scene_has_full_trees(scene):
    """What limits allow: four flips of an arm, two of a leg."""
    assert [len(scene.tree([limb])) for limb in LIMBS] == [4, 4, 2, 2]
    assert len(scene.tree(KJS1)) == 32 and len(scene.tree(KJS2)) == 16


@pytest.mark.parametrize("name", ["KJS1", "KJS2"])
def test_every_leaf_is_a_minimum_of_its_own(rows, name):
    row = rows[name, ""]
    assert row.converged == 1.0
    assert row.minima == row.samples


def test_over_several_poses():
    first, second = (share_of_leaves(limbs, range(6)) for limbs in (KJS1, KJS2))
    assert first.leaves >= 40 and second.leaves >= 20
    assert first.share >= 0.99 and second.share >= 0.95


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


def test_jumps_need_little_polishing(rows):
    jump = rows["KJS1", ""]
    assert jump.cost_raw <= rows["CSS", "4"].cost_raw / 100
    assert abs(jump.std_raw - jump.std_found) < 0.2 * jump.std_found


def test_rows_say_what_was_done(scene, rows):
    """Distances and costs of a row that can be had by hand: the start alone, and the start's mirror images."""
    alone = sampled(scene, "start", "", lambda: scene.start[None], 1).row
    assert (alone.samples, alone.minima) == (1, 1)
    np.testing.assert_allclose([alone.distance_raw, alone.std_raw, alone.cost_raw], 0.0, atol=1e-9)
    twice = sampled(scene, "start", "", lambda: np.stack([scene.start] * 2), 1).row
    assert (twice.samples, twice.minima) == (2, 1)
    off = scene.start + 1e-3 * np.sqrt(np.diag(scene.covariance))
    near = sampled(scene, "near", "", lambda: off[None], 1).row
    assert near.distance_raw == pytest.approx(np.linalg.norm(off - scene.start))
    root = np.linalg.cholesky(np.linalg.inv(scene.covariance))
    assert near.std_raw == pytest.approx(np.linalg.norm(root.T @ (off - scene.start)), rel=1e-3)
    leaves = scene.tree(EVERYTHING).params
    assert len(leaves) > len(scene.tree(KJS1))
    assert angle_distance(scene.start, leaves).max() > 0.3
    lines = markdown(list(rows.values())).splitlines()
    assert len(lines) == 2 + len(rows) and lines[2].startswith("| KJS1 |  | 32 | 32 |")


def test_scipy_is_given_the_same_problem():
    scene = jump_scene(1, collision=False)
    dense, params = DenseKeypoints(scene), scene.start + 0.01
    residual = dense.residual(params)
    ours = scene.polished(scene.start[None]).cost[0]
    at_start = dense.residual(scene.start)
    np.testing.assert_allclose(0.5 * at_start @ at_start, ours, rtol=1e-10)
    check_jacobian(dense.residual, dense.jacobian(params), params, rtol=1e-6)
    assert residual.shape == (2 * len(scene.seen.names) + 32,)
