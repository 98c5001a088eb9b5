"""The documentation tells the truth: links lead somewhere, commands exist, settings are all there, examples run."""

from __future__ import annotations

import re
import shlex
import tomllib
from pathlib import Path
from urllib.parse import unquote

import pytest

from docs import figures
from docs.settings_page import PAGE, settings_page
from handtrack.session.clouds_settings import CLOUD_SETTINGS
from handtrack.session.session import Session
from handtrack.tracking.frame.settings import SETTINGS
from handtrack_app.cli import build_parser
from tests.conftest import REPOSITORY

PAGES = sorted(
    [REPOSITORY / "README.md"]
    + list((REPOSITORY / "docs").rglob("*.md"))
    + list((REPOSITORY / "sessions").glob("*.md"))
    + list((REPOSITORY / "sessions").glob("*/*.md"))
)
LINK = re.compile(r"\[[^\]]*\]\(([^)\s]+)\)")
FENCE = re.compile(r"^```(\w*)\n(.*?)^```", re.MULTILINE | re.DOTALL)
SHORT = range(3)


def name(page: Path) -> str:
    return str(page.relative_to(REPOSITORY))


def blocks(page: Path, language: str) -> list[str]:
    """Return the fenced blocks of a page that are in a language."""
    found = FENCE.findall(page.read_text(encoding="utf-8"))
    return [body for kind, body in found if kind == language]


def anchors(page: Path) -> set[str]:
    """Return what a link may point at within a page, as GitHub makes it of the headings."""
    text = FENCE.sub("", page.read_text(encoding="utf-8"))
    titles = re.findall(r"^#+ +(.*)$", text, re.MULTILINE)
    plain = [re.sub(r"[^\w\- ]", "", title.lower()) for title in titles]
    return {title.replace(" ", "-") for title in plain}


def broken_links(page: Path) -> list[str]:
    text = FENCE.sub("", page.read_text(encoding="utf-8"))
    wrong = []
    for link in LINK.findall(text):
        if re.match(r"[a-z]+:", link):
            continue
        file, _, anchor = unquote(link).partition("#")
        target = (page.parent / file).resolve() if file else page
        if not target.exists() or (
            anchor and target.suffix == ".md" and anchor not in anchors(target)
        ):
            wrong.append(link)
    return wrong


ROOTS = [
    REPOSITORY / below
    for below in (
        "",
        "handtrack",
        "handtrack/tracking",
        "handtrack/session",
        "handtrack/terms",
        "app/handtrack_app",
    )
]
"""what a path in a page may be relative to"""


EXAMPLES = {"handtrack/terms/table.py", "tests/terms/test_table.py", "material/calibration.toml"}
"""what docs/adding_a_term.md and the tutorial make"""


def named_paths(page: Path) -> set[str]:
    """Return the source files and folders of the program that a page's text or diagrams name."""
    text = page.read_text(encoding="utf-8")
    files = re.findall(r"(?<![\w/.<{-])((?:[a-z_0-9]+/)+[a-z_0-9]+\.(?:py|toml))\b", text)
    folders = re.findall(r"`(handtrack/[a-z_/]+)`", text)
    return {*files, *folders} - EXAMPLES


def commands(page: Path) -> list[list[str]]:
    """Return the `handtrack …` lines of a page's shell blocks, as arguments."""
    lines = [line.strip() for body in blocks(page, "sh") for line in body.splitlines()]
    return [shlex.split(line, comments=True)[1:] for line in lines if line.startswith("handtrack ")]


def known_commands() -> set[str]:
    choices = next(a.choices for a in build_parser()._actions if a.dest == "command")
    return set(choices or ())


# ---- every page ------------------------------------------------------------------------------------


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_relative_links_lead_somewhere(page):
    assert broken_links(page) == [], f"{name(page)} links to what is not there"


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_commands_of_shell_blocks_can_be_given(page, capsys):
    for arguments in commands(page):
        try:
            build_parser().parse_args(arguments)
        except SystemExit:
            pytest.fail(f"handtrack {' '.join(arguments)}\n{capsys.readouterr().err}")


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_commands_named_in_the_text_exist(page):
    text = page.read_text(encoding="utf-8")
    named = set(re.findall(r"`handtrack ([a-z]+)", text)) - {"COMMAND"}
    assert named <= known_commands(), f"{name(page)}: {sorted(named - known_commands())}"


