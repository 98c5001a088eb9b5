"""`handtrack board`: a calibration board to print."""

from __future__ import annotations

import argparse

from handtrack.capture.calibration.boards import FORMATS, page_size_mm, parse_board, write_board
from handtrack.errors import HandtrackError
from handtrack.files.atomic import replacing
from handtrack.files.versions import keep_version
from handtrack_app.commands.terminal.output import answer, output_file

_PAPERS_MM = {
    "A4": (210, 297),
    "A3": (297, 420),
    "A2": (420, 594),
    "A1": (594, 841),
    "letter": (216, 279),
}


def save_board(args: argparse.Namespace) -> int:
    """Write the board and say how large it must come out of the printer."""
    board = parse_board(args.board)
    if not 50 <= args.dpi <= 2400:
        raise HandtrackError(f"--dpi {args.dpi:g}: expected 50 to 2400 dots an inch.")
    output_file(args.out, FORMATS, "boards are")
    width, height = page_size_mm(board)
    if args.out.suffix.lower() == ".png" and width * height * (args.dpi / 25.4) ** 2 > 2e8:
        raise HandtrackError(
            f"--out {args.out}: {width:.0f} x {height:.0f} mm at {args.dpi:g} dpi is too large a picture; "
            "write .svg or .pdf, which are exact, or choose a smaller --dpi."
        )
    keep_version(args.out)
    with replacing(args.out) as part:
        write_board(part, board, args.dpi)
    columns, rows = board.squares
    side = board.square_m * 1e3
    fits = [
        name
        for name, size in _PAPERS_MM.items()
        if max(width, height) <= max(size) and min(width, height) <= min(size)
    ]
    words = (
        f"{args.out}: {board.text}, page {width:g} x {height:g} mm"
        f"{f' (fits {fits[0]})' if fits else ' (larger than A1)'}. Print at 100 % (actual size) and measure: "
        f"{columns} squares must be {columns * side:g} mm wide, {rows} squares {rows * side:g} mm high; if not, "
        "give the measured square to `handtrack calibrate`. Glue it to something flat and stiff."
    )
    answer(
        args,
        {
            "output": args.out,
            "page_mm": [width, height],
            "squares": [columns, rows],
            "square_mm": side,
        },
        words,
    )
    return 0
