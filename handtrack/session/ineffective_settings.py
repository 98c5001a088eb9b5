"""Settings that were changed and mean nothing to what is tracked: another model, evidence that is not there or not used."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Protocol

from handtrack.session.session_file import CameraSettings
from handtrack.tracking.frame.settings import SETTINGS, TrackerSettings


class _View(Protocol):
    @property
    def settings(self) -> CameraSettings: ...


class Evidence(Protocol):
    """What a recording has to track by; see session.session.Session."""

    @property
    def views(self) -> Sequence[_View]: ...
    @property
    def has_clouds(self) -> bool: ...


def ineffective_settings(settings: TrackerSettings, seen: Evidence, kind: str) -> list[str]:
    """Return a sentence on the changed settings that have no effect, for each reason. kind: of the model, hand or body."""
    flat, usual = settings.flat(), settings.usual
    changed = [
        name
        for name, known in SETTINGS.items()
        if flat[name] != usual[name] and known.about in ("", kind)
    ]
    found = settings.without_effect(kind)
    for prefix, why in _reasons(settings, seen):
        without = [n for n in changed if n.startswith(prefix) and not n.endswith(".weight")]
        if without:
            has = "have" if len(without) > 1 else "has"
            found.append(f"{' and '.join(without)} {has} no effect: {why}.")
    return found


def _reasons(settings: TrackerSettings, seen: Evidence) -> Iterator[tuple[str, str]]:
    """Yield how names of ineffective settings begin, and why."""
    cameras = [view.settings for view in seen.views]
    there = {
        "silhouettes": any(camera.masks is not None for camera in cameras),
        "cloud": seen.has_clouds,
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
