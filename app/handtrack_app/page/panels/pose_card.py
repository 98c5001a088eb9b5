"""The card of a pose: frame, where it comes from, its score; and how well each of its joints is seen."""

from __future__ import annotations

import html
import math

import numpy as np

from handtrack.arrays import Floats, S
from handtrack_app.page.panels.pose_words import group_of, unit_of
from handtrack_app.protocol.palette import (
    ASIDE,
    FINGER_COLOURS,
    FOUND,
    LIMB_COLOURS,
    PINNED,
    REFITTED,
    STATUS,
)
from handtrack_app.protocol.score import ScoreSnapshot
from handtrack_app.protocol.snapshots import BEFORE, PoseSnapshot

_ORIGINS = {
    "carried": ("not tracked yet", STATUS[-1][1]),
    "found": FOUND,
    "pinned": PINNED,
    "refitted": REFITTED,
    BEFORE: ASIDE,
}
"""of poses that no status tells of: word and colour"""
_BEFORE_WORDS = (
    "<div style='margin-top:.2em;line-height:1.3'>You look at what was <b>before the last step</b>. Nothing is changed; "
    "<kbd>Tab</kbd> shows what is.</div>"
)


def score_rows(score: ScoreSnapshot, with_energy: bool = True) -> list[tuple[str, str]]:
    """Return energy and overlap by camera, each with how it differs from the pose that was fitted last."""
    fitted = score.fitted_overlap or {}
    rows = []
    if score.energy and with_energy:
        energy = sum(score.energy.values())
        rows.append(("energy", f"{energy:.1f}{_change(energy, score.fitted_energy, 1)}"))
    for camera, share in score.overlap.items():
        rows.append((f"overlap {camera}", f"{share:.2f}{_change(share, fitted.get(camera), 2)}"))
    return rows


def _change(now: float, before: float | None, digits: int) -> str:
    moved = 0.0 if before is None else round(now - before, digits)
    return f" ({moved:+.{digits}f})" if moved else ""


def status_of(pose: PoseSnapshot) -> tuple[str, str]:
    """Return where a pose comes from, in a word, and the word's colour."""
    return _ORIGINS.get(pose.origin, STATUS.get(pose.status, STATUS[-1]))


def pose_card(pose: PoseSnapshot, score: ScoreSnapshot | None = None) -> str:
    """Return the lines above the sliders: frame, where the pose comes from, error against the truth, its score.

    score: of this pose, or of another, which is passed over.
    """
    word, colour = status_of(pose)
    facts = []
    if math.isfinite(pose.error_mm):
        facts.append(("mean joint error", f"{pose.error_mm:.1f} mm"))
    if math.isfinite(pose.energy):
        facts.append(("energy", f"{pose.energy:.1f}"))
    if score is not None and score.is_of(pose.frame, pose.values):
        facts += score_rows(score, with_energy=not math.isfinite(pose.energy))
    rows = "".join(
        f"<div style='display:flex;justify-content:space-between'><span style='opacity:.85'>{html.escape(k)}</span>"
        f"<b>{html.escape(v)}</b></div>"
        for k, v in facts
    )
    if pose.origin == BEFORE:
        rows += _BEFORE_WORDS
    if pose.accepted:
        rows += (
            "<div style='margin-top:.2em'><b>Accepted</b>: tracking and refining leave it.</div>"
        )
    if pose.note:
        rows += f"<div style='opacity:.8;line-height:1.3;margin-top:.2em'>{html.escape(pose.note)}</div>"
    return (
        "<div style='padding:.2em .9em .3em;font-size:.85em;line-height:1.4'>"
        "<div style='display:flex;justify-content:space-between;align-items:center'>"
        f"<b class='handtrack-frame' style='font-size:1.1em'>Frame {pose.frame}</b>"
        f"<span style='background:{colour};color:{_ink(colour)};border-radius:1em;padding:0 .7em;font-size:.9em'>"
        f"{html.escape(word)}</span></div>{rows}</div>"
    )


def _ink(colour: str) -> str:
    red, green, blue = (int(colour[i : i + 2], 16) for i in (1, 3, 5))
    return "#111" if 0.3 * red + 0.59 * green + 0.11 * blue > 130 else "#fff"


def certainty_table(names: tuple[str, ...], std: Floats[S] | None) -> str:
    """Return how well each parameter is seen, as a table of fingers by joints."""
    if std is None or len(std) != len(names):
        return (
            "<div style='padding:.6em .9em;font-size:.85em;opacity:.75'>Track this frame to see how well "
            "each joint is seen.</div>"
        )
    cells: dict[str, list[str]] = {}
    for name, value in zip(names, std.tolist(), strict=True):
        row = {"root_t": "Place mm", "root_r": "Turn"}.get(name[:6], group_of(name))
        cells.setdefault(row, []).append(_cell(name, value))
    heads = {"Place mm": ("x", "y", "z"), "Thumb": ("flex", "spread", "2nd", "3rd")}
    rows = ""
    for group, row in cells.items():
        if group in heads:
            titles = "".join(
                f"<td style='text-align:center;opacity:.85'>{title}</td>" for title in heads[group]
            )
            rows += f"<tr><td></td>{titles}</tr>"
        rows += f"<tr><td style='padding:.15em .4em .15em 0;white-space:nowrap'>{_dot(group)}{group}</td>{''.join(row)}</tr>"
    return (
        "<div style='padding:.4em .9em;font-size:13px;line-height:1.5'>"
        "<div style='opacity:.85;margin-bottom:.4em'>Standard deviation of each joint in this frame. "
        "Yellow is badly seen; <b>unseen</b> cannot be told from these images.</div>"
        "<table style='width:100%;table-layout:fixed;border-spacing:2px;border-collapse:separate'>"
        f"<colgroup><col style='width:6.2em'></colgroup>{rows}</table></div>"
    )


def _dot(group: str) -> str:
    colours = FINGER_COLOURS | LIMB_COLOURS
    red, green, blue = colours.get(group.lower(), colours["palm"])
    return (
        f"<span style='display:inline-block;width:.7em;height:.7em;border-radius:50%;margin-right:.4em;"
        f"background:rgb({red},{green},{blue})'></span>"
    )


def _cell(name: str, std: float) -> str:
    shown = std / unit_of(name)
    unit = "" if name.startswith("root_t") else "°"
    text = (
        "unseen"
        if not math.isfinite(std)
        else f"{shown:.1f}{unit}"
        if shown < 10
        else f"{shown:.0f}{unit}"
    )
    share = 1.0 if not math.isfinite(std) else min(shown / 20.0, 1.0)
    low, high = np.array([47, 75, 110]), np.array([240, 228, 66])
    red, green, blue = (low + share * (high - low)).astype(int)
    ink = "#111" if share > 0.3 else "#fff"
    title = html.escape(f"{name}: ± {text}")
    return (
        f"<td title='{title}' style='background:rgb({red},{green},{blue});color:{ink};border-radius:3px;"
        f"text-align:center;padding:.1em .2em'>{text}</td>"
    )
