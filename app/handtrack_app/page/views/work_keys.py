"""Keys, and entries of the palette, for the work itself: frames, tracking, keyframes, saving, export."""

from __future__ import annotations

from typing import TYPE_CHECKING

from handtrack_app.page.page import Action, Keys, Page
from handtrack_app.page.panels.tracking import TrackingPanel

if TYPE_CHECKING:
    from handtrack_app.viser_internals import KeyModifier

_TEN = 10
_Entry = tuple[str, str | None, "KeyModifier | None", Action]


def add_work_keys(keys: Keys, page: Page, tracking: TrackingPanel) -> None:
    """Add them; each does what a button of the page does. Not W, A, S, D, Q, E, with whatever else: viser walks by them."""
    state = page.state

    def keyframe() -> None:
        if state.values:
            values = state.values
            page.engine.set_pose(state.frame, values, state.begin_edit(), words="Keyframe")

    entries: list[_Entry] = [
        ("Undo", "Z", "cmd/ctrl", lambda _: page.travel(back=True)),
        ("Redo", "Z", "cmd/ctrl+shift", lambda _: page.travel(back=False)),
        ("Redo", "Y", "cmd/ctrl", lambda _: page.travel(back=False)),
        ("Before/after: the pose before the last step", "tab", None, lambda _: page.flip()),
        ("Play or pause", "space", None, lambda _: page.play(not state.playing)),
        ("Next frame", "arrowright", None, lambda _: page.go_to(state.frame + 1)),
        ("Previous frame", "arrowleft", None, lambda _: page.go_to(state.frame - 1)),
        (
            "Hide or show the model",
            "H",
            None,
            lambda _: page.draw("hidden", not state.display.hidden),
        ),
        ("Ten frames on", "arrowright", "shift", lambda _: page.go_to(state.frame + _TEN)),
        ("Ten frames back", "arrowleft", "shift", lambda _: page.go_to(state.frame - _TEN)),
        ("First frame", "home", None, lambda _: page.go_to(state.start)),
        ("Last frame", "end", None, lambda _: page.go_to(state.stop - 1)),
        ("Next frame of low confidence, or lost", "N", "shift", lambda _: tracking.go_to_odd()),
        ("Keep this pose: a keyframe", "M", None, lambda _: keyframe()),
        (
            "No keyframe here: the tracked pose",
            "M",
            "shift",
            lambda _: page.engine.forget_pose(state.frame, state.begin_edit()),
        ),
        ("Track: from here on", "T", "shift", lambda _: tracking.start("forward ▶")),
        ("Track: from here back", "B", "shift", lambda _: tracking.start("◀ backward")),
        ("Track: all frames", None, None, lambda _: tracking.start("all")),
        ("Track: pause, and go on", "P", "shift", lambda _: tracking.pause_or_go_on()),
        ("Track: cancel", "C", "shift", lambda _: page.engine.cancel()),
        ("Refine all frames together", "R", "shift", lambda _: page.engine.refine()),
        ("Save the track", "V", "shift", lambda _: page.engine.save_track()),
        ("Save this pose as the first frame's", None, None, lambda _: page.engine.save_pose()),
        ("Export angles and positions (CSV)", "O", "shift", _export(page, "csv")),
        ("Export everything (NPZ)", None, None, _export(page, "npz")),
    ]
    for words, key, modifier, act in entries:
        keys.add(words, key, page.from_user(act), modifier)


def _export(page: Page, kind: str) -> Action:
    return lambda event: page.engine.export(kind, event.client.client_id)
