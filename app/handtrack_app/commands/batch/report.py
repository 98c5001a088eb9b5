"""What became of all recordings, worst first: report.html to look at, report.csv to count with."""

from __future__ import annotations

import csv
import io
import shlex
from collections.abc import Sequence
from html import escape
from pathlib import Path

from handtrack.files.atomic import replace_text
from handtrack_app.commands.batch.outcome import DONE, Outcome

_COLUMNS = (
    "recording", "state", "frames", "tracked", "doubtful", "lost", "keyframe", "p_off_25mm", "seconds",
    "cause", "warnings", "folder", "output", "open",
)  # fmt: skip
_STYLE = """
:root { color-scheme: light dark; font: 15px/1.45 system-ui, sans-serif }
body { margin: 2rem auto; max-width: 78rem; padding: 0 1rem }
h1 { font-size: 1.4rem; margin: 0 0 .3rem } p { margin: .3rem 0 1rem }
input { font: inherit; padding: .35rem .6rem; width: 22rem; max-width: 100% }
table { border-collapse: collapse; width: 100%; margin-top: 1rem }
th { text-align: left; font-weight: 600; border-bottom: 2px solid #8888; padding: .3rem .6rem }
td { border-bottom: 1px solid #8884; padding: .45rem .6rem; vertical-align: top }
td.number { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap }
.bar { display: flex; width: 8rem; height: .8rem; border-radius: 2px; overflow: hidden; background: #8883; margin-top: .3rem }
.tracked { background: #2b9348 } .doubtful { background: #e9a100 } .lost { background: #d00000 }
.state { font-weight: 600 } .failed, .refused { color: #d00000 } .interrupted, .started { color: #b57a00 }
.cause { overflow-wrap: anywhere } details { color: #777 } small { color: #777 }
button { font: inherit; padding: .15rem .6rem; cursor: pointer }
code { font-size: .85em; overflow-wrap: anywhere }
"""
_SCRIPT = """
for (const button of document.querySelectorAll("button")) button.onclick = async () => {
  try { await navigator.clipboard.writeText(button.dataset.command); }
  catch { const area = document.createElement("textarea"); area.value = button.dataset.command;
          document.body.append(area); area.select(); document.execCommand("copy"); area.remove(); }
  button.textContent = "copied"; setTimeout(() => button.textContent = "copy", 1500);
};
document.querySelector("input").oninput = event => {
  const wanted = event.target.value.toLowerCase();
  for (const row of document.querySelectorAll("tbody tr")) row.hidden = !row.textContent.toLowerCase().includes(wanted);
};
"""


def write_report(out: Path, outcomes: Sequence[Outcome]) -> None:
    """Write report.html and report.csv into a folder, the worst recording first."""
    rows = sorted(outcomes, key=lambda o: (tuple(-b for b in o.badness), o.recording))
    replace_text(out / "report.csv", _csv(rows))
    replace_text(out / "report.html", _html(rows))


def in_words(outcomes: Sequence[Outcome]) -> str:
    """Return how many recordings ended how, and how many frames came of them."""
    states = [outcome.state for outcome in outcomes]
    counts = ", ".join(f"{states.count(state)} {state}" for state in sorted(set(states)))
    total = sum(outcome.total for outcome in outcomes)
    lost = sum(outcome.frames.get("lost", 0) for outcome in outcomes)
    doubtful = sum(outcome.frames.get("doubtful", 0) for outcome in outcomes)
    return f"{len(states)} recordings: {counts}; {total} frames, {doubtful} of low confidence, {lost} lost"


def open_command(outcome: Outcome) -> str:
    """Return the command that opens a recording in the workbench."""
    return f"handtrack open {shlex.quote(outcome.folder)}"


def _csv(rows: Sequence[Outcome]) -> str:
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(_COLUMNS)
    for row in rows:
        counts = [row.frames.get(name, 0) for name in _COLUMNS[3:7]]
        table.writerow(
            [row.recording, row.state, row.total, *counts, row.p_off, row.seconds, row.cause, " | ".join(row.warnings),
             row.folder, row.output, open_command(row)]
        )  # fmt: skip
    return text.getvalue()


def _html(rows: Sequence[Outcome]) -> str:
    body = "\n".join(map(_row, rows))
    return f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width">
<title>handtrack batch</title><style>{_STYLE}</style></head><body>
<h1>handtrack batch</h1><p>{escape(in_words(rows))}. The worst first: those without a result, then by lost frames, those of low confidence, and
how probably joints are off.</p>
<input placeholder="show only those with …" aria-label="show only those with">
<table><thead><tr><th>recording</th><th>frames</th><th>lost</th><th>low confidence</th><th title="mean probability that some joint is more
than 25 mm off">P off</th><th>s</th><th>what is to be known</th><th>workbench</th></tr></thead>
<tbody>
{body}
</tbody></table><script>{_SCRIPT}</script></body></html>
"""


def _row(row: Outcome) -> str:
    bar = "".join(
        f'<i class="{name}" style="flex:{row.frames[name]}"></i>'
        for name in ("tracked", "doubtful", "lost") if row.frames.get(name)
    )  # fmt: skip
    state = "" if row.state == DONE else f'<span class="state {row.state}">{row.state}</span> '
    warnings = "".join(f"<div>{escape(text)}</div>" for text in row.warnings)
    notes = f"<details><summary>{len(row.warnings)} notes</summary>{warnings}</details>" if row.warnings else ""  # fmt: skip
    shares = [f"{100 * row.share(name):.0f} %" if row.total else "–" for name in ("lost", "doubtful")]  # fmt: skip
    off = "–" if row.p_off is None else f"{row.p_off:.2f}"
    numbers = "".join(f'<td class="number">{value}</td>' for value in (*shares, off, f"{row.seconds:.0f}"))  # fmt: skip
    return (
        f"<tr><td><b>{escape(row.recording)}</b><br><small>{escape(row.folder)}</small></td>"
        f'<td class="number">{row.total or "–"}<div class="bar">{bar}</div></td>{numbers}'
        f'<td class="cause">{state}{escape(row.cause)}{notes}</td>'
        f'<td><button data-command="{escape(open_command(row))}">copy</button></td></tr>'
    )
