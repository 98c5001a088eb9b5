"""Imported by the process of which copies are made (`killing`): all that they use is loaded, and what is compiled with it."""

import tempfile
from pathlib import Path

from handtrack.session.run import TrackingRun
from handtrack.session.session import Session
from handtrack.session.track_session import request_for, track_session
from tests.app.command_line import small_recording
from tests.app.commands import test_track_resumes  # noqa: F401
from tests.app.engine import test_kills  # noqa: F401

with tempfile.TemporaryDirectory() as folder:
    run = TrackingRun.open(Session.open(small_recording(Path(folder) / "small", frames=2)), {})
    list(track_session(run, request_for(run, range(2), from_init=True)))
