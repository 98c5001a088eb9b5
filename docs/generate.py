"""Write the generated parts of the documentation: `python -m docs.generate`. A test checks that they are current.

A page marks a generated block with `<!-- generated: NAME -->` and `<!-- end -->`, and a figure of docs/figures.toml with
`<!--ENTRY.KEY:FORMAT-->…<!--/-->`.
"""

from __future__ import annotations

import argparse
import ast
import re
import tomllib
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

from docs import searches
from handtrack.export.registry import FORMATS
from handtrack.session.session_file import CLOUD_SETTINGS
from handtrack.setting import Setting
from handtrack.tracking.frame.methods import METHODS, Method, Traits
from handtrack.tracking.frame.settings import ALIASES, GROUPS, SETTINGS
from handtrack_app.cli import COMMAND_GROUPS, build_parser

ROOT = Path(__file__).resolve().parents[1]
FIGURES = ROOT / "docs" / "figures.toml"
_FIGURE = re.compile(r"<!--(\w+)\.([\w.+]+):([,.%\w]+)-->.*?<!--/-->")
_BLOCK = re.compile(r"<!-- generated: ([\w ]+) -->\n.*?<!-- end -->", re.DOTALL)
_UNITS = {
    "mm": "mm", "px": "px", "ms": "ms", "s": "s", "deg": "°", "percent": "%", "mb": "MB", "kb": "kB", "db": "dB",
}  # fmt: skip
"""the unit of a figure whose key ends in the word"""


def pages() -> list[Path]:
    """Return every Markdown page of the repository."""
    folders = (ROOT / "docs", ROOT / "sessions")
    return sorted([*ROOT.glob("*.md"), *(page for one in folders for page in one.rglob("*.md"))])


def figures() -> dict[str, Any]:
    """Return the table of measured figures."""
    return tomllib.loads(FIGURES.read_text(encoding="utf-8"))


def generated(text: str, measured: dict[str, Any]) -> str:
    """Return a page with its generated blocks and figures written anew."""
    blocks = _BLOCK.sub(
        lambda m: f"<!-- generated: {m[1]} -->\n\n{BLOCKS[m[1]]().strip()}\n\n<!-- end -->", text
    )
    return _FIGURE.sub(
        lambda m: f"<!--{m[1]}.{m[2]}:{m[3]}-->{measured[m[1]]['values'][m[2]]:{m[3]}}<!--/-->",
        blocks,
    )


# ---- settings


def settings() -> str:
    """Return one table of settings per group: default, unit, range and meaning."""
    blocks = [f"## method\n\n{_settings([SETTINGS['method']])}"]
    for group, described in GROUPS.items():
        own = [known for name, known in SETTINGS.items() if name.startswith(f"{group}.")]
        title = str(described.__doc__).splitlines()[0].removesuffix(".")
        blocks.append(f"## {group}\n\n{title}.\n\n{_settings(own)}")
    blocks.append(f"## [clouds]\n\n{_settings(CLOUD_SETTINGS.values())}")
    renamed = ", ".join(f"`{other}` is `{name}`" for other, name in ALIASES.items())
    return "\n".join([*blocks, f"## Aliases\n\n{renamed}."])


def _settings(known: Iterable[Setting]) -> str:
    rows = ["| setting | level | default | meaning |", "|---|---|---|---|"]
    rows += [f"| `{s.name}` | {s.level} | {_default(s)} | {_cell(s.help)} |" for s in known]
    return "\n".join(rows) + "\n"


def _default(known: Setting) -> str:
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
        ("a number ", ""), ("a whole number ", ""), ("numbers ", ""), ("of at least ", "≥\u00a0"), ("above ", ">\u00a0"),
    ):  # fmt: skip
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


def _cell(text: object) -> str:
    return str(text).replace("|", "\\|").replace("\n", " ").removesuffix(".")


# ---- the command line


def commands() -> str:
    """Return a section per command: what it does, usage, arguments and options."""
    (sub,) = [a for a in build_parser()._actions if isinstance(a, argparse._SubParsersAction)]
    return "\n".join(
        _command(name, sub.choices[name]) for names in COMMAND_GROUPS.values() for name in names
    )


