"""The public names exist and load late; the command line starts quickly."""

import json
import subprocess
import sys

from tests.conftest import REPOSITORY

HEAVY = ("cv2", "numba", "scipy", "viser", "rerun", "skimage", "trimesh", "numpy")


def loaded_by(statements: str) -> set[str]:
    """Return which heavy packages a fresh Python has loaded after some statements."""
    code = f"{statements}\nimport json, sys\nprint(json.dumps([m for m in {HEAVY} if m in sys.modules]))"
    run = [sys.executable, "-c", code]
    done = subprocess.run(run, cwd=REPOSITORY, capture_output=True, text=True, check=True)
    return set(json.loads(done.stdout.splitlines()[-1]))


def test_importing_handtrack_loads_nothing_heavy():
    assert loaded_by("import handtrack") == set()


def test_help_loads_nothing_heavy():
    help_ = (
        "import handtrack_app.cli as cli\ntry:\n    cli.main(['--help'])\nexcept SystemExit as end:\n"
        "    assert not end.code"
    )
    assert loaded_by(help_) == set()
