"""Settings by dotted name: what each may be, other names, and that every one is declared once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import pytest

from handtrack.errors import HandtrackError
from handtrack.setting import NotAcceptedError, declared, setting
from handtrack.tracking.frame.settings import ALIASES, TrackerSettings

CONTRACT = ("silhouettes.term", "silhouettes.weight", "cloud.weight", "cloud.balance", "model.name", "model.coupling",
            "solver.iterations", "tracker.jumps", "tracker.smoothing")  # fmt: skip


def test_the_names_that_scripts_rely_on_exist():
    assert {ALIASES.get(name, name) for name in CONTRACT} <= set(TrackerSettings().flat())


def test_strings_are_read_as_their_kind():
    settings = TrackerSettings().with_values(
        {
            "solver.iterations": "12",
            "silhouettes.bands_mm": "6, 1.5",
            "tracker.recovery": "true",
            "tracker.smoothing": "false",
            "silhouettes.term": "conic_field",
            "model.coupling": 21,
            "model.forearm": True,
        }
    )
    assert settings.solver.iterations == 12
    assert settings.silhouettes.bands_mm == (6.0, 1.5)
    assert settings.tracker.recovery is True
    assert settings.tracker.smoothing == 0.0
    assert settings.model.coupling == "21"
    assert settings.model.forearm == "true"


def test_flat_and_with_values_are_inverse():
    settings = TrackerSettings().with_values({"prior.rest_sigma_deg": 10})
    assert TrackerSettings().with_values(settings.flat()) == settings


def test_another_name_is_read_and_the_own_one_beside_it_wins():
    assert TrackerSettings().with_values({"tracker.jumps": "false"}).tracker.recovery is False
    both = {"tracker.recovery": True, "tracker.jumps": False}
    assert TrackerSettings().with_values(both).tracker.recovery is True


def test_what_means_nothing_to_the_model_is_told():
    settings = TrackerSettings().with_values({"prior.collision": False, "model.fit_size": "later"})
    assert not settings.without_effect("hand")
    assert settings.without_effect("body") == [
        "model.fit_size = later has no effect: it is about a hand, and the model is a body."
    ]


@dataclass(frozen=True)
class _Declared:
    share: float = setting(0.5, "From 0 to 1.", low=0.0, high=1.0)
    width: float | None = setting(2.0, "Above 0, or off.", above=0.0, unit="mm")
    count: int = setting(3, "One at least.", low=1)
    steps: tuple[float, ...] = setting((4.0, 2.0), "Several.", above=0.0)
    way: Literal["on", "off"] = setting("on", "A choice.")
    plain: float = 1.0
    """no setting"""


@pytest.mark.parametrize(
    ("name", "good", "bad", "expected"),
    [
        ("share", (0, 1, "0.5"), (-0.01, 1.01), "a number from 0 to 1"),
        ("width", (1e-9,), (0, -1), "a number above 0 [mm]"),
        ("count", (1, 2.0), (0,), "a whole number of at least 1"),
        ("steps", ("1", [3, 2]), ("1,0", []), "numbers above 0"),
        ("way", ("on",), ("of", True), "one of on, off"),
    ],
)
def test_a_value_is_within_its_bounds(name, good, bad, expected):
    known = declared(_Declared)[name]
    for value in good:
        known.accept(value)
    for value in bad:
        with pytest.raises(NotAcceptedError) as caught:
            known.accept(value)
        assert str(caught.value) == expected


def test_what_is_not_declared_is_no_setting():
    assert "plain" not in declared(_Declared)
    assert [n for n, s in declared(_Declared, "a.").items() if s.optional] == ["a.width"]


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"silhouettes.wieght": 1}, "no setting 'silhouettes.wieght'; known: cloud.balance, cloud.crop_mm"),
        ({"solver": 1}, "no setting 'solver'"),
        ({"solver.iterations": "many"}, "setting 'solver.iterations': expected a value of kind int, found 'many'"),
        ({"solver.iterations": 2.5}, "expected a value of kind int, found 2.5"),
        ({"solver.iterations": 0}, "expected a whole number of at least 1, found 0"),
        ({"silhouettes.weight": "nan"}, "expected a value of kind float, found 'nan'"),
        ({"silhouettes.weight": -1}, "setting 'silhouettes.weight': expected a number from 0 to 1e+08, found -1"),
        ({"silhouettes.term": "edges"}, "expected one of coverage, conic_field, found 'edges'"),
        ({"silhouettes.bands_mm": "4,0"}, "expected numbers above 0 [mm]"),
        ({"cloud.balance": 1.1}, "expected a number from 0 to 1, found 1.1"),
        ({"tracker.jumps": "perhaps"}, "setting 'tracker.recovery': expected a value of kind bool"),
        ({"model.coupling": "20"}, "expected one of 26, 21, 18, found '20'"),
        ({f"model.spread_{f}": 0 for f in ("index", "middle", "ring", "little")}, "no finger would ever spread"),
    ],
)  # fmt: skip
def test_errors_name_the_setting_and_what_is_known(values, message):
    with pytest.raises(HandtrackError) as caught:
        TrackerSettings().with_values(values)
    assert message in str(caught.value)


def test_a21_c34_weights_beyond_all_measure_are_refused():
    with pytest.raises(HandtrackError, match="silhouettes.weight.*from 0 to 1e\\+08"):
        TrackerSettings().with_values({"silhouettes.weight": 1e308})
