"""Opening in two steps: what can be shown at once comes before anything is searched or fitted."""

import threading

import numpy as np

from handtrack.tracking.search import initialize
from handtrack_app.engine import opening
from handtrack_app.process.child import EnginePlan
from handtrack_app.protocol import snapshots
from tests.app.desk import EngineInThreads
from tests.app.fake_run import fake_document
from tests.app.waiting import eventually
from tests.session.small_session import keypoints, make_session


def two_steps(monkeypatch, preview, document):
    monkeypatch.setattr(opening, "opened", lambda folder: folder)
    monkeypatch.setattr(opening, "preview", preview)
    monkeypatch.setattr(opening, "document", document)


def test_pictures_are_shown_before_anything_is_fitted(tmp_path, monkeypatch):
    seen = []
    before = []
    held = threading.Event()

    def opener(folder):
        before.append([type(one) for one in seen])
        assert held.wait(60.0)
        return fake_document(folder)

    two_steps(monkeypatch, fake_document, opener)
    worker = EngineInThreads(EnginePlan(tmp_path), seen.append)
    worker.start()
    assert worker.wait_shown(60.0) is None
    worker.engine.show_frame(5)
    values = fake_document(tmp_path).start
    values[0] += 0.01
    worker.engine.set_pose(5, tuple(values.tolist()), 1)  # it shows at once, and is not lost
    is_shown = lambda one: isinstance(one, snapshots.PoseSnapshot) and one.version == 1  # noqa: E731
    eventually(
        lambda: any(is_shown(one) for one in seen), "the pose shows before the session opens"
    )
    held.set()
    assert worker.wait_opened(60.0) is None
    worker.stop()
    (known,) = before
    assert known.index(snapshots.SessionSnapshot) < known.index(snapshots.PoseSnapshot)
    assert known.index(snapshots.PoseSnapshot) < known.index(snapshots.PictureSnapshot)
    assert snapshots.TimelineSnapshot not in known, "nothing is tracked before the session is open"
    assert worker.document.frame == 5
    np.testing.assert_allclose(worker.document.by_hand[5], values, atol=1e-9)


def test_a_failure_after_the_preview_is_told(tmp_path, monkeypatch):
    seen = []

    def opener(folder):
        raise ValueError("no such thing")

    two_steps(monkeypatch, fake_document, opener)
    worker = EngineInThreads(EnginePlan(tmp_path), seen.append)
    worker.start()
    assert isinstance(worker.wait_opened(60.0), ValueError)
    worker.stop()
    states = [one.state for one in seen if isinstance(one, snapshots.ProgressSnapshot)]
    assert states[-1] == "failed"


def test_the_preview_lays_the_hand_on_the_first_pose_without_a_fit(tmp_path, monkeypatch):
    def fit(*_, **__):
        raise AssertionError("a fit")

    monkeypatch.setattr(initialize, "solve", fit)
    folder = make_session(tmp_path)
    document = opening.preview(opening.opened(folder))
    model = document.model
    shown = model.keypoints21(model.bones(model.transform.solver_params(document.start)))
    assert np.linalg.norm(shown - keypoints(), axis=1).mean() < 0.03
