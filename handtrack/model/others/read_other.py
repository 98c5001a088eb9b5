"""Other programs' models as definitions: the table of the forms that are read."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Any

_FORMS = {".urdf": "urdf", ".bvh": "bvh", ".xml": "mjcf", ".mjcf": "mjcf"}
OTHERS = tuple(_FORMS)
"""endings of files that are read"""


def read_other(path: Path) -> dict[str, Any]:
    """Return the tables of a definition made of a file with one of these endings. Raises HandtrackError."""
    form = _FORMS[path.suffix.lower()]
    module = import_module(f"handtrack.model.others.{form}")
    return getattr(module, f"read_{form}")(path)
