"""Write docs/settings.md from the settings themselves: `python docs/settings_page.py`. A test holds the two together."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from handtrack.session.clouds_settings import CLOUD_SETTINGS
from handtrack.setting import Setting
from handtrack.tracking.frame.old_settings import CONSTANTS, RENAMED
from handtrack.tracking.frame.settings import GROUPS, SETTINGS

PAGE = Path(__file__).resolve().with_name("settings.md")
_HEAD = """# Settings

Every setting of the tracker, by its dotted name. Those for users stand on the workbench's page too. Give one for a single run on the command line,

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
unknown name is an error that lists the known ones; an [old name](#old-names) is read with a note. Which settings matter, and when to touch them: [tutorial](tutorial.md#6-settings-that-matter). What they mean in
formulas: [derivations](index.md#derivations). `poses.npz` keeps the settings it was made with (`settings`, as JSON).

This page is made from the program (`python docs/settings_page.py`).
"""
_TITLES = {
    "mixture": "How other poses are looked for, where `tracker.hypotheses` is above 1 ([mixture](mixture.md))",
}
_CLOUDS = """## [clouds]

Which points of the clouds are the hand's, and how stereo pairs are matched: set in session.toml's table [clouds], beside its source (`files`,
`stereo` or `depth`), or live in the workbench's tab Clouds. `false` switches off what can be. Defaults are those of a stereo pair: depth images
take the nearest part, files look at no distance.
"""
_OLD = """## Old names

Read as before, with a note: """


def settings_page() -> str:
    """Return the page: one table a group, every setting with default, unit and meaning."""
    blocks = [_HEAD]
    for group, table in GROUPS.items():
        own = [known for name, known in SETTINGS.items() if name.startswith(f"{group}.")]
        title = _TITLES.get(group, str(table.__doc__).splitlines()[0].removesuffix("."))
        blocks.append(f"## {group}\n\n{title}.\n\n{_table(own)}")
    blocks.append(_CLOUDS + "\n" + _table(CLOUD_SETTINGS.values()))
    renamed = ", ".join(f"`{old}` is `{new}`" for old, new in RENAMED.items())
    gone = ", ".join(f"`{old}` ({_shown(value)})" for old, (_, value) in CONSTANTS.items())
    blocks.append(
        f"{_OLD}{renamed}. No longer settings but constants, with their values: {gone}.\n"
    )
    return "\n".join(blocks)


def _table(settings: Iterable[Setting]) -> str:
    rows = ["| setting | for | default | range | unit | meaning |", "|---|---|---|---|---|---|"]
    rows += [
        f"| `{s.name}` | {s.level} | {_shown(s.default)} | {_range(s)} | {s.unit} | {_cell(s.help)} |"
        for s in settings
    ]
    return "\n".join(rows) + "\n"


def _range(known: Setting) -> str:
    if known.choices:
        return ", ".join(f"`{choice}`" for choice in known.choices)
    if known.kind in (bool, str) or known.range_words in ("a number", "a whole number"):
        return ""
    words = known.range_words.partition(" [")[0]
    return words.removeprefix("a number ").removeprefix("a whole number ").removeprefix("numbers ")


def _shown(value: Any) -> str:
    if value is None:
        return "unset"
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    if isinstance(value, tuple):
        return f"`{','.join(f'{item:g}' for item in value)}`"
    return f"`{value:g}`" if isinstance(value, float) else f"`{value}`" if value != "" else "empty"


def _cell(text: str) -> str:
    return text.replace("|", "\\|").removesuffix(".")


if __name__ == "__main__":
    PAGE.write_text(settings_page(), encoding="utf-8")
