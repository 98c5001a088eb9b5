"""`handtrack completion`: what bash and zsh need to complete the command line."""

from __future__ import annotations

import argparse
from pathlib import Path

from handtrack.errors import HandtrackError
from handtrack_app.cli import build_parser


def print_script(shell: str) -> int:
    """Print the script of a shell; where a path is expected, it completes files."""
    try:
        import shtab
    except ImportError:
        raise HandtrackError(
            "completion needs shtab: `pip install shtab`, or handtrack with the extra `completion`."
        ) from None
    parser = build_parser(described=True)
    (commands,) = (one for one in parser._actions if isinstance(one, argparse._SubParsersAction))
    for command in commands.choices.values():
        for action in command._actions:
            if action.type is Path:
                action.complete = shtab.FILE  # type: ignore[attr-defined]
    print(shtab.complete(parser, shell))
    return 0
