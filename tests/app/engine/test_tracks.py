"""A frame as the journal of an earlier version kept it, and what is said of one that was fitted."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path

import pytest

from handtrack.tracking.frame.reason import Reason
from handtrack.tracking.frame.result import Status
from handtrack_app.engine.job_words import one_frame
from handtrack_app.engine.store.tracks import result_of_row
from tests.app.fake_run import fake_document

OPEN = Reason("open", part="thumb", number=30.0)


@pytest.mark.parametrize("reason", [None, OPEN, Reason("overlap", camera="cam0", number=0.5)])
def test_a_frame_comes_back_as_doubtful_as_it_was(tmp_path: Path, reason: Reason | None) -> None:
    """What is in doubt only because too little was seen still fits, and is not looked for elsewhere."""
    document = fake_document(tmp_path)
    (result,) = document.run.track(range(4, 5), 4, document.model.rest_params())
    kept = replace(result, status=Status.DOUBTFUL, reason=reason)
    row = {
        "frame": 4, "status": 1, "energy": 4.0, "iterations": 5, "parameters": kept.parameters.tolist(),
        "std": kept.parameter_std.tolist(), "spread": kept.joint_covariance.tolist(), "energies": {},
        "reason": None if reason is None else asdict(reason),
    }  # fmt: skip
    back = result_of_row(row, document)
    assert (back.status, back.fits, back.note) == (Status.DOUBTFUL, reason is OPEN, kept.note)
    old = {k: v for k, v in row.items() if k != "reason"}  # of a still earlier version
    assert not result_of_row(old, document).fits
    assert result_of_row(old | {"unknown": True}, document).fits
    with pytest.raises(ValueError, match="unknown kind"):
        result_of_row(old | {"reason": {"kind": "a mood"}}, document)


def test_too_little_seen_is_not_called_a_bad_fit(tmp_path: Path) -> None:
    document = fake_document(tmp_path)
    (result,) = document.run.track(range(4, 5), 4, document.model.rest_params())
    note = "what was seen leaves the thumb open: ± 30 mm"
    doubtful = replace(result, status=Status.DOUBTFUL)
    assert one_frame(doubtful, None).title == "Frame 4 does not fit well"
    far = Reason("far off", part="left wrist", number=300.0, other=0.5)
    assert (
        one_frame(replace(doubtful, reason=far), None).title == "Frame 4 fits, as far as it is seen"
    )
    told = one_frame(replace(doubtful, reason=OPEN), None)
    assert (told.title, told.text) == (
        "Frame 4 fits, as far as it is seen",
        f"In doubt: {note}.",
    )
