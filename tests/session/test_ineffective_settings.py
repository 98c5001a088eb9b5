"""Settings that mean nothing to what is tracked are named, with the reason; those that count are not."""

from dataclasses import dataclass

import pytest

from handtrack.session.ineffective_settings import ineffective_settings
from handtrack.session.session_file import CameraSettings
from handtrack.tracking.frame.settings import TrackerSettings


@dataclass(frozen=True)
class FakeView:
    """A camera."""

    settings: CameraSettings


@dataclass(frozen=True)
class Recording:
    """What a session has to track by."""

    masks: str | None = "masks/*.png"
    images: str | None = None
    has_clouds: bool = False

    @property
    def views(self) -> tuple[FakeView, ...]:
        return (FakeView(CameraSettings("cam0", images=self.images, masks=self.masks)),)


@pytest.mark.parametrize(
    ("values", "seen", "said"),
    [
        ({}, Recording(), []),
        ({"cloud.weight": 0, "silhouettes.outline_sigma_mm": 2}, Recording(), []),
        ({"cloud.balance": 0.2}, Recording(has_clouds=True), []),
        (
            {"cloud.balance": 0.2, "cloud.sigma_mm": 3},
            Recording(),
            ["cloud.balance and cloud.sigma_mm have no effect: there are no [clouds]."],
        ),
        (
            {"cloud.balance": 0.2, "cloud.weight": 0},
            Recording(has_clouds=True),
            ["cloud.balance has no effect: cloud.weight is 0."],
        ),
        (
            {"silhouettes.term": "conic_field"},
            Recording(masks=None),
            ["silhouettes.term has no effect: no camera has masks."],
        ),
        (
            {"edges.sigma_px": 3, "edges.weight": 1},
            Recording(),
            ["edges.sigma_px has no effect: no camera has images."],
        ),
        ({"edges.sigma_px": 3, "edges.weight": 1}, Recording(images="cam0.mp4"), []),
        ({"mixture.draws": 9, "tracker.hypotheses": 2}, Recording(), []),
        (
            {"mixture.draws": 9},
            Recording(),
            ["mixture.draws has no effect: tracker.hypotheses is 1."],
        ),
        (
            {"model.spread_ring": 0.5},
            Recording(),
            ["model.spread_ring has no effect: it is for model.coupling = 18, which is 26."],
        ),
        ({"model.spread_ring": 0.5, "model.coupling": "18"}, Recording(), []),
    ],
)
def test_only_what_is_idle_is_named(values, seen, said):
    assert ineffective_settings(TrackerSettings().with_values(values), seen, "hand") == said
