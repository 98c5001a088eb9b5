"""Refit while tuning: a change of settings or limits moves the hand, one step of undo; the newest wins; what is old is passed over."""

import threading

import numpy as np
import pytest

from handtrack_app.engine import tuning_service
from handtrack_app.protocol import snapshots
from tests.app.waiting import eventually


@pytest.fixture
def bends(monkeypatch):
    """A fit that bends the index finger to a tenth of the silhouettes' weight; return the weights that it was asked for."""
    asked = []

    def fitted(model, settings, seen, params, should_stop):
        asked.append(settings.silhouettes.weight)
        joint = model.joint_params(params)
        joint[model.parameter_names.index("index_pip_flex")] = settings.silhouettes.weight / 10
        return model.clipped(model.transform.solver_params(joint))

    monkeypatch.setattr(tuning_service, "fitted_again", fitted)
    return asked


def _bend(worker):
    return worker.document.shown[worker.document.model.parameter_names.index("index_pip_flex")]


def test_a_change_and_its_fit_are_one_step(worker, listener, bends):
    before = listener.wait(snapshots.PoseSnapshot).values
    worker.engine.refit_while_tuning(True)
    worker.engine.set_setting("silhouettes.weight", 3.0)
    pose = listener.wait(snapshots.PoseSnapshot, lambda p: p.origin == "refitted")
    assert _bend(worker) == pytest.approx(0.3)
    assert not worker.document.keyframes(range(12)), "tracking solves it anew"
    assert worker.document.guides(range(12)).keys() == {3}
    worker.engine.look_before(True)
    looked = listener.wait(snapshots.PoseSnapshot, lambda p: p.origin == snapshots.BEFORE)
    np.testing.assert_allclose(looked.values, before, atol=1e-9)
    worker.engine.undo(pose.version + 1)
    back = listener.pose(pose.version + 1)
    np.testing.assert_allclose(back.values, before, atol=1e-9)
    assert worker.document.run.settings.silhouettes.weight == 1.0


def test_the_newest_change_wins(worker, listener, monkeypatch):
    entered = threading.Event()

    def slow(model, settings, seen, params, should_stop):
        weight = settings.silhouettes.weight
        if weight == 2.0:
            entered.set()
            eventually(should_stop, "a newer change stops it")
            return None
        return params + np.where(np.arange(len(params)) < 1, weight / 100, 0.0)

    monkeypatch.setattr(tuning_service, "fitted_again", slow)
    start = listener.wait(snapshots.PoseSnapshot).values
    worker.engine.refit_while_tuning(True)
    worker.engine.set_setting("silhouettes.weight", 2.0)
    assert entered.wait(60.0)
    worker.engine.set_setting("silhouettes.weight", 3.0)
    pose = listener.wait(snapshots.PoseSnapshot, lambda p: p.origin == "refitted")
    assert pose.values[0] - start[0] == pytest.approx(0.03)


def test_who_poses_meanwhile_keeps_the_pose(worker, listener, monkeypatch):
    entered, goes_on = threading.Event(), threading.Event()

    def slow(model, settings, seen, params, should_stop):
        entered.set()
        assert goes_on.wait(60.0)
        return params + 0.01

    monkeypatch.setattr(tuning_service, "fitted_again", slow)
    worker.engine.refit_while_tuning(True)
    worker.engine.set_setting("silhouettes.weight", 2.0)
    assert entered.wait(60.0)
    worker.engine.take_pose(3, "fist", 5)
    fist = listener.pose(5)
    goes_on.set()
    worker.engine.show_frame(4)
    worker.engine.show_frame(3)
    pose = listener.wait(snapshots.PoseSnapshot, lambda p: p is not fist and p.frame == 3 and p.version == 5)  # fmt: skip
    np.testing.assert_array_equal(pose.values, fist.values)
    assert pose.origin == "set"


def test_an_accepted_frame_is_not_fitted_and_that_is_said(worker, listener, bends):
    worker.engine.take_pose(3, "fist", 1)
    worker.engine.accept(((3, 3),), True)
    worker.engine.refit_while_tuning(True)
    worker.engine.set_setting("silhouettes.weight", 2.0)
    listener.refused()
    assert worker.document.run.settings.silhouettes.weight == 2.0, "the setting holds all the same"
    assert bends == []
