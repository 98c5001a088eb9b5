"""Killed in the middle of posing and tracking: what was accepted is there when the session is opened again."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np

from handtrack_app.engine.document import Document
from handtrack_app.engine.worker import Worker
from handtrack_app.protocol import snapshots
from tests.app.fake_run import fake_document
from tests.conftest import REPOSITORY

WORK = """
import sys, time
from pathlib import Path
from handtrack_app.engine.worker import Worker
from tests.app.fake_run import fake_document

worker = Worker(Path(sys.argv[1]), lambda s: None, lambda f, o: fake_document(f, o, stuck=lambda f: f == 8))
worker.start()
assert worker.wait_opened(60.0) is None
names = worker.document.model.parameter_names
values = list(worker.document.start)
values[names.index("index_pip_flex")] = 0.75
worker.engine.set_pose(9, tuple(values), 1)
worker.engine.set_setting("silhouettes.weight", 2.0)
worker.engine.track(3, 12, 3)
while len(worker.document.results) < 5:  # frame 8 never comes
    time.sleep(0.01)
print("tracking", flush=True)
time.sleep(60)
"""


def test_nothing_accepted_is_lost_when_the_program_is_killed(tmp_path: Path) -> None:
    """Fault C39."""
    paths = [str(REPOSITORY), str(REPOSITORY / "app"), os.environ.get("PYTHONPATH", "")]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, paths))}
    program = subprocess.Popen(
        [sys.executable, "-c", WORK, str(tmp_path)], env=environment, stdout=subprocess.PIPE
    )
    assert program.stdout is not None
    try:
        assert program.stdout.readline().strip() == b"tracking"
    finally:
        program.send_signal(signal.SIGKILL if hasattr(signal, "SIGKILL") else signal.SIGTERM)
        program.wait(10)
        program.stdout.close()

    seen: list[snapshots.Snapshot] = []
    worker = Worker(tmp_path, seen.append, fake_document)
    worker.start()
    assert worker.wait_opened(60.0) is None
    document: Document | None = worker.document
    worker.stop()
    assert document is not None
    names = document.model.parameter_names
    np.testing.assert_allclose(document.by_hand[9][names.index("index_pip_flex")], 0.75)
    assert document.run.settings.silhouettes.weight == 2.0
    assert sorted(document.results) in ([3, 4, 5, 6], [3, 4, 5, 6, 7]), "at most the last is lost"
    told = [s.text for s in seen if isinstance(s, snapshots.Notice) and s.title == "Welcome back"]
    assert len(told) == 1 and "tracked frames" in told[0]
