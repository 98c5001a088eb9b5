"""poses.npz again: everything, for Python."""

from __future__ import annotations

from pathlib import Path

from handtrack.export.table import ResultsTable
from handtrack.session.formats.tables import write_npz


def write(path: Path, table: ResultsTable) -> list[Path]:
    """Write the result as it was read."""
    write_npz(path, table.track)
    return [path]
