"""The bundled recordings stay as they are: whoever opens one works on a copy of his own."""

from __future__ import annotations

import hashlib
from pathlib import Path

from handtrack.session import bundled
from handtrack.session.layout import INIT_FILE, SESSION_FILE, TRUTH_FILE


def own_copy(folder: Path) -> Path:
    """Return the folder to work in: a copy in the user's data folder for a recording that lies in a checkout.

    The copy's name carries a stamp of the recording, so that a changed recording gets a new one. An installed
    program's bundled session is such a copy already; any other folder is returned as it is.
    """
    source = Path(folder).resolve()
    if source.parent != bundled.checkout_shelf():
        return Path(folder)
    stamp = hashlib.sha256()
    for name in (SESSION_FILE, INIT_FILE, TRUTH_FILE):
        if (source / name).is_file():
            stamp.update((source / name).read_bytes())
    return bundled.working_copy(source, f"{source.name}-{stamp.hexdigest()[:8]}")
