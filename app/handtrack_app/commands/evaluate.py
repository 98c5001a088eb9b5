"""`handtrack evaluate`: standard metrics against the truth."""

from __future__ import annotations

import argparse
import json
import re

from handtrack.diagnostics.metrics import evaluate, in_truths_landmarks
from handtrack.errors import HandtrackError
from handtrack.model.articulated import JOINT_CENTRES
from handtrack.session.formats.given_truth import read_given_truth
from handtrack.session.formats.tables import read_npz
from handtrack_app.commands.terminal.progress import say

_FAR_MM = 1000.0
_COLUMNS = {
    "error mm": ("position_", "_mm"),
    "beside offset mm": ("position_", "_offset_free_mm"),
    "flexion °": ("flexion_", "_deg"),
    "beside offset °": ("flexion_", "_offset_free_deg"),
    "points": ("used_", ""),
}
"""of the table of joints: what stands before and after a joint's name in the name of its figure"""
_OF_A_JOINT = re.compile(r"position_(?!.*_offset_free_mm$).*_mm")


def run(args: argparse.Namespace) -> int:
    """Print the metrics, as a table or JSON."""
    track = read_npz(args.poses)
    truth, note = read_given_truth(args.truth, track.side)
    if note:
        say(f"note: {note}")
    try:
        compared = in_truths_landmarks(track, truth, args.landmarks)
        definition = compared.keypoint_definition or JOINT_CENTRES
        metrics = evaluate(compared, truth, definition)
    except HandtrackError as error:
        raise HandtrackError(f"{args.poses} and {args.truth}: {error}") from None
    median = metrics["mpjpe_median_mm"]
    if median is not None and median > _FAR_MM:
        say(
            f"note: result and truth are {median / 1000:.3g} m apart (median). Is {args.truth} in metres, and in the world of "
            "the calibration?"
        )
    own, theirs = track.landmark_definition, truth.keypoint_definition
    if theirs not in (None, definition):
        say(f"note: the points of {args.truth} are {theirs}; compared are {definition}.")
    elif own is not None and theirs is None and args.landmarks is None:
        say(
            f"note: compared are {definition}; --landmarks {own} compares the points as that detector means them."
        )
    if args.json:
        told = metrics | {"keypoint_definition": definition}
        print(json.dumps(told, indent=1, allow_nan=False))
        return 0
    joints = [name[9:-3] for name in metrics if _OF_A_JOINT.fullmatch(name)]
    rows = {j: [f"{head}{j}{tail}" for head, tail in _COLUMNS.values()] for j in joints}
    in_table = {name for row in rows.values() for name in row}
    for name, value in metrics.items():
        if name not in in_table:
            print(f"{name:24s} {_shown(value)}")
    print(f"{'keypoint_definition':24s} {definition}\n")
    print("".join([f"{'':12s}", *(f"{title:>18s}" for title in _COLUMNS)]))
    for joint, row in rows.items():
        print("".join([f"{joint:12s}", *(f"{_shown(metrics.get(name)):>18s}" for name in row)]))
    return 0


def _shown(value: float | int | None) -> str:
    return "-" if value is None else f"{value:.4g}" if isinstance(value, float) else str(value)
