"""`handtrack person` and `handtrack size`: a person's hand or body from a recording, saved for every other one."""

from __future__ import annotations

from argparse import Namespace
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np

from handtrack.capture.clouds.cloud_filters import fit_skin_ellipse
from handtrack.errors import HandtrackError
from handtrack.files.toml_edit import edit_toml
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.model_file import scale_table, write_scale
from handtrack.model.size import FOREARM_END, shape_numbers, without_forearm_end
from handtrack.session.layout import SESSION_FILE
from handtrack.session.run import TrackingRun
from handtrack.session.session import Session
from handtrack.session.sources.skin_samples import painted_skin, segmented_skin
from handtrack.session.tables import read_npz
from handtrack.tracking.frame.confidence import hand_words
from handtrack.tracking.frame.control import Control
from handtrack.tracking.frame.result import model_of
from handtrack.tracking.size.person import spread_of_track
from handtrack_app.commands.output import (
    INTERRUPTED,
    Answer,
    note,
    output_file,
    print_status,
    saying_compiling,
    share_bar,
    stoppable,
)
from handtrack_app.commands.track import (
    ask_for_other_side,
    asked_for,
    parse_frames,
    search_first_pose,
)

_FILES = {
    "person": {"hand": "person.toml", "body": "person.toml"},
    "size": {"hand": "hand.json", "body": "body.json"},
}
_OF_RECORDINGS = ("frames", "init", "use", "set", "person")


def fit_person(options: Namespace) -> int | Answer:
    """Save the person of a tracked sequence; or track the frames asked for, fit a person to some of them, and save it."""
    if options.spread:
        return _spread(options.session)
    if options.session.suffix.lower() == ".npz":
        return _of_track(options)
    session, overrides, _, first = asked_for(options, {"model.fit_size": False})
    if options.init != "auto":
        ask_for_other_side(session, first or session.init, options.yes)
    frames = parse_frames(options.frames, session.frame_range, session.folder)
    kind = TrackingRun.open(session, overrides, use_init=False).model.kind
    out = _new_file(options.out or session.folder / _FILES[options.command][kind], kind)
    with stoppable() as stop, saying_compiling():
        if options.init == "auto":
            first = search_first_pose(session, overrides, frames, stop, options.yes)
        print_status(
            f"tracking {len(frames)} frames, and fitting the {kind}'s size to {min(options.count, len(frames))} of them …"
        )
        before = after = None
        if not stop():
            before = TrackingRun.open(session, overrides, first, stop)
            with share_bar("sizing") as bar:
                after = before.fit_size(Control(stop, bar), frames, options.count, sizes=True)
        if stop() or before is None or after is None:
            print_status(f"handtrack {options.command}: interrupted; nothing was saved.")
            return INTERRUPTED
    if after.scale is before.scale:
        raise HandtrackError(
            f"{session.folder}: none of the frames {frames.start} to {frames.stop - 1} has a tracked {kind} whose size can be "
            "measured: that needs cameras whose viewing directions differ by at least 20 degrees, or a "
            "cloud. Nothing was saved. Name other frames with --frames."
        )
    note(*after.notes)
    source = f"session {session.name}, frames {frames.start} to {frames.stop - 1}"
    return _saved(out, replace(after.model, scale=replace(after.scale, source=source)))


def _of_track(options: Namespace) -> Answer:
    given = [name for name in _OF_RECORDINGS if getattr(options, name)]
    if given:
        raise HandtrackError(
            f"{options.session} is tracked already: --{given[0]} is for a session. Leave it out, or name the session's folder."
        )
    track = read_npz(options.session)
    model = model_of(track, str(options.session))
    if not model.scale.std:
        raise HandtrackError(
            f"{options.session}: its {model.kind}'s shape is fixed, not estimated from the recording, so there is nothing to save. "
            f'Track with scale = "fit" in [hand] of its {SESSION_FILE}.'
        )
    out = _new_file(
        options.out or options.session.with_name(_FILES[options.command][model.kind]), model.kind
    )
    source = f"{options.session.name} of session {track.session}"
    return _saved(out, replace(model, scale=replace(model.scale, source=source)))


