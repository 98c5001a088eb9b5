"""Imported by the process of which copies are made (`killing`): all that they use is loaded, and what is compiled with it."""

import tempfile
from pathlib import Path

import tests.app.commands.test_interrupts
import tests.app.engine.test_kills
import tests.store.test_killed  # noqa: F401
from handtrack.session.run import TrackingRun
from handtrack.session.session import Session
from handtrack.session.track_session import request_for, track_session
from tests.app.command_line import small_recording

with tempfile.TemporaryDirectory() as folder:
    run = TrackingRun.open(Session.open(small_recording(Path(folder) / "small", frames=2)), {})
    list(track_session(*request_for(run, range(2), from_init=True)))
