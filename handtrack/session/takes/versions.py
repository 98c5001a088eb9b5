"""Which versions of the programs are in use."""

from __future__ import annotations

import platform
from importlib.metadata import PackageNotFoundError, version

from handtrack.version import VERSION


def versions_in_use() -> dict[str, str]:
    """Return the versions of the programs that make a take."""
    versions = {name: version_of(name) for name in ("numpy", "numba")}
    return {"handtrack": VERSION} | versions | {"python": platform.python_version()}


def version_of(name: str) -> str:
    """Return a package's version; `unknown` where it is not installed."""
    try:
        return version(name)
    except PackageNotFoundError:
        return "unknown"
