"""Scores, reviews and residuals with known answers."""

from types import SimpleNamespace

import pytest

from handtrack import Status, TrackerSettings, load_model
from handtrack.diagnostics import residuals as ri
from handtrack.diagnostics.review import intervals_to_review
from handtrack.diagnostics.score import score
from handtrack.simulation.scenes.simulated_views import mask_views
from handtrack.simulation.simulate import simulated_rig
from handtrack.terms.silhouettes import ConicFieldTerm, CoverageTerm
from handtrack.tracking.frame.reason import Reason
from tests.terms.silhouette_scene import bones_of, ellipsoids_of, silhouettes_of

HAND = load_model("hand26")
CAMERAS = simulated_rig(2, (160, 120)).cameras


def test_the_true_pose_overlaps_and_another_overlaps_less_at_a_higher_energy():
    true = HAND.rest_params()
    true[1] = -0.09
    seen = mask_views(HAND, true, CAMERAS)
    beside = true.copy()
    beside[0] += 0.02
    (overlap, energy), (less, more) = (
        score(HAND, TrackerSettings(), seen, pose) for pose in (true, beside)
    )
    assert set(overlap) == {camera.name for camera in CAMERAS}
    assert min(overlap.values()) > 0.9
    assert all(less[name] < share - 0.05 for name, share in overlap.items())
    assert more["coverage"] > 2 * energy["coverage"]


def off(frame, part, probability, status=Status.DOUBTFUL):
    reason = Reason("off", part, "outline", 12.0, probability)
    return SimpleNamespace(frame=frame, status=status, reason=reason, p_off_25mm=probability)


def test_most_frames_off_come_first_with_reason_and_size():
    ring = [off(f, "ring finger", 0.4 + 0.05 * (f == 215)) for f in range(212, 220)]
    thumb = [off(f, "thumb", 0.9) for f in (30, 31)]
    fine = [off(f, "palm", 0.1, Status.TRACKED) for f in range(100, 110)]
    first, second = intervals_to_review([*thumb, *fine, *ring])
    assert (first.first, first.last, first.worst) == (212, 219, 215)
    assert first.expected == pytest.approx(8 * 0.4 + 0.05)
    assert "0.45" in str(first)
    assert (second.first, second.last) == (30, 31), "1.8 frames are expected to be off"


def test_parts_have_stretches_of_their_own_and_short_gaps_are_bridged():
    thumb = [off(f, "thumb", 0.5) for f in (*range(10, 18), 19, 20, 40)]
    palm = [off(f, "palm", 0.5) for f in (18, *range(21, 28))]
    found = {(s.first, s.last) for s in intervals_to_review(sorted([*thumb, *palm], key=lambda f: f.frame))}  # fmt: skip
    assert found == {(10, 20), (18, 27), (40, 40)}


def test_what_is_done_needs_no_look():
    frames = [off(f, "thumb", 0.5) for f in range(10)]
    assert [(s.first, s.last) for s in intervals_to_review(frames, done={0, 1, 9})] == [(2, 8)]
    assert intervals_to_review(frames, done=range(10)) == []


@pytest.mark.parametrize("kind", ["field", "depth", "wide", "last"])
def test_the_terms_cost_is_half_the_sum_of_squared_residuals(rng, kind):
    bones, flesh, seen = bones_of(rng), ellipsoids_of(rng), silhouettes_of(rng, full=True)
    if kind in ("field", "depth"):
        term = ConicFieldTerm(seen, flesh, normalised=kind == "field")
    else:
        term = CoverageTerm(seen, flesh, 3.0, bones, antisymmetric=kind == "last")
    cost = 0.0
    for i, silhouette in enumerate(seen):
        residual = ri.residual_image(ri.predicted_image(term, i, bones), silhouette.mask)
        cost += 0.5 * (residual**2).sum()
    assert term.cost(bones) == pytest.approx(cost, rel=1e-9)
