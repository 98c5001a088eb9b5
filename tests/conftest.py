"""What every test may ask for: the shared recordings, and random numbers that are the same each time."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest


@pytest.fixture
def data_dir() -> Path:
    """The folder of shared data: HANDTRACK_DATA, or ../shared/data beside the checkout."""
    beside = Path(__file__).resolve().parents[2] / "shared" / "data"
    folder = Path(os.environ.get("HANDTRACK_DATA", beside))
    if not folder.is_dir():
        pytest.skip(f"no shared data at {folder}; set HANDTRACK_DATA")
    return folder


@pytest.fixture
def rng() -> np.random.Generator:
    """A fixed source of random numbers."""
    return np.random.default_rng(20070219)
