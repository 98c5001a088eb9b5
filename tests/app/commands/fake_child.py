"""Stands for the process that tracks a recording: quick, and it notes when it began and ended.

`python -m tests.app.commands.fake_child track FOLDER … --json`. What a file `ends` in the folder says is how it ends.
"""

import json
import sys
import threading
import time
from pathlib import Path

from handtrack_app.commands.batch_child import _end_with_parent

if __name__ == "__main__":
    threading.Thread(target=_end_with_parent, daemon=True).start()
    folder = Path(sys.argv[2])
    with open(folder.parent / "work.log", "a") as log:
        print("begun", folder.name, file=log, flush=True)
        time.sleep(0.02)
        how = (folder / "ends").read_text() if (folder / "ends").is_file() else ""
        if how:
            print(f"handtrack track: {folder}: {how}", file=sys.stderr)
            sys.exit(2)
        output = folder / "tracks" / "poses.npz"
        output.parent.mkdir(exist_ok=True)
        output.write_bytes(folder.name.encode())
        print("ended", folder.name, file=log, flush=True)
    lost = int(folder.name[-1])
    frames = {"tracked": 10 - lost, "doubtful": 0, "lost": lost}
    print(
        json.dumps({"frames": frames, "seconds": 0.1, "warnings": ["<b>"], "output": str(output)})
    )
