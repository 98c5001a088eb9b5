"""Settings by dotted name."""

from __future__ import annotations

import pytest

from handtrack.errors import HandtrackError
from handtrack.tracking.frame.settings import TrackerSettings

CONTRACT = ("silhouettes.term", "silhouettes.weight", "model.name", "model.coupling", "solver.iterations",
            "tracker.jumps", "tracker.smoothing")  # fmt: skip


def test_the_names_that_scripts_rely_on_exist():
    assert set(CONTRACT) <= set(TrackerSettings().flat())


def test_strings_are_read_as_their_kind():
    settings = TrackerSettings().with_values(
        {
            "solver.iterations": "12",
            "silhouettes.bands_mm": "6, 1.5",
            "tracker.jumps": "true",
            "tracker.smoothing": "false",
            "silhouettes.term": "conic_field",
            "model.coupling": 21,
        }
    )
    assert settings.solver.iterations == 12
    assert settings.silhouettes.bands_mm == (6.0, 1.5)
    assert settings.tracker.jumps is True
    assert settings.tracker.smoothing == 0.0
    assert settings.model.coupling == "21"


def test_flat_and_with_values_are_inverse():
    settings = TrackerSettings().with_values({"prior.rest_sigma_deg": 10})
    assert TrackerSettings().with_values(settings.flat()) == settings


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"silhouettes.wieght": 1}, "no setting 'silhouettes.wieght'; known: cloud.balance, cloud.crop_mm"),
        ({"solver": 1}, "no setting 'solver'"),
        ({"solver.iterations": "many"}, "setting 'solver.iterations': expected a value of kind int, found 'many'"),
        ({"solver.iterations": 2.5}, "expected a value of kind int, found 2.5"),
        ({"silhouettes.weight": "nan"}, "expected a value of kind float, found 'nan'"),
        ({"silhouettes.weight": -1}, "setting 'silhouettes.weight': expected a number of at least 0, found -1.0"),
        ({"silhouettes.term": "edges"}, "expected one of coverage, conic_field, found 'edges'"),
        ({"silhouettes.bands_mm": "4,0"}, "expected widths above 0"),
        ({"tracker.jumps": "perhaps"}, "expected a value of kind bool"),
        ({"model.coupling": "20"}, "expected one of 26, 21, 18, found '20'"),
    ],
)  # fmt: skip
def test_errors_name_the_setting_and_what_is_known(values, message):
    with pytest.raises(HandtrackError) as caught:
        TrackerSettings().with_values(values)
    assert message in str(caught.value)
