"""Each paper's method by name: what it sets, that each trait does what the paper's equation says, and that each tracks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.distance import cdist

from handtrack.capture.clouds.point_cloud import PointCloud
from handtrack.errors import HandtrackError
from handtrack.model.model_file import load_model
from handtrack.model.surfaces.metaballs import MetaballSurface
from handtrack.model.surfaces.surface_mesh import carried_mesh, sample_surface
from handtrack.observation.observation import ImageKeypoints, ImageView, Observation
from handtrack.sampling.chains import Chain
from handtrack.sampling.diffusion import long_tailed
from handtrack.solver.problem import Problem
from handtrack.terms.priors.priors import CorrelatedPrior
from handtrack.tracking.frame.control import Control
from handtrack.tracking.frame.descent import descend
from handtrack.tracking.frame.frame_terms import FrameTerms, frame_terms
from handtrack.tracking.frame.methods import METHODS
from handtrack.tracking.frame.result import Status
from handtrack.tracking.frame.settings import SETTINGS, TrackerSettings
from handtrack.tracking.frame.terms.cloud_terms import cloud_terms, see_cloud
from handtrack.tracking.hypotheses.mixture import MixtureStep
from handtrack.tracking.hypotheses.motion_belief import MotionBelief
from handtrack.tracking.hypotheses.next_hypotheses import Component
from handtrack.tracking.search.policy import SHIFTED_FINGERS
from handtrack.tracking.sequence import track_frames
from handtrack.tracking.state import TrackerState
from handtrack.tracking.tracker import Tracker
from handtrack_app.commands.terminal.track_options import parse_sources
from tests.experiments.silhouettes.binary_fist import scene
from tests.model.metaballs_reference import merged
from tests.terms.conic_field_reference import dense_field

PAPERS = ("paper2007", "paper2004", "paper2003")
HAND, BALL = load_model(), load_model("ball6")


def settings(method, **values):
    return TrackerSettings().with_values({"method": method} | values)


@pytest.mark.parametrize("name", METHODS)
def test_a_method_sets_what_it_says(name):
    chosen, method = settings(name), METHODS[name]
    assert (chosen.method, chosen.traits) == (name, method.traits)
    flat = chosen.flat()
    for setting, value in method.values.items():
        assert flat[setting] == SETTINGS[setting].accept(value) == value
    others = set(flat) - set(method.values) - {"method"}
    assert all(flat[setting] == SETTINGS[setting].default for setting in others)
    assert TrackerSettings().with_values(flat) == chosen


def test_what_is_given_beside_a_method_wins_and_the_method_over_what_was_there():
    before = {
        "solver.iterations": 12,
        "cloud.balance": 0.3,
        "cloud.doubt_depth": True,
        "cloud.distance": "d1",
    }
    of_session = TrackerSettings().with_values(before)
    asked = of_session.with_values({"method": "paper2004"})
    assert (asked.solver.iterations, asked.cloud) == (100, settings("paper2004").cloud)
    assert settings("paper2004", **{"solver.iterations": "20"}).solver.iterations == 20
    both = of_session.with_values({"solver.iterations": 20, "method": "paper2004"})
    assert both.solver.iterations == 20


def test_another_method_takes_back_what_the_one_before_had_set():
    own = settings("paper2007", **{"silhouettes.weight": 2.0})
    back = own.with_values({"method": "default"})
    assert back == TrackerSettings().with_values({"silhouettes.weight": 2.0})
    assert own.with_values({"method": "paper2004"}).solver.limits == "projection"


def test_an_unknown_method_is_refused():
    with pytest.raises(
        HandtrackError, match="setting 'method': expected one of default, paper2007"
    ):
        settings("paper1999")


def test_use_brings_back_what_a_method_leaves_out():
    asked = parse_sources("silhouettes,keypoints", settings("paper2007"))
    assert asked == {
        "cloud.weight": 0,
        "edges.weight": 0,
        "intensity.weight": 0,
        "keypoints.weight": 1,
    }


# ---- 2007


@pytest.fixture(scope="module")
def fist():
    return scene(3, 100, (160, 120), range(0, 5))


def test_silhouettes_cost_half_the_sum_of_all_pixels_squares(fist):
    """Eq. 2, pixel by pixel."""
    seen, params = fist.observations[0], fist.model.rest_params()
    params[:6] = fist.joint_params[1][:6] + 0.01
    bones = fist.model.bones(params)
    terms = frame_terms(fist.model, settings("paper2007"), seen, bones, None)
    assert (terms.priors, terms.parts, terms.stages) == ((), (), 1)
    kept = [
        replace(s, valid=p.valid)  # without what lies behind the wrist
        for s, p in zip(seen.silhouettes, terms.prepared, strict=True)
    ]
    plain = dense_field(kept, fist.model.flesh["fine"], bones)
    for inside in (settings("paper2007").traits.inside, -1.0):
        chosen = settings("paper2007")
        chosen = replace(chosen, traits=replace(chosen.traits, inside=inside))
        (term,) = frame_terms(fist.model, chosen, seen, bones, None).stage(0, bones)
        expected = 0.5 * float(((plain.predicted + inside * plain.observed) ** 2).sum())
        assert term.cost(bones) == pytest.approx(expected, rel=1e-5)


def test_the_inside_of_a_mask_is_about_the_mean_of_the_field_that_a_hand_has_there(fist):
    """A constant that is far from it bends fingers until the field is nearer (six cameras: docs/explanation/accuracy.md)."""
    means = []
    for params, seen in zip(fist.joint_params, fist.observations, strict=True):
        bones = fist.model.bones(fist.model.transform.solver_params(params))
        plain = dense_field(list(seen.silhouettes), fist.model.flesh["fine"], bones)
        means.append(plain.predicted.mean(where=plain.predicted < 0.0))
    assert settings("paper2007").traits.inside == pytest.approx(np.mean(means), abs=0.05)


def test_without_limits_a_joint_bends_where_it_never_could(fist):
    names = fist.model.transform.names
    column = names.index("index_pip_flex")
    low = fist.model.bounds(fist.model.rest_params())[column, 0]
    beyond = fist.model.transform.solver_params(fist.joint_params[0])
    beyond[column] = low - 0.3
    seen = Observation(0, 0.0, silhouettes=())
    likely = CorrelatedPrior(beyond, np.eye(len(beyond)))
    for method, ends in (("paper2007", low - 0.3), ("default", low)):
        chosen = settings(method)
        terms = frame_terms(fist.model, chosen, seen, fist.model.bones(beyond), None)
        terms = replace(terms, priors=(likely,))
        start = fist.model.transform.solver_params(fist.joint_params[0])
        found = descend(fist.model, chosen.solver, terms, start)[0].params
        assert found[column] == pytest.approx(ends, abs=1e-3)


# ---- 2004


@pytest.fixture(scope="module")
def ball_cloud():
    rng = np.random.default_rng(0)
    points, _ = sample_surface(MetaballSurface.of(BALL), BALL.bones(np.zeros(6)), 400, rng)
    return points[points[:, 2] > 0.0]  # seen from one side


@pytest.mark.parametrize(("distance", "beta"), [("d1", 1.0), ("d2", 1.0), ("d3", 0.4)])
def test_a_cloud_costs_what_the_papers_sums_say(ball_cloud, distance, beta):
    """F = K Σ d(X)² + (1 − K) Σ D(Y)² in square millimetres, halved: each point 1, no matter how far, on the whole surface."""
    chosen = settings(
        "paper2004",
        **{"cloud.balance": 0.3, "cloud.distance": distance, "cloud.sharpness_per_mm": beta},
    )
    behind = np.array([[0.0, -2.0, 0.0]])  # a view that sees none of what was measured
    points = np.concatenate([ball_cloud, ball_cloud[:5] + [0.0, 0.0, 0.05]])
    seen = Observation(0, 0.0, cloud=PointCloud(points), cloud_views=(behind,))
    bones = BALL.bones(np.array([0.003, -0.004, 0.002, 0.0, 0.1, 0.0]))
    found = see_cloud(seen, BALL, bones, chosen)
    assert found is not None
    assert found.prepared.count == len(points)  # 10 cm around
    cloud_side, model_side = cloud_terms(found, BALL, chosen, 1.2)
    surface = MetaballSurface.of(BALL, 1e3 * beta, distance)
    e1 = float((merged(surface, bones, points)[0] ** 2).sum())
    assert cloud_side.cost(bones) == pytest.approx(0.5 * 0.3 * 1e6 * e1, rel=1e-6)
    mesh = carried_mesh(BALL, bones, 1e3 * beta, distance)
    e2 = float((cdist(mesh.vertices, points).min(axis=1) ** 2).sum())
    # far from the cloud the nearest of some near points, so within some percent
    assert model_side.cost(bones) == pytest.approx(0.5 * 0.7 * 1e6 * e2, rel=0.04)
    assert found.sharpened(BALL, bones, 0.1) is found


def test_a_cloud_is_measured_to_a_surface_of_the_method_s_sharpness():
    """β: one ellipsoid has none to speak of, so that of a glove, where palm and fingers meet."""
    glove = load_model("glove9")
    bones = glove.bones(glove.rest_params())
    points, _ = sample_surface(MetaballSurface.of(glove), bones, 400, np.random.default_rng(0))
    costs = {}
    for beta in (200.0, 1000.0):
        chosen = settings(
            "paper2004", **{"cloud.balance": 1.0, "cloud.sharpness_per_mm": 1e-3 * beta}
        )
        found = see_cloud(Observation(0, 0.0, cloud=PointCloud(points)), glove, bones, chosen)
        assert found is not None
        off = merged(MetaballSurface.of(glove, beta), bones, points)[0]
        costs[beta] = cloud_terms(found, glove, chosen, 1.2)[0].cost(bones)
        assert costs[beta] == pytest.approx(0.5e6 * float((off**2).sum()), rel=1e-6)
    assert costs[200.0] > 10.0 * costs[1000.0]


def test_fingers_are_shifted_to_both_sides_in_each_frame_and_the_least_energy_wins():
    joint = HAND.rest_params()
    points, _ = sample_surface(
        MetaballSurface.of(HAND), HAND.bones(joint), 1500, np.random.default_rng(0)
    )
    seen = Observation(0, 0.0, cloud=PointCloud(points))
    told = []
    tracker = Tracker(load_model(coupling="21"), settings("paper2004", **{"solver.iterations": 25}))
    start = tracker.model.transform.solver_params(joint)
    state = TrackerState.beginning_at(start)
    for frame in range(2):
        state, result = tracker.step(
            state, replace(seen, frame=frame), Control(on_search=told.append)
        )
    assert [report.frame for report in told] == [0, 1]
    for report in told:
        assert report.search is SHIFTED_FINGERS
        ((proposed, trials),) = report.rounds
        assert proposed == len(trials) == 2
        assert report.winner is None or report.winner.cost < report.standing
        assert min(trial.cost for trial in trials) >= report.standing or report.winner
    truth = HAND.joint_positions(HAND.bones(joint))
    assert 1e3 * np.linalg.norm(result.joint_positions - truth, axis=1).mean() < 1.0
    assert result.status == Status.TRACKED


# ---- 2003


def bell(mean, spread):
    return MotionBelief.at_rest(np.asarray(mean, float), np.diag(np.square(spread)), np.ones(6))


def test_minima_count_by_the_closest_bell_of_the_last_frame():
    """exp(−cost) · weight · ∏ 1/(σ (1 + z²)), whichever hypothesis a minimum was found from."""
    chosen = settings("paper2003", **{"tracker.hypotheses": 3})
    at = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.9])
    likely = CorrelatedPrior(at, np.diag([1e4, 1e4, 1e4, 1e2, 1e2, 1e2]))
    terms = FrameTerms(BALL, chosen, (), (), None, None, (), (likely,))
    spread = np.array([0.01, 0.01, 0.01, 0.2, 0.2, 0.2])
    before = [(0.7, 0.0), (0.3, 1.0)]
    components = [Component(bell([0, 0, 0, 0, 0, a], spread), terms, w) for w, a in before]
    stiff = [type("Stiff", (), {"chain": Chain("none", (), ())})]
    told = []
    step = MixtureStep(BALL, chosen, stiff)
    found = step.next(Observation(0, 0.0), components, Control(on_search=told.append))
    # the likelihood alone is climbed, so both end at its one minimum, and are one
    assert len(found.hypotheses) == 1
    np.testing.assert_allclose(found.hypotheses[0].params, at, atol=1e-4)
    assert found.parents == (1,)
    z = (0.9 - 1.0) / 0.2
    expected = np.log(0.3) - np.log(spread).sum() - np.log1p(z**2)
    (report,) = told
    assert -report.winner.cost == pytest.approx(expected, abs=1e-3)


def test_the_long_tailed_bell_is_cauchys_along_each_axis(rng):
    root = rng.normal(size=(3, 3))
    spread, mean = root @ root.T + 0.1 * np.eye(3), rng.normal(size=3)
    samples = rng.normal(scale=4.0, size=(6, 3))
    height, distance = long_tailed(mean, spread, samples)
    values, vectors = np.linalg.eigh(spread)
    z = (samples - mean) @ vectors / np.sqrt(values)
    np.testing.assert_allclose(height, -np.log(np.sqrt(values) * (1 + z**2)).sum(axis=1))
    inverse = np.linalg.inv(spread)
    expected = [(x - mean) @ inverse @ (x - mean) for x in samples]
    np.testing.assert_allclose(distance, expected)


def test_joints_begin_and_are_not_looked_at_again():
    camera = scene(1, 30, (160, 120), range(0, 1)).observations[0].silhouettes[0].camera
    joints = camera.project(HAND.joint_positions(HAND.bones(HAND.rest_params())))
    marks = ImageKeypoints(camera, HAND.joint_names, joints, 1.0)
    image = ImageView(camera, np.zeros((120, 160, 3), np.uint8))
    seen = Observation(0, 0.0, keypoints=(marks,), images=(image,))
    tracker = Tracker(HAND, settings("paper2003"))
    first = tracker._looked_at(TrackerState.beginning_at(HAND.rest_params()), seen)
    later = tracker._looked_at(TrackerState(), seen)
    assert (first.keypoints, first.images) == ((marks,), ())
    assert (later.keypoints, later.images) == ((), (image,))
    assert Tracker(HAND)._looked_at(TrackerState(), seen) is seen


# ---- each of them tracks


def test_the_2007_method_follows_a_closing_hand(fist):
    start = fist.model.transform.solver_params(fist.joint_params[0])
    tracker = Tracker(fist.model, settings("paper2007"))
    found = list(track_frames(tracker, lambda f, *_: fist.observations[f], 0, start, range(5)))
    off = np.stack([r.joint_positions for r in found]) - fist.joints
    assert (
        1e3 * np.linalg.norm(off, axis=2).mean() < 8.0
    )  # measured 4.2: the term is biased on masks
    assert all(r.iterations <= 10 for r in found)


def test_the_2003_method_carries_hypotheses_by_images_alone(fist):
    """A plain bright hand on black: edges; the pose begins by joints."""
    camera = fist.observations[0].silhouettes[0].camera
    joints = camera.project(fist.joints[0])
    marks = ImageKeypoints(camera, HAND.joint_names, joints, 1.0)
    seen = [
        replace(
            each,
            images=tuple(
                ImageView(
                    s.camera, np.repeat((220 * s.mask).astype(np.uint8)[..., None], 3, axis=2)
                )
                for s in each.silhouettes
            ),
            keypoints=(marks,),
        )
        for each in fist.observations[:2]
    ]
    few = {"solver.iterations": 3, "mixture.draws": 4, "tracker.hypotheses": 3}
    tracker = Tracker(fist.model, settings("paper2003", **few))
    start = fist.model.transform.solver_params(fist.joint_params[0])
    found = list(track_frames(tracker, lambda f, *_: seen[f], 0, start, range(2)))
    assert len(found[0].alternatives) > 1
    assert set(found[1].energies) >= {"edges", "intensity"}
    assert not {"keypoints", "silhouettes"} & set(found[1].energies)
    off = found[1].joint_positions - fist.joints[1]
    assert 1e3 * np.linalg.norm(off, axis=1).mean() < 60.0


def test_a_problem_without_limits_has_none():
    free = Problem(HAND, (), (), unlimited=True)
    assert np.isinf(free.bounds(HAND.rest_params())).all()
    assert np.isinf(free.limits.first).all()
