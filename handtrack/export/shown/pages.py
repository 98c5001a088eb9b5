"""Pages in one file that any browser shows without network: the moving skeleton, and how the tracking went."""

from __future__ import annotations

import html
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from handtrack.arrays import F, Floats, runs
from handtrack.export.shown.mesh import joint_links, model_skin
from handtrack.export.table import ResultsTable
from handtrack.files.atomic import replace_text
from handtrack.geometry.rotation import quaternion_wxyz
from handtrack.tracking.frame.result import Status

# ---- The moving skeleton


_PAGE = Path(__file__).with_name("playback.html")
_DIGITS = 5  # of a metre or a quaternion: a hundredth of a millimetre


def write_playback(path: Path, table: ResultsTable) -> None:
    """Write the page: the skin moved by the bones, joints, cameras, timeline with each frame's state and reason."""
    data = json.dumps(scene_of(table), separators=(",", ":")).replace("<", "\\u003c")
    page = _PAGE.read_text(encoding="utf-8")
    page = page.replace("$TITLE", html.escape(table.track.session or "handtrack"))
    replace_text(path, page.replace('"$DATA"', data))


def scene_of(table: ResultsTable) -> dict[str, Any]:
    """Return what the page draws, as JSON has it [m, wxyz]."""
    track, model = table.track, table.model
    skin = model_skin(model)
    turns = quaternion_wxyz(track.T_world_bone[..., :3, :3])
    poses = np.concatenate([track.T_world_bone[..., :3, 3], turns], axis=-1)
    cameras = () if table.rig is None else table.rig
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    return {
        "session": track.session,
        "model": track.model if model.kind == "body" else f"{track.model}, {track.side}",
        "fps": table.fps,
        "frame": track.frame.tolist(),
        "time_s": np.round(track.time_s, 4).tolist(),
        "status": track.status.tolist(),
        "status_names": [status.words for status in Status],
        "reason": [] if track.reason is None else [str(text) for text in track.reason],
        "poses": _rounded(poses.reshape(len(track), -1)),
        "joints": _rounded(track.joint_positions.reshape(len(track), -1)),
        "joint_names": list(track.joint_names),
        "links": joint_links(model),
        "skin": {
            "bone": skin.bone.tolist(),
            "local": _rounded(skin.local),
            "faces": skin.faces.ravel().tolist(),
        },
        "cameras": [
            {
                "name": camera.name,
                "centre": _rounded(camera.centre),
                "corners": _rounded(camera.rays(corners * camera.size - 0.5)),
                "up": _rounded(-camera.rotation[1]),
            }
            for camera in cameras
        ],
    }


def _rounded(values: Any) -> Any:
    return np.round(np.asarray(values, float), _DIGITS).tolist()


# ---- How the tracking went: states, doubts with their reasons, curves


_COLOURS = {0: "#3fa34d", 1: "#f0a028", 2: "#dc3c3c", 3: "#2b7de0", 4: "#8a63d2"}
_MOST_INTERVALS = 40  # a page that one reads: the longest come first
_STYLE = """
:root{color-scheme:light dark;--ink:#1c2430;--paper:#fff;--line:#d5dae1;--soft:#66707f}
@media(prefers-color-scheme:dark){:root{--ink:#e7ebf0;--paper:#14181e;--line:#323a45;--soft:#98a3b3}}
body{margin:2em auto;max-width:900px;padding:0 1em;background:var(--paper);color:var(--ink);font:15px/1.5 system-ui,sans-serif}
h1{font-size:1.4em;margin-bottom:.2em}h2{font-size:1.05em;margin:1.8em 0 .4em}.soft{color:var(--soft)}
table{border-collapse:collapse;width:100%}td,th{padding:.25em .8em .25em 0;text-align:left;border-bottom:1px solid var(--line)}
td.n,th.n{text-align:right;font-variant-numeric:tabular-nums}.lane{width:100%;height:16px;display:block;border-radius:3px}
figure{margin:.4em 0 1em}figcaption span{margin-right:1em;font-size:.85em}i{display:inline-block;width:.8em;height:.8em;border-radius:2px;margin-right:.35em}
svg{width:100%;height:auto}svg text{font-size:11px;fill:var(--soft)}svg .grid{stroke:var(--line)}svg path{stroke-width:1.4}
"""


