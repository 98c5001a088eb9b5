"""Settings that were changed and mean nothing to what is tracked: another model, evidence that is not there or not used."""

from __future__ import annotations

from collections.abc import Iterator

from handtrack.session.session import Session
from handtrack.session.session_file import BODY_TRACKING
from handtrack.tracking.frame.settings import SETTINGS, TrackerSettings


def ineffective_settings(settings: TrackerSettings, session: Session, kind: str) -> list[str]:
    """Return a sentence on the changed settings that have no effect, for each reason. kind: of the model, hand or body."""
    flat, usual = settings.flat(), dict(settings.usual)
    if kind == "body":
        usual |= {f"{g}.{key}": v for g, table in BODY_TRACKING.items() for key, v in table.items()}
    changed = [
        name
        for name, known in SETTINGS.items()
        if flat[name] != usual[name] and known.about in ("", kind)
    ]
    found = settings.without_effect(kind)
    for prefix, why in _reasons(settings, session):
        without = [n for n in changed if n.startswith(prefix) and not n.endswith(".weight")]
        if without:
            has = "have" if len(without) > 1 else "has"
            found.append(f"{' and '.join(without)} {has} no effect: {why}.")
    return found


def _reasons(settings: TrackerSettings, session: Session) -> Iterator[tuple[str, str]]:
    """Yield how names of ineffective settings begin, and why."""
    cameras = [view.settings for view in session.views]
    there = {
        "silhouettes": any(camera.masks is not None for camera in cameras),
        "cloud": session.has_clouds,
        "edges": any(camera.images is not None for camera in cameras),
        "intensity": any(camera.images is not None for camera in cameras),
    }
    needs = {"silhouettes": "no camera has masks", "cloud": "there are no [clouds]"}
    for name, is_there in there.items():
        if not is_there:
            yield f"{name}.", needs.get(name, "no camera has images")
        elif settings.flat()[f"{name}.weight"] == 0:
            yield f"{name}.", f"{name}.weight is 0"
    if settings.tracker.hypotheses == 1:
        yield "mixture.", "tracker.hypotheses is 1"
    if settings.model.coupling != "18":
        yield "model.spread_", f"it is for model.coupling = 18, which is {settings.model.coupling}"
