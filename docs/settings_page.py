"""Write docs/settings.md from the settings themselves: `python docs/settings_page.py`. A test holds the two together."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from handtrack.session.clouds_settings import CLOUD_SETTINGS
from handtrack.setting import Setting
from handtrack.tracking.frame.settings import ALIASES, GROUPS, SETTINGS

PAGE = Path(__file__).resolve().with_name("settings.md")
_HEAD = """# Settings

Every setting of the tracker, by its dotted name, printed from the program (`python docs/settings_page.py`). Those for users stand on the workbench's
page too, the method and the merged surface's shape in a folder for experts. For one run, and for good in `session.toml`:

```sh
handtrack track my_recording --set solver.iterations=20 --set silhouettes.bands_mm=6,3,1
```

```toml
[tracking]
solver.iterations = 20
silhouettes.bands_mm = [6, 3, 1]
```

The command line wins. When to touch them: [tutorial](tutorial.md#6-settings-that-matter); formulas: [derivations](index.md#derivations). `poses.npz` keeps the settings it was made with.
"""
_METHOD = """## Method

Sets many of the others at once: `--set method=paper2004`, `method = "paper2004"` in [tracking] ([methods](methods.md)).
"""
_TITLES = {
    "mixture": "How other poses are looked for, where `tracker.hypotheses` is above 1 ([mixture](mixture.md))",
}
_CLOUDS = """## [clouds]

Which points of the clouds are the hand's, and how stereo pairs are matched: in session.toml's table [clouds], or live in the workbench's tab Cloud.
`false` switches off what can be. Defaults are those of a stereo pair: depth images take the nearest part, files look at no distance.
"""


def settings_page() -> str:
    """Return the page: one table a group, every setting with default, unit, range and meaning."""
    blocks = [_HEAD, f"{_METHOD}\n{_table([SETTINGS['method']])}"]
    for group, table in GROUPS.items():
        own = [known for name, known in SETTINGS.items() if name.startswith(f"{group}.")]
        title = _TITLES.get(group, str(table.__doc__).splitlines()[0].removesuffix("."))
        blocks.append(f"## {group}\n\n{title}.\n\n{_table(own)}")
    blocks.append(_CLOUDS + "\n" + _table(CLOUD_SETTINGS.values()))
    renamed = ", ".join(f"`{other}` is `{name}`" for other, name in ALIASES.items())
    blocks.append(f"## Other names\n\n{renamed}.\n")
    return "\n".join(blocks)


def _table(settings: Iterable[Setting]) -> str:
    rows = ["| setting | for | default | meaning |", "|---|---|---|---|"]
    rows += [f"| `{s.name}` | {s.level} | {_value(s)} | {_cell(s.help)} |" for s in settings]
    return "\n".join(rows) + "\n"


def _value(known: Setting) -> str:
    """Return default, unit and range in one cell."""
    value = " ".join(filter(None, (_shown(known.default), known.unit)))
    return "; ".join(filter(None, (value, _range(known))))


def _range(known: Setting) -> str:
    if known.choices:
        others = [choice for choice in known.choices if choice != known.default]
        return "or " + ", ".join(f"`{choice}`" for choice in others)
    if known.kind in (bool, str) or known.range_words in ("a number", "a whole number"):
        return ""
    words = known.range_words.partition(" [")[0]
    for long, short in (
        ("a number ", ""),
        ("a whole number ", ""),
        ("numbers ", ""),
        ("of at least ", "≥\u00a0"),
        ("above ", ">\u00a0"),
    ):
        words = words.replace(long, short)
    return words


def _shown(value: Any) -> str:
    if value is None:
        return "unset"
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    if isinstance(value, tuple):
        return f"`{','.join(item if isinstance(item, str) else f'{item:g}' for item in value)}`"
    return f"`{value:g}`" if isinstance(value, float) else f"`{value}`" if value != "" else "empty"


def _cell(text: str) -> str:
    return text.replace("|", "\\|").removesuffix(".")


if __name__ == "__main__":
    PAGE.write_text(settings_page(), encoding="utf-8")