def write_report(path: Path, table: ResultsTable) -> None:
    """Write the page."""
    track = table.track
    title = html.escape(track.session or "A tracked sequence")
    parts = [
        f"<h1>{title}</h1><p class=soft>{html.escape(_about(table))}</p>",
        "<h2>Frames</h2>",
        _lane(table),
        _counts(table),
        "<h2>Intervals with low confidence, or lost</h2>",
        _intervals(table),
    ]
    if track.p_off_25mm is not None:
        parts += [
            "<h2>Probability that some joint's error exceeds 25 mm</h2>",
            curves(track.time_s, {"P": track.p_off_25mm}, "1"),
        ]
    spread = np.where(table.is_lost[:, None], np.nan, 1e3 * table.joint_std.max(axis=2))
    shown = {"median": np.median(spread, axis=1), "largest": spread.max(axis=1)}
    parts += [
        "<h2>Reported standard deviation of the joints</h2>",
        curves(track.time_s, shown, "mm"),
        "<h2>Speed of the joints</h2>",
        curves(track.time_s, {"median": _speed(table)}, "m/s"),
    ]
    for name, angles in _angle_groups(table).items():
        parts += [f"<h2>{html.escape(name)}</h2>", curves(track.time_s, angles, "°")]
    body = "\n".join(parts)
    page = (
        f'<!doctype html><html lang="en"><meta charset="utf-8"><link rel="icon" href="data:,"><title>{title} · handtrack</title>'
        f"<style>{_STYLE}</style>\n{body}\n</html>\n"
    )
    replace_text(path, page)


def _about(table: ResultsTable) -> str:
    track = table.track
    sided = track.side and track.keypoints21 is not None
    words = [f"{track.model}, {track.side}" if sided else track.model]
    words.append(f"frames {track.frame[0]} to {track.frame[-1]} at {table.fps:g} a second")
    if table.rig is not None:
        words.append(f"cameras {', '.join(table.rig.names)}")
    if track.hand_length_mm is not None:
        std = track.hand_length_std_mm
        std = "" if std is None else f" ± {max(std, 1.0):.0f}"  # as the command line rounds it
        words.append(f"hand {track.hand_length_mm:.0f} mm{std}")
    if track.refinement:
        why = json.loads(track.refinement).get("why", "")
        words.append(f"refined over the whole recording ({why})" if why else "refined")
    return f"{'; '.join(words)}. handtrack {track.version}"


def _lane(table: ResultsTable) -> str:
    """Return a strip: a colour for each stretch of frames of one state."""
    frame, status = table.track.frame, table.track.status
    total = frame[-1] - frame[0] + 1
    rows = [
        f'<rect x="{frame[first] - frame[0]}" width="{frame[end - 1] - frame[first] + 1}" height="1" '
        f'fill="{_COLOURS[int(status[first])]}"/>'
        for first, end in sorted(
            run for state in np.unique(status) for run in runs(status == state)
        )
    ]
    return (
        f'<svg class=lane viewBox="0 0 {total} 1" preserveAspectRatio="none">{"".join(rows)}</svg>'
    )


def _counts(table: ResultsTable) -> str:
    status, rows = table.track.status, []
    for known in Status:
        count = int((status == known).sum())
        if count:
            mark = f'<i style="background:{_COLOURS[int(known)]}"></i>{known.words}'
            rows.append(f"<tr><td>{mark}<td class=n>{count}<td class=n>{count / len(status):.1%}")
    return f"<table><tr><th>status<th class=n>frames<th class=n>share{''.join(rows)}</table>"


def _intervals(table: ResultsTable) -> str:
    track = table.track
    bad = [*runs(track.status == Status.DOUBTFUL), *runs(track.status == Status.LOST)]
    if not bad:
        return "<p>None.</p>"
    bad.sort(key=lambda run: (run[0] - run[1], run[0]))
    rows = []
    for first, end in bad[:_MOST_INTERVALS]:
        state = Status(int(track.status[first])).words
        reasons = [] if track.reason is None else [str(t) for t in track.reason[first:end]]
        why = max(set(reasons), key=lambda text: (reasons.count(text), text), default="")
        rows.append(
            f"<tr><td class=n>{track.frame[first]}–{track.frame[end - 1]}<td class=n>{end - first}<td>{state}<td>{html.escape(why)}"
        )
    more = len(bad) - _MOST_INTERVALS
    rest = f"<p class=soft>{more} shorter ones are not listed.</p>" if more > 0 else ""
    return f"<table><tr><th class=n>frames<th class=n>count<th>status<th>most frequent reason{''.join(rows)}</table>{rest}"


