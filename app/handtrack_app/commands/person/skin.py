"""`handtrack skin`: the colour of skin from several images segmented by hand, for the filter of [clouds]."""

from __future__ import annotations

import argparse
from dataclasses import asdict
from pathlib import Path

from handtrack.capture.clouds.skin_ellipse import fit_skin_ellipse
from handtrack.errors import HandtrackError
from handtrack.files.toml_edit import edit_toml
from handtrack.session.layout import SESSION_FILE
from handtrack.session.session import Session
from handtrack.session.sources.skin_samples import painted_skin, segmented_skin
from handtrack_app.commands.terminal.answer import answer
from handtrack_app.commands.terminal.progress import say


def run(args: argparse.Namespace) -> int:
    """Fit one ellipse in (r, g) to all of them and write it into session.toml."""
    session = Session.open(args.session)
    if session.file.clouds is None:
        raise HandtrackError(
            f"{session.folder / SESSION_FILE}: no table [clouds], whose filter the skin's colour is. Masks by skin colour are "
            'a camera\'s: masks = { method = "skin_ycrcb" }.'
        )
    if not args.size > 0:
        raise HandtrackError(f"--size {args.size:g}: expected standard deviations above 0.")
    if args.segmented:
        pairs = [(Path(image), Path(mask)) for image, mask in args.segmented]
        samples = segmented_skin(pairs)
    else:
        samples = painted_skin(session)
    skin = fit_skin_ellipse(*samples, size=args.size)
    kept = edit_toml(
        session.folder / SESSION_FILE, {"clouds.skin": asdict(skin)}, "a session's settings"
    )
    (red, green), images = skin.mean, len(samples)
    answer(
        args,
        {"pixels": sum(map(len, samples)), "images": images, "r": red, "g": green},
        f"{sum(map(len, samples))} pixels of {images} {'image' if images == 1 else 'images'}: r = {red:.3f}, g = {green:.3f}. "
        f"[clouds] of {SESSION_FILE}: skin.{kept}",
    )
    if images == 1:
        say("note: one image; a second under other light makes the ellipse hold there as well.")
    return 0
