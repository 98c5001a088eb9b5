"""Settings by dotted name: what each may be, other names, and that every one is declared once."""

from dataclasses import dataclass
from typing import Literal

import pytest

from handtrack import TrackerSettings
from handtrack.setting import declared, setting


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
    ("name", "good", "bad"),
    [
        ("share", (0, 1, "0.5"), (-0.01, 1.01)),
        ("width", (1e-9,), (0, -1)),
        ("count", (1, 2.0), (0,)),
        ("steps", ("1", [3, 2]), ("1,0", [])),
        ("way", ("on",), ("of", True)),
    ],
)
def test_a_value_is_within_its_bounds(name, good, bad):
    known = declared(_Declared)[name]
    for value in good:
        known.accept(value)
    for value in bad:
        with pytest.raises(ValueError, match=r"\w"):
            known.accept(value)
