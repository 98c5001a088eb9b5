"""CSV with a row a frame (contracts §5): angles in degrees, lengths in metres, joints in the world."""

from __future__ import annotations

from pathlib import Path

from handtrack.export.table import ResultsTable
from handtrack.export.tables.cells import number, write_rows, write_sidecar
from handtrack.tracking.frame.result import TrackResult
from handtrack.tracking.frame.tables.labelled import frame_columns


def write(path: Path, table: ResultsTable) -> list[Path]:
    """Write the table and, beside it, what it means (.json)."""
    write_csv(path, table.track)
    meanings = {name: meaning for name, _, meaning in frame_columns(table.track)}
    return [write_sidecar(path, table, meanings)]


def write_csv(path: Path | str, track: TrackResult) -> None:
    """Write the columns of contracts §5; then what else is known of each frame, such as how probably it is off, and the reason."""
    names, columns, _ = zip(*frame_columns(track), strict=True)
    cells = (map(number if c.dtype.kind == "f" else str, c.tolist()) for c in columns)
    write_rows(Path(path), names, zip(*cells, strict=True))
