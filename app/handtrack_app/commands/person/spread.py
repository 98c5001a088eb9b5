"""`handtrack spread`: a person's constants of linked abduction, to be put into session.toml."""

from __future__ import annotations

import argparse

import numpy as np

from handtrack.errors import HandtrackError
from handtrack.session.formats.tables import read_npz
from handtrack.tracking.size.spread import spread_of_track
from handtrack_app.commands.terminal.answer import answer
from handtrack_app.commands.terminal.progress import say


def run(args: argparse.Namespace) -> int:
    """Print the four settings as lines of [tracking], and how well they explain what was seen."""
    track = read_npz(args.poses)
    try:
        found = spread_of_track(track)
    except HandtrackError as error:
        raise HandtrackError(f"{args.poses}: {error}") from None
    settings = found.settings()
    told = {
        "settings": settings,
        "frames": found.frames,
        "residual_rad": found.residual_rad,
        "explained": found.explained,
    }
    answer(args, told, *(f"{name} = {value:g}" for name, value in settings.items()))
    frames = "1 frame" if found.frames == 1 else f"{found.frames} frames"
    say(
        f"from {frames}; the linkage leaves {np.rad2deg(found.residual_rad):.1f}° of the abductions unexplained "
        f"({100 * found.explained:.0f} % of their squares explained). Use with model.coupling = 18."
    )
    return 0
