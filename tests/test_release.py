"""What is published: one version, links that lead somewhere from anywhere, a site of all public names."""

from __future__ import annotations

import re
import tomllib

import pytest

from docs.release import readme, source_of, urls
from handtrack.version import VERSION
from tests.conftest import REPOSITORY

SOURCE = "https://host.example/owner/handtrack/blob/v1"
PROJECT = (REPOSITORY / "pyproject.toml").read_text(encoding="utf-8")


def test_the_version_is_the_same_everywhere():
    citation = (REPOSITORY / "CITATION.cff").read_text(encoding="utf-8")
    assert f"\nversion: {VERSION}\n" in citation
    pattern = tomllib.loads(PROJECT)["tool"]["hatch"]["version"]["pattern"]
    found = re.search(pattern, (REPOSITORY / "handtrack" / "version.py").read_text())
    assert found is not None
    assert found["version"] == VERSION


def test_the_readme_of_a_release_has_no_relative_link():
    text = readme((REPOSITORY / "README.md").read_text(encoding="utf-8"), SOURCE)
    assert "pip install handtrack3d && handtrack demo" in text
    links = re.findall(r"\]\(([^)\s]+)\)", text)
    assert len(links) > 10
    assert [link for link in links if not re.match(r"https://|#", link)] == []
    assert f"({SOURCE.replace('/blob/', '/raw/')}/docs/figures/workbench_tracked.png)" in text


def test_a_release_names_its_addresses():
    named = urls(SOURCE)
    assert named["Homepage"] == "https://host.example/owner/handtrack"
    assert set(named) == {"Homepage", "Documentation", "Changelog", "Issues"}


@pytest.mark.parametrize("remote", [
    "https://host.example/owner/handtrack.git", "https://name@host.example/owner/handtrack", "git@host.example:owner/handtrack.git",
])  # fmt: skip
def test_the_address_is_that_of_the_clone_s_origin(remote: str) -> None:
    assert source_of(remote, "1") == SOURCE
    assert source_of("/folder/handtrack", "1") == ""


def test_what_users_are_told_to_install_is_ours_and_there_is_such_an_extra():
    project = tomllib.loads(PROJECT)["project"]
    found = 0
    for folder in ("docs", "sessions", "handtrack", "app"):
        for path in sorted((REPOSITORY / folder).rglob("*")):
            if path.suffix not in (".md", ".ipynb", ".py"):
                continue
            text = path.read_text(encoding="utf-8")
            for name, extra in re.findall(r"\binstall '?(handtrack\w*)(?:\[(\w+)\])?", text):
                found += 1
                assert name == project["name"], path
                assert not extra or extra in project["optional-dependencies"], path
    assert found > 3