def _command(name: str, parser: argparse.ArgumentParser) -> str:
    shown = [a for a in parser._actions if a.help != argparse.SUPPRESS and a.dest not in ("help", "json")]  # fmt: skip
    rows = [f"- {_names(action)}: {_cell(action.help or action.dest)}" for action in shown]
    return "\n".join([f"## {name}", "", str(parser.description), "", *rows, ""])


def _names(action: argparse.Action) -> str:
    value: object = action.metavar or ("" if action.nargs == 0 else action.dest.upper())
    if action.choices:
        value = "|".join(map(str, action.choices))
    words = " ".join(value) if isinstance(value, tuple) else str(value)
    text = f"{', '.join(action.option_strings)} {words}" if action.option_strings else words
    return f"`{_cell(text.strip())}`"


# ---- other blocks


def formats() -> str:
    """Return the table of export formats."""
    rows = [
        f"| `{known.name}` | `poses{known.ending}` | {known.purpose} | {known.units} |"
        for known in FORMATS
    ]
    return "\n".join(["| `--to` | file | for | units |", "|---|---|---|---|", *rows])


def public_names() -> dict[str, str]:
    """Return where each public name of `handtrack` is defined."""
    tree = ast.parse((ROOT / "handtrack" / "__init__.pyi").read_text(encoding="utf-8"))
    imports = [node for node in tree.body if isinstance(node, ast.ImportFrom)]
    return {
        name.name: f"handtrack.{one.module}.{name.name}" for one in imports for name in one.names
    }


def api() -> str:
    """Return a directive per public name, which mkdocstrings fills from its docstring."""
    return "\n\n".join(f"::: {path}" for _, path in sorted(public_names().items()))


def results() -> str:
    """Return every measured figure with its unit, commit, date, machine and command."""
    return "\n".join(_entry(name, entry) for name, entry in figures().items())


def _entry(name: str, entry: dict[str, Any]) -> str:
    where = (
        f"Commit {entry['commit']}, {entry['date']}, {entry.get('machine', 'two shared cores')}."
    )
    run = "; ".join(f"`{command}`" for command in entry["commands"])
    if "session" in entry:
        where += f" Recording: `{entry['session']}`."
    rows = [
        f"| {_quantity(key.removeprefix(f'{name}.'), _number(value))} |"
        for key, value in entry["values"].items()
    ]
    head = f"## {name}\n\n{entry['title'] + ' ' if 'title' in entry else ''}{run}. {where}\n"
    return "\n".join([head, "| figure | value |", "|---|---|", *rows, ""])


def _quantity(key: str, number: str) -> str:
    """Return a figure's name and its value; a unit at the end of the key goes to the value."""
    *words, last = key.split("_")
    unit = _UNITS.get(last) if "within" not in words else None
    return (
        f"{' '.join(words)} | {number} {unit}" if unit else f"{' '.join([*words, last])} | {number}"
    )


def _number(value: float) -> str:
    return f"{value:,}" if isinstance(value, int) else f"{value:.3g}"


def _papers() -> Iterator[tuple[str, Callable[[], str]]]:
    for name, method in METHODS.items():
        yield name, lambda method=method: _method(method)


def _method(method: Method) -> str:
    """Return what a method sets, settings of tracking and of clouds, then traits."""
    usual, own = vars(Traits()), vars(method.traits)
    rows = [(f"`{name}`", value) for name, value in method.values.items()]
    rows += [(f"[clouds] `{name}`", value) for name, value in method.clouds.items()]
    rows += [(f"trait `{name}`", value) for name, value in own.items() if value != usual[name]]
    cells = "".join(f"| {name} | {_shown(value)} |\n" for name, value in rows)
    return f"| sets | to |\n|---|---|\n{cells}"


BLOCKS: dict[str, Callable[[], str]] = {
    "settings": settings,
    "commands": commands,
    "formats": formats,
    "api": api,
    "results": results,
    "search policy": searches.table,
    **dict(_papers()),
}


def main() -> None:
    """Write all pages."""
    measured = figures()
    for page in pages():
        text = page.read_text(encoding="utf-8")
        page.write_text(generated(text, measured), encoding="utf-8")


if __name__ == "__main__":
    main()