def _saved(out: Path, model: ArticulatedModel) -> Answer:
    """Write a model's shape to a new file; return what it is."""
    rows = [row for row in shape_numbers(model) if row.name != FOREARM_END]
    write_scale(
        out,
        without_forearm_end(model.scale),
        {r.name: r.words if r.is_measured else f"{r.words}, not measured" for r in rows},
    )
    hand, unmeasured = hand_words(model), [row.label for row in rows if not row.is_measured]
    use = f'To use it: copy it into a session and set scale = "{out.name}" in [hand] of its {SESSION_FILE}.'
    if (out.parent / SESSION_FILE).is_file():
        use = f'To use it: in {SESSION_FILE}, [hand], scale = "{out.name}".'
    saved = [
        f"Of the mean adult's: {', '.join(f'{r.label} {r.words}' for r in rows if r.is_measured)}."
    ]
    if unmeasured:
        saved += [
            f"Not measured by this recording, taken from the population mean: {', '.join(unmeasured)}."
        ]
    saved += [f"{hand.capitalize()}." if hand else "", f"Saved to {out}"]
    scale = scale_table(model.scale)
    report = {"scale": scale, "hand": hand, "not_measured": unmeasured, "output": out}
    return Answer(report, [" ".join(filter(None, saved)), use])


def _new_file(out: Path, kind: str) -> Path:
    output_file(out, (".toml", ".json"), "hands of persons are")
    if out.exists():
        raise HandtrackError(
            f"{out} exists, and a person's {kind} is not written over. Name another file with --out, or move it away."
        )
    return out


def _spread(poses: Path) -> Answer:
    """Return the four settings as lines of [tracking], and how well they explain what was seen."""
    track = read_npz(poses)
    try:
        spread = spread_of_track(track)
    except HandtrackError as error:
        raise HandtrackError(f"{poses}: {error}") from None
    frames, left_deg = spread["frames"], np.rad2deg(spread["residual_rad"])
    print_status(
        f"from {frames} {'frame' if frames == 1 else 'frames'}; the linkage leaves {left_deg:.1f}° of the abductions unexplained "
        f"({100 * spread['explained']:.0f} % of their squares explained). Use with model.coupling = 18."
    )
    return Answer(spread, [f"{name} = {value:g}" for name, value in spread["settings"].items()])


# ---- `handtrack skin`: the colour of skin from several images segmented by hand, for the filter of [clouds]


def fit_skin(session: Path, segmented: list[list[str]] | None, size: float) -> Answer:
    """Fit one ellipse in (r, g) to all of them and write it into opened.toml."""
    opened = Session.open(session)
    if opened.file.clouds is None:
        raise HandtrackError(
            f"{opened.folder / SESSION_FILE}: no table [clouds], whose filter the skin's colour is. Masks by skin colour are "
            'a camera\'s: masks = { method = "skin_ycrcb" }.'
        )
    if segmented:
        pairs = [(Path(image), Path(mask)) for image, mask in segmented]
        samples = segmented_skin(pairs)
    else:
        samples = painted_skin(opened)
    skin = fit_skin_ellipse(*samples, size=size)
    kept = edit_toml(
        opened.folder / SESSION_FILE, {"clouds.skin": asdict(skin)}, "a session's settings"
    )
    (red, green), images = skin.mean, len(samples)
    if images == 1:
        note("one image; a second under other light makes the ellipse hold there as well.")
    pixels = sum(map(len, samples))
    words = (
        f"{pixels} pixels of {images} {'image' if images == 1 else 'images'}: r = {red:.3f}, g = {green:.3f}. "
        f"[clouds] of {SESSION_FILE}: skin.{kept}"
    )
    return Answer({"pixels": pixels, "images": images, "r": red, "g": green}, [words])
