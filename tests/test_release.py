"""What is published: one version, links that lead somewhere from anywhere, a site of all public names."""

import re

import pytest

from docs.release import readme, source_of
from handtrack.version import VERSION
from tests.conftest import REPOSITORY

SOURCE = "https://host.example/owner/handtrack/blob/v1"


def test_the_version_is_the_same_everywhere():
    citation = (REPOSITORY / "CITATION.cff").read_text(encoding="utf-8")
    assert f"\nversion: {VERSION}\n" in citation


def test_the_readme_of_a_release_has_no_relative_link():
    text = readme((REPOSITORY / "README.md").read_text(encoding="utf-8"), SOURCE)
    links = re.findall(r"\]\(([^)\s]+)\)", text)
    assert len(links) > 10
    assert [link for link in links if not re.match(r"https://|#", link)] == []
    assert f"({SOURCE.replace('/blob/', '/raw/')}/docs/figures/workbench_tracked.png)" in text


@pytest.mark.parametrize("remote", [
    "https://host.example/owner/handtrack.git", "https://name@host.example/owner/handtrack", "git@host.example:owner/handtrack.git",
])  # fmt: skip
def test_the_address_is_that_of_the_clone_s_origin(remote):
    assert source_of(remote, "1") == SOURCE
    assert source_of("/folder/handtrack", "1") == ""