def _speed(table: ResultsTable) -> Floats[F]:
    """Return the joints' median speed up to each frame [m/s], NaN beside lost frames."""
    track, lost = table.track, table.is_lost
    moved = np.linalg.norm(np.diff(track.joint_positions, axis=0), axis=2)
    step = np.maximum(np.diff(track.time_s), 1e-9)
    speed = np.median(moved, axis=1) / step
    speed[lost[1:] | lost[:-1]] = np.nan
    return np.concatenate([[np.nan], speed])


def _angle_groups(table: ResultsTable) -> dict[str, dict[str, Floats[F]]]:
    """Return the angles [°] by what they move: those of a name's first word together, at most five curves a picture."""
    track = table.track
    groups: dict[str, dict[str, Floats]] = {}
    for s, name in enumerate(track.parameter_names[6:], start=6):
        part = name.split("_", maxsplit=1)[0]
        own = groups.setdefault(f"Angles: {part}", {})
        own[name] = np.where(table.is_lost, np.nan, np.rad2deg(track.parameters[:, s]))
    return {
        (name if k == 0 else f"{name}, more"): dict(list(own.items())[k : k + 5])
        for name, own in groups.items()
        for k in range(0, len(own), 5)
    }


WIDTH, HEIGHT = 860, 130
_LEFT, _RIGHT, _TOP, _BOTTOM = 56, 10, 8, 20
_LINE_COLOURS = ("#2b7de0", "#e0702b", "#3fa34d", "#8a63d2", "#c2477f")
_TICKS = 4


def curves(time_s: Floats[F], values: Mapping[str, Floats[F]], unit: str) -> str:
    """Return a picture of curves by name, with their axis; gaps where a value is not finite."""
    finite = np.concatenate([column[np.isfinite(column)] for column in values.values()])
    low, high = (float(finite.min()), float(finite.max())) if len(finite) else (0.0, 1.0)
    if high - low < 1e-12:
        low, high = low - 0.5, high + 0.5
    first, last = float(time_s[0]), float(max(time_s[-1], time_s[0] + 1e-9))
    x = _LEFT + (time_s - first) / (last - first) * (WIDTH - _LEFT - _RIGHT)
    span = HEIGHT - _TOP - _BOTTOM
    parts = []
    for tick in _rounded_ticks(low, high):
        y = _TOP + (high - tick) / (high - low) * span
        parts.append(f'<path d="M{_LEFT} {y:.1f}H{WIDTH - _RIGHT}" class="grid"/>')
        parts.append(f'<text x="{_LEFT - 6}" y="{y + 4:.1f}" text-anchor="end">{tick:g}</text>')
    for tick in _rounded_ticks(first, last):
        at = _LEFT + (tick - first) / (last - first) * (WIDTH - _LEFT - _RIGHT)
        parts.append(f'<text x="{at:.1f}" y="{HEIGHT - 5}" text-anchor="middle">{tick:g} s</text>')
    for k, column in enumerate(values.values()):
        y = _TOP + (high - column) / (high - low) * span
        line, before = "", False
        for across, down in zip(x, y, strict=True):
            known = bool(np.isfinite(down))
            line += f"{'L' if before else 'M'}{across:.1f} {down:.1f}" if known else ""
            before = known
        parts.append(f'<path d="{line}" fill="none" stroke="{_colour(k)}"/>')
    named = "".join(
        f'<span><i style="background:{_colour(k)}"></i>{html.escape(name)}</span>'
        for k, name in enumerate(values)
    )
    return (
        f'<figure><figcaption>{named}<span class="soft">[{html.escape(unit)}]</span></figcaption>'
        f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img">{"".join(parts)}</svg></figure>'
    )


def _rounded_ticks(low: float, high: float) -> list[float]:
    """Return a few round numbers within an interval."""
    step = 10.0 ** np.floor(np.log10((high - low) / _TICKS))
    step *= next(m for m in (1, 2, 5, 10) if (high - low) / (m * step) <= _TICKS)
    return [round(k * step, 10) for k in range(int(np.ceil(low / step)), int(high / step) + 1)]


def _colour(index: int) -> str:
    return _LINE_COLOURS[index % len(_LINE_COLOURS)]
