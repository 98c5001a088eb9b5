"""Write docs/settings.md from the settings themselves: `python docs/settings_page.py`. A test holds the two together."""

from __future__ import annotations

import ast
import inspect
from dataclasses import fields
from pathlib import Path
from typing import Any

from handtrack.tracking.frame.settings import TrackerSettings

PAGE = Path(__file__).resolve().with_name("settings.md")
_HEAD = """# Settings

Every setting of the tracker, by its dotted name. Give one for a single run on the command line,

```sh
handtrack track my_recording --set solver.iterations=20 --set silhouettes.bands_mm=6,3,1
```

for good in the recording's `session.toml`,

```toml
[tracking]
solver.iterations = 20
silhouettes.bands_mm = [6, 3, 1]
```

or live in the workbench, tabs Settings (*Save to session.toml* writes this table) and Limits. The command line wins over `session.toml`. An
unknown name is an error that lists the known ones. Which settings matter, and when to touch them: [tutorial](tutorial.md#6-settings-that-matter). What they mean in
formulas: [derivations](index.md#derivations). `poses.npz` keeps the settings it was made with (`settings`, as JSON).

This page is made from the program (`python docs/settings_page.py`).
"""
_TITLES = {
    "model": "Which hand",
    "silhouettes": "How outlines pull",
    "cloud": "How a point cloud pulls",
    "edges": "How edges of the images pull the outline",
    "intensity": "How the model's texture, carried from earlier frames, pulls",
    "keypoints": "How given points pull",
    "prior": "What is assumed where nothing is seen",
    "solver": "How hard to try on a frame",
    "tracker": "From frame to frame",
    "mixture": "How other poses are looked for, where `tracker.hypotheses` is above 1 ([mixture](mixture.md))",
}
_UNITS = {"mm": "mm", "m": "m", "deg": "°", "rad": "rad", "px": "px"}
_PLAIN = {
    "silhouettes.weight": "factor on the outlines' cost; 1 takes `outline_sigma_mm` at its word, 0 leaves silhouettes out",
    "cloud.weight": "factor on the cloud's cost; 1 takes `sigma_mm` at its word, 0 leaves clouds out",
    "keypoints.weight": "factor on the given points' cost; 1 takes `sigma_mm` at its word, 0 leaves them out",
    "solver.least_damping": "λ never falls below this",
    "solver.relax": "after a step that lowered the cost, λ is multiplied by this",
    "solver.tighten": "after a step that did not, λ is multiplied by this",
    "solver.iterations": "linearisations a frame at most, all bands together",
    "solver.damping": "first λ of each band, as a share of the Hessian's diagonal",
    "tracker.doubtful_overlap": "a frame is doubtful if model and mask overlap less in its worst camera (intersection over union)",
    "tracker.lost_overlap": "a frame is lost if they overlap less in the middle one of its cameras (median)",
    "tracker.lost_cloud": "a frame with a smaller share than this is lost",
}
"""What is said instead of, or in the place of, a docstring."""


def settings_page() -> str:
    """Return the page: one table a group, every setting with default, unit and meaning."""
    settings = TrackerSettings()
    blocks = [_HEAD]
    for group in fields(settings):
        table = getattr(settings, group.name)
        known = docstrings(type(table))
        rows = [f"## {group.name}", "", f"{_TITLES.get(group.name, type(table).__doc__)}.", ""]
        rows += ["| setting | default | unit | meaning |", "|---|---|---|---|"]
        for item in fields(table):
            name = f"{group.name}.{item.name}"
            meaning = _PLAIN.get(name) or known.get(item.name, "")
            shown = _shown(getattr(table, item.name))
            rows.append(f"| `{name}` | {shown} | {unit_of(item.name)} | {_sentence(meaning)} |")
        blocks.append("\n".join(rows) + "\n")
    return "\n".join(blocks)


def docstrings(table: type) -> dict[str, str]:
    """Return what stands below each field of a settings class."""
    body = ast.parse(inspect.cleandoc(inspect.getsource(table))).body[0]
    assert isinstance(body, ast.ClassDef)
    found: dict[str, str] = {}
    for field, below in zip(body.body, body.body[1:], strict=False):
        if not (isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name)):
            continue
        if isinstance(below, ast.Expr) and isinstance(below.value, ast.Constant):
            found[field.target.id] = " ".join(str(below.value.value).split())
    return found


def unit_of(name: str) -> str:
    """Return the unit that a setting's name ends in; nothing for a number without one."""
    last = name.rsplit("_", 1)[-1]
    return _UNITS.get(last, "") if "_" in name else ""


def _shown(value: Any) -> str:
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    if isinstance(value, tuple):
        return f"`{','.join(f'{item:g}' for item in value)}`"
    return f"`{value:g}`" if isinstance(value, float) else f"`{value}`" if value != "" else "empty"


def _sentence(text: str) -> str:
    text = text.replace("|", "\\|")
    return text[:1].upper() + text[1:] if text[:1].isascii() else text


if __name__ == "__main__":
    PAGE.write_text(settings_page(), encoding="utf-8")
