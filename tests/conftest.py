"""Fixtures for all tests."""

import atexit
import os
import shutil
import sys
import tempfile
from pathlib import Path

# as the command line does, before NumPy is there: threads of BLAS cost more than they bring at these sizes
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("MKL_NUM_THREADS", "1")
if "HANDTRACK_HOME" not in os.environ:  # copies and logs do not go to whoever runs the tests
    os.environ["HANDTRACK_HOME"] = tempfile.mkdtemp(prefix="handtrack_tests_")
    atexit.register(shutil.rmtree, os.environ["HANDTRACK_HOME"], ignore_errors=True)
# else each program that a test starts would compile all modules anew; spawned ones only read what this process has written
if os.environ.pop("PYTHONDONTWRITEBYTECODE", None):
    sys.pycache_prefix = os.path.join(os.environ["HANDTRACK_HOME"], "bytecode")
    os.environ["PYTHONPYCACHEPREFIX"] = sys.pycache_prefix
    sys.dont_write_bytecode = False
if worker := os.environ.get("PYTEST_XDIST_WORKER"):  # no worker reads another one's logs
    os.environ["HANDTRACK_HOME"] = os.path.join(os.environ["HANDTRACK_HOME"], worker)
    os.makedirs(os.environ["HANDTRACK_HOME"], exist_ok=True)
# no test fetches anything from a network
os.environ |= {"PIP_CONFIG_FILE": os.devnull, "PIP_NO_INDEX": "1"}
os.environ.pop("PIP_FIND_LINKS", None)

import numpy as np
import pytest

from handtrack.errors import HandtrackError

REPOSITORY = Path(__file__).resolve().parents[1]


def refused(words, call, *given, **named):
    """Check that a call is refused in a sentence with these words, a regular expression."""
    with pytest.raises(HandtrackError, match=words):
        call(*given, **named)


@pytest.fixture
def rng() -> np.random.Generator:
    """Random numbers that are the same in every run."""
    return np.random.default_rng(7)


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """The shared recordings (contracts §6); tests that need them skip where they are absent."""
    from handtrack.bench.measuring import data_folder

    try:
        return data_folder()
    except HandtrackError as nothing:
        pytest.skip(str(nothing))
