"""Writes the project's addresses and a README with absolute links into what is built, whoever builds it (hatchling's hook).

A package registry's page does not have the files that README.md links to. The address is that of the clone's `origin`, at the tag
of the version, or what HANDTRACK_SOURCE says, such as https://HOST/OWNER/handtrack/blob/v0.1.0. Without either, as in a clone of a
folder, README.md is taken as it is. A wheel built from an sdist takes the sdist's.
"""

from __future__ import annotations

import os
import re
import subprocess
from pathlib import Path
from typing import Any

_DISTRIBUTION = "handtrack3d"
_LINK = re.compile(r"(!?)\[([^\]]*)\]\((?!\w+:|#)([^)\s]+)\)")
_REMOTE = re.compile(r"(?:https?://(?:[^@/]*@)?|ssh://git@|git@)([\w.-]+)[:/](.+?)(?:\.git)?/?$")


def get_metadata_hook() -> type:
    """Return what `[tool.hatch.metadata.hooks.custom]` of pyproject.toml runs; hatchling is there while a package is built."""
    from hatchling.metadata.plugin.interface import MetadataHookInterface  # type: ignore[import]

    class ReleaseMetadata(MetadataHookInterface):
        def update(self, metadata: dict[str, Any]) -> None:
            root = Path(self.root)
            source = os.environ.get("HANDTRACK_SOURCE") or source_of(
                _origin(root), metadata["version"]
            )
            text = (root / "README.md").read_text(encoding="utf-8")
            text = readme(text, source.rstrip("/")) if source else text
            metadata["readme"] = {"content-type": "text/markdown", "text": text}
            metadata["urls"] = urls(source.rstrip("/")) if source else {}

    return ReleaseMetadata


def source_of(remote: str, version: str) -> str:
    """Return the web address of a repository's files at the tag of a version; empty for a remote that has none."""
    found = _REMOTE.match(remote)
    return f"https://{found[1]}/{found[2]}/blob/v{version}" if found else ""


def absolute(text: str, source: str) -> str:
    """Return Markdown with relative links led to `source`; pictures to the raw files there."""
    raw = source.replace("/blob/", "/raw/")

    def led(match: re.Match[str]) -> str:
        picture, words, target = match.groups()
        return f"{picture}[{words}]({raw if picture else source}/{target})"

    return _LINK.sub(led, text)


def readme(text: str, source: str) -> str:
    """Return README.md for a registry's page: links lead to `source`, and what is there to install comes first."""
    install = f"## Start\n\n```sh\npip install {_DISTRIBUTION} && handtrack demo\n```\n\nFrom its source: it"
    return absolute(text.replace("## Start\n\nIt", install, 1), source)


def urls(source: str) -> dict[str, str]:
    """Return the project's addresses by their names. source: as `absolute`."""
    home = source.partition("/blob/")[0]
    return {
        "Homepage": home,
        "Documentation": f"{source}/docs/index.md",
        "Changelog": f"{source}/docs/changelog.md",
        "Issues": f"{home}/issues",
    }


def _origin(root: Path) -> str:
    try:
        told = subprocess.run(
            ["git", "-C", str(root), "remote", "get-url", "origin"],
            capture_output=True, text=True, check=False,
        )  # fmt: skip
    except OSError:  # no git
        return ""
    return told.stdout.strip()
