"""Builds a release: `python -m docs.release SOURCE --out dist`. SOURCE is the web address of the repository's files at the tag.

README.md links to files of the repository, which a package registry's page does not have; here links and pictures are made
absolute, and the project's addresses are written into its metadata. The checkout is not changed.
"""

from __future__ import annotations

import argparse
import re
import shutil
import subprocess
import sys
import tempfile
from importlib.util import find_spec
from pathlib import Path

_BUILDERS = (("uv", "build"), ("build",))
"""modules that build sdist and wheel; both take the tree, and `-o FOLDER`"""
_REPOSITORY = Path(__file__).resolve().parents[1]
_DISTRIBUTION = "handtrack3d"
_LINK = re.compile(r"(!?)\[([^\]]*)\]\((?!\w+:|#)([^)\s]+)\)")


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


def with_urls(project: str, source: str) -> str:
    """Return pyproject.toml with the project's addresses. source: as `absolute`."""
    home = source.partition("/blob/")[0]
    urls = {
        "Homepage": home,
        "Documentation": f"{source}/docs/index.md",
        "Changelog": f"{source}/docs/changelog.md",
        "Issues": f"{home}/issues",
    }
    table = "\n".join(f'{name} = "{url}"' for name, url in urls.items())
    return project.replace("[project.scripts]", f"[project.urls]\n{table}\n\n[project.scripts]", 1)


def tracked_files() -> list[Path]:
    """Return the files of the checkout that are committed, relative to it."""
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=_REPOSITORY, capture_output=True, check=True)  # fmt: skip
    return [Path(name) for name in listed.stdout.decode().split("\0") if name]


def main() -> int:
    """Build sdist and wheel."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)  # fmt: skip
    parser.add_argument("source", help="such as https://HOST/OWNER/handtrack/blob/v0.1.0")
    parser.add_argument("--out", type=Path, default=Path("dist"))
    args = parser.parse_args()
    builder = next(
        ([sys.executable, "-m", *words] for words in _BUILDERS if find_spec(words[0])), None
    )
    if builder is None:
        print(
            "docs.release: nothing here builds packages; `pip install uv` (or `build`).",
            file=sys.stderr,
        )
        return 2
    with tempfile.TemporaryDirectory(prefix="handtrack_release_") as place:
        tree = Path(place) / "handtrack"
        for file in tracked_files():
            (tree / file).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(_REPOSITORY / file, tree / file)
        for name, change in (("README.md", readme), ("pyproject.toml", with_urls)):
            text = (tree / name).read_text(encoding="utf-8")
            (tree / name).write_text(change(text, args.source.rstrip("/")), encoding="utf-8")
        return subprocess.run(
            [*builder, str(tree), "-o", str(args.out.resolve())], check=False
        ).returncode


if __name__ == "__main__":
    sys.exit(main())
