"""What mkdocs is told of pages that lie elsewhere: the README of sessions, and a page of every public name."""

from __future__ import annotations

import ast
import re
from importlib import import_module
from pathlib import Path
from typing import Any

_REPOSITORY = Path(__file__).resolve().parents[1]
_SESSIONS = "sessions.md"
_ELSEWHERE = {
    r"\((?:\.\./)+sessions/README\.md": f"({_SESSIONS}",
    r"\(reports/\)": "(reports/index.md)",
    r"\((?:\.\./)+README\.md(?:#[\w-]+)?\)": "(index.md)",
    r"\]\((?:\.\./)+(?!sessions|README)((?:handtrack|app|tests|\.ci)/[^)]*)\)": r"]",
}
"""links to what is no page of the site, and what stands for them"""


def public_names() -> dict[str, str]:
    """Return where each public name of `handtrack` is defined: its module's path and its own."""
    tree = ast.parse((_REPOSITORY / "handtrack" / "__init__.pyi").read_text(encoding="utf-8"))
    imports = [node for node in tree.body if isinstance(node, ast.ImportFrom)]
    return {
        name.name: f"handtrack.{one.module}.{name.name}" for one in imports for name in one.names
    }


def api_page() -> str:
    """Return the page of all public names, for mkdocstrings to fill."""
    entries = "\n".join(f"::: {path}\n" for _, path in sorted(public_names().items()))
    return f"# API\n\nEverything that `from handtrack import …` gives; [tasks and an overview](library.md).\n\n{entries}"


def reports_page() -> str:
    """Return the list of all reports."""
    reports = sorted((_REPOSITORY / "docs" / "reports").glob("*.md"))
    rows = (f"- [{file.stem}]({file.name})" for file in reports)
    return "# Reports\n\nWhat the benchmarks measured.\n\n" + "\n".join(rows) + "\n"


def site_markdown(text: str, depth: int) -> str:
    """Return a page's text with links to files outside of docs/ changed to pages of the site. depth: folders it lies in."""
    for pattern, other in _ELSEWHERE.items():
        text = re.sub(pattern, other.replace("(", "(" + "../" * depth, 1), text)
    return text


def on_files(files: Any, config: Any) -> Any:
    """Add the pages that lie elsewhere (called by mkdocs)."""
    File = import_module("mkdocs.structure.files").File
    sessions = (_REPOSITORY / "sessions" / "README.md").read_text(encoding="utf-8")
    sessions = sessions.replace("](../docs/", "](").replace("](open_fist_open/README.md)", "]")
    files.append(File.generated(config, "api.md", content=api_page()))
    files.append(File.generated(config, "reports/index.md", content=reports_page()))
    files.append(File.generated(config, _SESSIONS, content=sessions))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Change links (called by mkdocs)."""
    return site_markdown(markdown, page.file.src_uri.count("/"))
