"""What is reported of a shape holds for hands drawn from what is known of people; all of them: `handtrack bench simulated_hands`."""

from tests.experiments.honesty.simulated_hands import simulated_hands


def test_reported_regions_of_a_shape_hold():
    figures = simulated_hands(range(1, 4))
    for kind in ("masks", "joints"):
        assert 0.8 < figures[f"{kind}_numbers_in_90_region"] <= 1.0
        assert figures[f"{kind}_off_by_people_std"] < 0.85, "the frames tell something"
        assert figures[f"{kind}_length_off_mm"] < 3.0