def test_files_named_in_pages_exist():
    named = {path for page in PAGES for path in named_paths(page)}
    missing = {path for path in named if not any((root / path).exists() for root in ROOTS)}
    assert missing == set()


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_modules_named_in_pages_exist(page):
    """A module, or a name in one."""
    for dotted in re.findall(r"\bhandtrack(?:\.[a-z_0-9]+)+", page.read_text(encoding="utf-8")):
        if f"{dotted.replace('.', '/')}.py" in EXAMPLES:
            continue
        module, _, last = dotted.rpartition(".")
        path = REPOSITORY.joinpath(*dotted.split("."))
        inside = REPOSITORY.joinpath(*module.split(".")).with_suffix(".py")
        there = path.is_dir() or path.with_suffix(".py").exists()
        assert there or (inside.exists() and last in inside.read_text(encoding="utf-8")), dotted


def test_broken_links_are_found(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("# One\n[a](page.md#one) [b](page.md#two) [c](nowhere.md) [d](https://x.y)\n")
    assert broken_links(page) == ["page.md#two", "nowhere.md"]


# ---- README ----------------------------------------------------------------------------------------


def test_readme_names_every_command():
    text = (REPOSITORY / "README.md").read_text(encoding="utf-8")
    assert set(re.findall(r"`handtrack ([a-z]+)", text)) == known_commands()


def test_readme_example_runs_as_written(tmp_path, monkeypatch, capsys):
    """The first frames only: the example itself says nothing about how many."""
    (example,) = blocks(REPOSITORY / "README.md", "python")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(Session, "frame_range", property(lambda _: SHORT))
    exec(compile(example, "README.md", "exec"), {"__name__": "readme"})
    assert f"({len(SHORT)}, 21, 3)" in capsys.readouterr().out
    rows = (tmp_path / "angles.csv").read_text().splitlines()
    assert len(rows) == 1 + len(SHORT)


def test_readme_pictures_are_small():
    """What everybody downloads with the page."""
    large = [
        f"{name(path)}: {path.stat().st_size / 1024:.0f} KiB"
        for path in (REPOSITORY / "docs" / "figures").glob("workbench_*.png")
        if path.stat().st_size > 250 * 1024
    ]
    assert large == []


# ---- settings --------------------------------------------------------------------------------------


def test_settings_page_is_up_to_date():
    assert PAGE.read_text(encoding="utf-8") == settings_page(), "run: python docs/settings_page.py"


def test_settings_page_lists_exactly_the_known_settings():
    rows = re.findall(
        r"^\| `([a-z_.]+)` \| (?:user|expert)", PAGE.read_text(encoding="utf-8"), re.MULTILINE
    )
    assert rows == [*SETTINGS, *CLOUD_SETTINGS]


def test_every_setting_has_a_meaning():
    rows = [line for line in settings_page().splitlines() if line.startswith("| `")]
    assert [row for row in rows if row.rstrip(" |").endswith("|")] == []
    assert all(len(row.split(" | ")[3].strip(" |")) > 3 for row in rows)


def test_pages_have_the_figures_that_were_measured():
    table = tomllib.loads(figures.TABLE.read_text(encoding="utf-8"))
    for page in figures.PAGES:
        text = page.read_text(encoding="utf-8")
        assert figures.printed(text, table) == text
        assert figures.printed(re.sub(r"-->[\d.%]+<!--", "-->9.9<!--", text), table) == text


def test_accuracy_that_readme_promises_says_where_it_is_from():
    text = (REPOSITORY / "README.md").read_text(encoding="utf-8")
    part = text.split("## What accuracy to expect")[1].split("\n## ")[0]
    rows = [line for line in part.splitlines() if line.startswith("| ")][1:]
    assert [row for row in rows if "<!-- / -->" not in row and "(docs/reports/" not in row] == []


def test_figures_are_what_the_commands_print():
    commands = ["handtrack simulate --out s --cameras 1 --frames 2 --no-images --json"]
    assert figures.measured({"commands": commands, "keys": ["frames", "cameras"]}) == {
        "frames": 2,
        "cameras": 1,
    }
