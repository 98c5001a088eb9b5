"""The public names exist and load late; the command line starts quickly."""

import subprocess
import sys

from tests.conftest import REPOSITORY

HEAVY = "cv2 numba scipy viser rerun skimage trimesh numpy"


def test_importing_handtrack_and_help_load_nothing_heavy():
    code = (
        "import handtrack, sys, handtrack_app.cli as cli\n"
        "try:\n    cli.main(['--help'])\nexcept SystemExit as end:\n    assert not end.code\n"
        f"print([m for m in {HEAVY.split()} if m in sys.modules])"
    )
    run = [sys.executable, "-c", code]
    done = subprocess.run(run, cwd=REPOSITORY, capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"
