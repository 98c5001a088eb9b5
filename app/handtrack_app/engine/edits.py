"""Edits: what a wish of the user's makes of the session's state. They read the document and change nothing."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence

import msgspec

from handtrack.errors import HandtrackError
from handtrack.model.articulated import HandScale
from handtrack.session.session_state import (
    NOTHING,
    CameraCorrection,
    DecidedSize,
    Edit,
    accepting,
    decide,
    in_turn,
)
from handtrack.store.history import Span
from handtrack.store.store import clipped, resolved
from handtrack.tracking.frame.methods import METHODS
from handtrack_app.engine.document import Document


def is_slid(*values: object) -> bool:
    """Return whether values are numbers, of which a drag of a slider gives many: a click gives one, and is a step of its own."""
    return all(isinstance(value, int | float) and not isinstance(value, bool) for value in values)


def accepted(document: Document, frames: Iterable[int], on: bool) -> Edit:
    """Accept frames as they are, or let them go; those alone that have a pose."""
    named = document.accepted.union(frames) if on else document.accepted.difference(frames)
    now = {f for f in named if f in document.by_hand or f in document.results}
    return NOTHING if now == document.accepted else accepting(now)


def restored(document: Document, number: int) -> Edit:
    """Make a take current again; accepted frames stay. Raises HandtrackError."""
    take, state, frames_of = document.takes.get(number), document.state, document.takes.frames_of
    if take is None or not len(take):
        raise HandtrackError(f"Take {number} has no frames that could be shown.")
    shown = resolved(state.spans, frames_of)
    laid = [Span(number, min(take), max(take) + 1), *clipped(shown, state.accepted)]
    spans = resolved(laid, frames_of)
    return in_turn(model_of_take(document, number), decide(spans=spans))


def model_of_take(document: Document, number: int) -> Edit:
    """Use the model that a take was tracked with, so that its frames can show; nothing where it is in force. Raises
    HandtrackError where no setting makes it.
    """
    take, run = document.takes.get(number), document.run
    if take is None or take.parameter_names == run.model.parameter_names:
        return NOTHING
    name, changed = "model.name", list[Edit]()
    wanted = json.loads(take.labels.settings or "{}").get(name, "")
    if wanted != run.settings.flat()[name]:
        changed.append(decide(setting={name: wanted}))
        run = run.with_values({name: wanted})
    if take.parameter_names != run.model.parameter_names:
        run = run.with_parameters(take.parameter_names)
        if document.run.leaves_forearm_open:
            changed.append(decide(forearm=run.arm_m))
        else:
            changed.append(decide(setting={"model.forearm": str(run.forearm).lower()}))
    if take.parameter_names != run.model.parameter_names:
        raise HandtrackError(
            f"Take {number} cannot be shown: it was tracked with the parameters {', '.join(take.parameter_names[6:]) or 'of a rigid body'}, "
            f"and no setting gives the {run.model.kind} of this session these."
        )
    return in_turn(*changed)


def method(document: Document, value: object) -> Edit:
    """Change the method, with all that it sets, and what the one before had set; back to the session's own brings its own
    values back. Raises HandtrackError.
    """
    now, own = document.run.settings, document.saved["setting"]
    chosen = now.with_values({"method": value})
    wanted = own if chosen.method == own["method"] else chosen.flat()
    touched = ("method", *METHODS[now.method].values, *METHODS[chosen.method].values)
    return decide(setting={name: wanted[name] for name in touched})


def size(scale: HandScale, pending: bool = False, live: HandScale | None = None) -> Edit:
    """Change the hand's size. pending: it is still to be fitted; live: what it was before refining, for tracking to begin with."""
    return decide(size=DecidedSize(scale, pending, live))


def corrected_cameras(document: Document, cameras: Sequence[str]) -> Edit:
    """Correct cameras by what the estimate of the whole recording found of them. Raises HandtrackError."""
    known, earlier = document.camera_errors, document.session.corrections
    corrections = dict[str, CameraCorrection]()
    for camera in cameras:
        if camera not in known:
            raise HandtrackError(
                f"No error of camera '{camera}' was estimated, or it is corrected already."
            )
        corrections[camera] = known[camera]
        if camera in earlier:
            error = known[camera].error.after(earlier[camera].error)
            corrections[camera] = msgspec.structs.replace(known[camera], error=error)
    return decide(camera=corrections)


def arm(document: Document, arm_m: float) -> Edit:
    """Give the model the forearm that was found, where that is left to the program."""
    asked = document.run.leaves_forearm_open and document.run.arm_m != arm_m
    return decide(forearm=arm_m) if asked else NOTHING
