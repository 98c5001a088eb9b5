"""Where details of mistakes are kept; light to import."""

from __future__ import annotations

import tempfile
from pathlib import Path

LOG_FILE = Path(tempfile.gettempdir()) / "handtrack_workbench.log"
