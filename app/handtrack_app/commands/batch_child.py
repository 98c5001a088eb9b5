"""One recording in a process of its own: `python -m handtrack_app.commands.batch_child track SESSION …`.

It ends with whoever started it, however that ended: their end of its stdin closes. What was tracked until then is on disk.
"""

from __future__ import annotations

import importlib
import os
import sys
import threading

_LEFT_ALONE = 137
"""its exit code then, as if it had been killed"""


def _end_with_parent() -> None:
    while os.read(0, 1):  # not sys.stdin: its lock must be free when the interpreter ends
        pass
    os._exit(_LEFT_ALONE)


if __name__ == "__main__":
    threading.Thread(target=_end_with_parent, daemon=True).start()
    sys.exit(importlib.import_module("handtrack_app.cli").main(sys.argv[1:]))
