"""Import matplotlib, which only the extra `docs` installs, and save figures alike."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from handtrack.errors import HandtrackError


def pyplot() -> Any:
    """Return matplotlib's pyplot, drawing to files only. Raises HandtrackError where it is missing."""
    try:
        import matplotlib  # pyright: ignore[reportMissingImports]
    except ImportError:
        raise HandtrackError(
            "figures are drawn with matplotlib, which is not installed: pip install 'handtrack3d[docs]'."
        ) from None
    matplotlib.use("Agg")
    from matplotlib import pyplot  # pyright: ignore[reportMissingImports]

    return pyplot


def tight(figure: Any) -> Any:
    """Return the figure with little room between its parts."""
    figure.tight_layout(pad=0.4)
    return figure


def saved(figure: Any, path: Path) -> None:
    """Write a figure, the same bytes for the same figure, and forget it."""
    figure.savefig(path, dpi=110, bbox_inches="tight", metadata={"Software": None})
    pyplot().close(figure)
