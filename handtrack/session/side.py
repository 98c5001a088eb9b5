"""Whether session.toml names the right side: told where what was tracked fits the other hand decisively better."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from handtrack.arrays import Floats, P, S, evenly_spread
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.model_file import model_from_definition
from handtrack.observation.observation import Observation
from handtrack.session.session import Session
from handtrack.tracking.frame.control import Control
from handtrack.tracking.frame.settings import TrackerSettings
from handtrack.tracking.frame.terms.hand_distance import hand_distance
from handtrack.tracking.search.other_side import other_side_log_odds

_SAMPLED = 4  # frames, evenly spread
_DECISIVE = 5.0  # log-odds, 150 to 1; docs/contributing/testing.md


def wrong_side_warning(
    session: Session,
    settings: TrackerSettings,
    model: ArticulatedModel,
    tracked: Mapping[int, Floats[S]],
    control: Control = Control(),
) -> str:
    """Return that the hand is the other one, in words; empty where that is not clear.

    A flat hand seen from afar is like the other one's back: nothing is told of it.

    Parameters
    ----------
    tracked
        Joint parameters by frame.
    """
    if model.kind != "hand" or not model.has_keypoints21 or not tracked:
        return ""
    frames = sorted(tracked)
    rows = evenly_spread(len(frames), _SAMPLED)
    other_side = "left" if model.side == "right" else "right"
    other = model_from_definition(
        model.definition_text, other_side, model.scale, model.has_forearm, model.name
    )
    alone = settings.with_values({"tracker.hypotheses": 1})

    def samples() -> Iterator[tuple[Observation, Floats[P]]]:
        for frame in (frames[row] for row in rows):
            params = model.solver_params(tracked[frame])
            near = hand_distance(model, model.bones(params))
            used = settings.silhouettes.weight > 0, settings.cloud.weight > 0
            yield session.observation(frame, *used, near), params

    odds = other_side_log_odds(model, other, alone, samples(), control)
    if odds < _DECISIVE:
        return ""
    return (
        f"a {other_side} hand fits the observations decisively better than a {model.side} one (log-odds {odds:.1f} in "
        f'{len(rows)} frames). Is side = "{model.side}" right in session.toml? If it is: are two cameras exchanged?'
    )
