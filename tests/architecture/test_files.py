"""Nothing that is committed names a machine or a registry."""

import re
import subprocess

import pytest

from tests.conftest import REPOSITORY

# Put together here, so that this file does not hold what it looks for.
REGISTRIES = re.compile(
    "|".join([r"pypi" + r"\.org", "files" + r"\.pythonhosted", "registry" + r"\.npmjs"])
)
INDEX_URL = re.compile(r"https?://[^ \"'\s]*/(?:simple|packages)/")
MACHINE_PATH = re.compile(
    "|".join(["/work" + r"/(?:main|venv|shared|notes|scratch)", "/ro" + "ot/"])
)
BINARY = {".png", ".jpg", ".mp4", ".npz", ".ply", ".gif", ".ico", ".glb", ".webp", ".avi", ".mkv"}


def committed():
    """Return the files git knows or would add: none where there is no repository."""
    command = ["git", "ls-files", "--cached", "--others", "--exclude-standard", "-z"]
    listed = subprocess.run(command, cwd=REPOSITORY, capture_output=True, text=True, check=False)
    paths = [REPOSITORY / name for name in listed.stdout.split("\0") if name]
    return [path for path in paths if path.is_file()]


@pytest.mark.parametrize("pattern", [REGISTRIES, INDEX_URL, MACHINE_PATH])
def test_no_file_names_a_registry_or_this_machine(pattern):
    named = []
    for path in committed():
        if path.suffix.lower() in BINARY:
            continue
        text = path.read_text(encoding="utf-8", errors="replace")
        named += [
            f"{path.relative_to(REPOSITORY)}:{number}: {line.strip()[:100]}"
            for number, line in enumerate(text.splitlines(), 1)
            if pattern.search(line)
        ]
    assert not named, "\n".join(named)
