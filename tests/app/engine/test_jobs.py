"""Jobs beside the worker: pausing holds their own thread."""

import threading

from handtrack_app.engine import jobs


def test_a_job_that_is_paused_holds_before_its_next_step() -> None:
    job = jobs.BackgroundJob("tracking", lambda job: None, lambda job, event: None)
    assert not job.should_stop()
    job.pause(True)
    asked = threading.Thread(target=job.should_stop, daemon=True)
    asked.start()
    asked.join(0.2)
    assert asked.is_alive()
    job.pause(False)
    asked.join(60.0)
    assert not asked.is_alive()
