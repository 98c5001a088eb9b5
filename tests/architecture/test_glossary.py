"""Public names use the field's words: docs/glossary.md says which are not to be used, and what is said instead."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

from tests.conftest import REPOSITORY

GLOSSARY = REPOSITORY / "docs" / "glossary.md"
PACKAGES = (REPOSITORY / "handtrack", REPOSITORY / "app" / "handtrack_app")
STILL_TO_BE_RENAMED: set[str] = {
    "RunSession.cloud_eyes",
    "Session.cloud_eyes",
    "Stage.axes_looked_along",
    "knobs",
    "looked_at",
    "unwound",
}
"""module, Class or Class.method; strike off what is renamed, add nothing"""


def banned_words(text: str) -> set[str]:
    """Return the words on the left of the list below "We do not say"."""
    rows = re.findall(r"^- ([a-z, ]+) →", text.partition("## We do not say")[2], re.MULTILINE)
    return {word for row in rows for word in row.split(", ")}


def words_of(name: str) -> set[str]:
    """Return the parts of a snake_case or CamelCase name, in lower case."""
    parts = re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+", name.rpartition(".")[2])
    return {part.lower() for part in parts}


def public_names(path: Path) -> Iterator[str]:
    """Yield the module's name and its public classes, functions and methods, these as `Class.method`."""
    if path.stem == "__init__" or path.stem.startswith("_"):
        return
    yield path.stem
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.ClassDef | ast.FunctionDef) and not node.name.startswith("_"):
            yield node.name
            for inner in node.body if isinstance(node, ast.ClassDef) else ():
                if isinstance(inner, ast.FunctionDef) and not inner.name.startswith("_"):
                    yield f"{node.name}.{inner.name}"


def names_in_dialect(packages: tuple[Path, ...]) -> set[str]:
    banned = banned_words(GLOSSARY.read_text(encoding="utf-8"))
    paths = [path for package in packages for path in package.rglob("*.py")]
    return {name for path in paths for name in public_names(path) if words_of(name) & banned}


def test_public_names_use_words_of_the_glossary():
    found = names_in_dialect(PACKAGES)
    assert found - STILL_TO_BE_RENAMED == set(), "docs/glossary.md says what to call these"
    assert STILL_TO_BE_RENAMED - found == set(), "renamed: strike these off the list"


def test_the_glossary_has_its_words():
    text = GLOSSARY.read_text(encoding="utf-8")
    words = re.findall(r"^- \*\*(.+?)\*\* \(", text, re.MULTILINE)
    assert 40 <= len(words) <= 60
    assert len(words) == len(set(words))
    assert {"laid", "held", "sight", "sights", "aside"} <= banned_words(text)


def test_words_are_found_in_names_of_either_form(tmp_path):
    room = tmp_path / "room"
    room.mkdir()
    (room / "laid_shapes.py").write_text(
        "class HeldPose:\n    def sight(self): ...\n    def _told(self): ...\ndef shield(): ...\n"
    )
    assert names_in_dialect((room,)) == {"laid_shapes", "HeldPose", "HeldPose.sight"}
