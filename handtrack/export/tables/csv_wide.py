"""CSV with a row a frame (contracts §5): angles in degrees, lengths in metres, joints in the world."""

from __future__ import annotations

from pathlib import Path

from handtrack.export.table import ResultsTable
from handtrack.export.tables.cells import number, write_rows, write_sidecar
from handtrack.tracking.frame.tables.labelled import frame_columns


def write(path: Path, table: ResultsTable) -> list[Path]:
    """Write the columns of contracts §5, then what else is known of each frame, such as how probably it is off, and the reason; and
    beside the table what it means (.json).
    """
    names, columns, meanings = zip(*frame_columns(table.track), strict=True)
    cells = (map(number if c.dtype.kind == "f" else str, c.tolist()) for c in columns)
    write_rows(path, names, zip(*cells, strict=True))
    return [write_sidecar(path, table, dict(zip(names, meanings, strict=True)))]
