"""A camera's error that the whole recording shows is corrected: durable, for every program, until its calibration changes."""

from dataclasses import replace

import pytest
from numpy.testing import assert_allclose, assert_array_equal

from handtrack import Session
from handtrack.session.doctor.examine import examine
from handtrack.session.track_session import keyframe_result
from handtrack.tracking.whole.refinement import CameraError, Refinement
from handtrack_app.engine import edits
from handtrack_app.protocol import TimelineSnapshot
from tests.app.command_line import small_recording
from tests.app.desk import a_desk
from tests.app.opened import opened_recording
from tests.conftest import refused
from tests.session.small_session import edit

LATE, NAME = 2.0, "cam1"


def _refined(store, error):
    """Keep a take of one frame that is refined with a camera off by `error`."""
    document = store.document
    frame, params = document.run.initial()
    result = keyframe_result(document.run, frame, document.model.joint_params(params))
    shared = Refinement("converged", 1, (error,))
    store.begin_take(range(frame, frame + 1), frame, params, is_refined=True, shared=shared)
    store.add(result)
    store.end_take(finished=True)


@pytest.fixture
def folder(tmp_path):
    return small_recording(tmp_path / "session")


def test_a_corrected_camera_stays_corrected_for_whoever_opens_the_session(folder):
    store = opened_recording(folder)
    calibrated = store.document.session.view(NAME)
    error = CameraError(NAME, (0.0, 1.5, 0.0), (4.0, 0.0, 0.0), 0.5, LATE, (0.1,) * 9)
    _refined(store, error)
    store.do("Correction", edits.corrected_cameras(store.document, [NAME]))
    refused(NAME, edits.corrected_cameras, store.document, [NAME])
    store.close()
    for session in (Session.open(folder), opened_recording(folder).document.session):
        view = session.view(NAME)
        expected = error.corrected(calibrated.camera)
        assert_allclose(view.camera.rotation, expected.rotation)
        assert_allclose(view.camera.centre, calibrated.camera.centre + [0.004, 0, 0])
        assert_array_equal(view.mask(1), calibrated.mask(1 + int(LATE)))
        seen = {s.camera.name: s for s in session.observation(1).silhouettes}
        assert_allclose(seen[NAME].camera.rotation, expected.rotation)
        others = [one for one in session.views if one.name != NAME]
        assert all(one.times is None for one in others)
    session = Session.open(folder)
    assert not session.warnings
    (said,) = (
        found.text for found in examine(session) if NAME in found.text and "1.50°" in found.text
    )
    assert "4.0 mm" in said and "2.00 frames late" in said


def test_a_later_estimate_adds_to_a_correction_that_another_calibration_ends(folder):
    store = opened_recording(folder)
    error = CameraError(NAME, (0.0, 1.5, 0.0), (4.0, 0.0, 0.0), 0.0, 0.0, (0.1,) * 9)
    for _ in range(2):
        _refined(store, error)
        store.do("Correction", edits.corrected_cameras(store.document, [NAME]))
    known = store.document.session.corrections[NAME].error
    assert known.turn_deg == pytest.approx((0.0, 3.0, 0.0), abs=1e-3) and known.shift_mm[0] == 8.0
    _refined(store, replace(error, turn_deg=(0.0, 0.1, 0.0), shift_mm=(0.1, 0.0, 0.0)))
    assert not store.document.camera_errors, "too little to be sure"
    store.close()
    edit(folder / "session.toml", f'name = "{NAME}"', f'name = "{NAME}"\nlag_s = 0.25')
    session = Session.open(folder)
    assert session.rig[NAME] is session.calibrated[NAME]
    assert any(NAME in warning for warning in session.warnings)


def test_a_time_offset_is_not_applied_where_a_turned_camera_explains_more(tmp_path, monkeypatch):
    """A camera turned by 1.5° was taken for one that is 1.5 frames early, where its rotation was not estimated."""
    late = CameraError("side", (0.0,) * 3, (0.0,) * 3, 0.0, -1.5, (*[0.0] * 7, 0.1, 0.1))
    looks = "handtrack_app.engine.review_service.inconsistency_of_cameras"
    monkeypatch.setattr(looks, lambda run, results: "camera 'side' is turned")
    for worker, listener in a_desk(tmp_path, step_s=0.0, refined_by=0.1, refined_cameras=(late,)):
        worker.engine.track(0, 12, 3)
        listener.wait(TimelineSnapshot, lambda strip: "side" in strip.cameras_off)
        listener.told("Tracking finished")
        worker.engine.correct_cameras(("side",))
        assert "is turned" in listener.refused().text
        assert not worker.document.state.camera
        monkeypatch.setattr(looks, lambda run, results: "")
        worker.engine.correct_cameras(("side",))
        listener.told("side by time 1.50 frames early")
        assert worker.document.state.camera["side"].error == late
