"""A person's hand size from masks alone."""

import pytest

from handtrack.model.articulated import HAND_PARTS, HandScale
from handtrack.model.model_file import load_model
from handtrack.model.size import hand_length_mm
from handtrack.tracking.frame.settings import TrackerSettings
from handtrack.tracking.size.person import OpenPerson
from handtrack.tracking.state import TrackerState
from handtrack.tracking.tracker import Tracker
from handtrack.tracking.whole.chosen_frames import fit_person
from tests.experiments.silhouettes.binary_fist import Scene, scene

LARGER = 1.06


@pytest.fixture(scope="module")
def larger() -> Scene:
    """A hand 6 % larger than the mean adult's, in four frames on the way from open to curled."""
    whole = scene(3, 25, (320, 240), range(0, 8), load_model(scale=LARGER))
    return Scene(whole.model, whole.joint_params[::2], whole.observations[::2])


def fitted(larger, coupling, **more):
    """Return the size found from the mean adult's hand, posed with that wrong size first."""

    def build(size):
        return load_model(scale=size, coupling=coupling)

    settings = TrackerSettings()
    model = build(HandScale())
    poses = []
    for seen, joint in zip(larger.observations, larger.joint_params, strict=True):
        start = model.transform.solver_params(joint)
        _, result = Tracker(model, settings).step(TrackerState.beginning_at(start), seen)
        poses.append(model.transform.solver_params(result.parameters))
    return fit_person(OpenPerson(build), model, settings, larger.observations, poses, **more)


@pytest.mark.parametrize("coupling", ["26", "18"])
def test_a_larger_hand_is_found(larger, coupling):
    scale = fitted(larger, coupling)
    assert scale.overall == pytest.approx(LARGER, rel=0.015)
    for finger in ("index", "middle", "ring", "little"):
        assert scale.overall * scale.parts[finger] == pytest.approx(LARGER, rel=0.02)
    off_mm = hand_length_mm(load_model(scale=scale)) - hand_length_mm(larger.model)
    assert 0.2 < scale.std["length_mm"] < 3.0
    assert abs(off_mm) < 3 * scale.std["length_mm"]
    assert set(scale.std) == {"length_mm", "overall", *HAND_PARTS, *scale.proportions}
    assert all(0.0 < scale.std[name] <= 1.0 for name in scale.proportions)
    assert scale.std["forearm"] == pytest.approx(0.12, rel=0.1), "nothing was seen of it"
