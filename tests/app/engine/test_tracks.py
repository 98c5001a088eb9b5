"""What is said of a frame that was fitted."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from handtrack.tracking.frame.reason import Reason
from handtrack.tracking.frame.result import Status
from handtrack_app.engine.job_control import one_frame
from tests.app.fake_run import fake_document

OPEN = Reason("open", part="thumb", number=30.0)


def test_too_little_seen_is_not_called_a_bad_fit(tmp_path: Path) -> None:
    document = fake_document(tmp_path)
    (result,) = document.run.track(range(4, 5), 4, document.model.rest_params())
    note = "the observations do not constrain the thumb: ± 30 mm"
    doubtful = replace(result, status=Status.DOUBTFUL)
    assert one_frame(doubtful, None).title == "Frame 4 does not fit well"
    far = Reason("far off", part="left wrist", number=300.0, other=0.5)
    assert (
        one_frame(replace(doubtful, reason=far), None).title == "Frame 4 fits, with low confidence"
    )
    told = one_frame(replace(doubtful, reason=OPEN), None)
    assert (told.title, told.text) == (
        "Frame 4 fits, with low confidence",
        f"{note[:1].upper()}{note[1:]}.",
    )
