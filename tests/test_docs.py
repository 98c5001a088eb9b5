"""The documentation is true where a program can tell: links, commands, the README's example, generated parts."""

import re
import runpy
import shlex
from urllib.parse import unquote

import pytest

from docs import generate
from docs.figures import drift, measured
from handtrack.session import bundled
from handtrack.simulation.simulate import Simulation, simulate
from handtrack_app.cli import build_parser
from tests.app.command_line import QUICK
from tests.conftest import REPOSITORY

LINK = re.compile(r"\[[^\]]*\]\(([^)\s]+)\)")
FENCE = re.compile(r"^```(\w*)\n(.*?)^```", re.MULTILINE | re.DOTALL)
SHORT = range(3)


def name(page):
    return str(page.relative_to(REPOSITORY))


def blocks(page, language):
    """Return the fenced blocks of a page that are in a language."""
    found = FENCE.findall(page.read_text(encoding="utf-8"))
    return [body for kind, body in found if kind == language]


def anchors(page):
    """Return the anchors of a page's headings."""
    text = FENCE.sub("", page.read_text(encoding="utf-8"))
    titles = re.findall(r"^#+ +(.*)$", text, re.MULTILINE)
    plain = [re.sub(r"[^\w\- ]", "", title.lower()) for title in titles]
    return {title.replace(" ", "-") for title in plain}


def broken_links(page):
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


def commands(page):
    """Return the `handtrack …` lines of a page's shell blocks, as arguments."""
    lines = [line.strip() for body in blocks(page, "sh") for line in body.replace("\\\n", " ").splitlines()]  # fmt: skip
    return [shlex.split(line, comments=True)[1:] for line in lines if line.startswith("handtrack ")]


def test_links_lead_somewhere():
    pages = *generate.pages(), *REPOSITORY.glob("docs/notebooks/*.ipynb")
    wrong = {name(page): broken_links(page) for page in pages}
    assert {page: links for page, links in wrong.items() if links} == {}


def test_commands_in_pages_parse(capsys):
    for page in generate.pages():
        for arguments in commands(page):
            try:
                build_parser().parse_args(arguments)
            except SystemExit:
                words = f"{name(page)}: handtrack {' '.join(arguments)}"
                pytest.fail(f"{words}\n{capsys.readouterr().err}")


def test_readme_example_runs_as_written(tmp_path, monkeypatch, capsys):
    (example,) = blocks(REPOSITORY / "README.md", "python")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(bundled, "_CHECKOUT", tmp_path)
    simulate(tmp_path / "another_hand", Simulation(2, len(SHORT), (160, 120), images=False))
    with (tmp_path / "another_hand" / "session.toml").open("a") as file:
        file.write(QUICK)
    exec(compile(example, "README.md", "exec"), {"__name__": "readme"})
    assert f"({len(SHORT)}, 21, 3)" in capsys.readouterr().out
    rows = (tmp_path / "angles.csv").read_text().splitlines()
    assert len(rows) == 1 + len(SHORT)


def test_the_example_of_a_term_has_its_derivatives(tmp_path, rng):
    page = REPOSITORY / "docs" / "contributing" / "adding_a_term.md"
    path = tmp_path / "table.py"
    path.write_text("\n".join(blocks(page, "python")), encoding="utf-8")
    runpy.run_path(str(path), run_name="table")["test_derivatives"](rng)


def test_generated_parts_are_current():
    table = generate.figures()
    stale = []
    for page in generate.pages():
        text = page.read_text(encoding="utf-8")
        if generate.generated(text, table) != text:
            stale.append(name(page))
    assert stale == [], "run: python -m docs.generate"


def test_drift_of_a_figure_is_reported():
    commands = ["handtrack simulate --out s --cameras 1 --frames 2 --size 64 48 --no-images --json"]
    found = measured({"commands": commands, "values": {"frames": 3, "cameras": 1, "gone": 1}})
    assert found == {"frames": 2, "cameras": 1}
    assert len(drift("s", {"frames": 3, "cameras": 1, "gone": 1}, found)) == 2
