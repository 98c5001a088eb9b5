"""Tuning: the method as one change of the session's state; refit while tuning: a change moves the hand, one step of undo; the newest wins."""

import threading
from types import SimpleNamespace

import pytest
from numpy.testing import assert_allclose, assert_array_equal

from handtrack.tracking.frame.methods import METHODS
from handtrack_app import protocol
from handtrack_app.engine import tuning_service
from tests.app.waiting import eventually


def test_experts_choose_method_distance_and_sharpness_on_the_page(bench, wire):
    panel, run = bench.layout.settings, lambda: bench.worker.document.run.settings
    method, distance, sharpness = (
        panel.controls[name].widget
        for name in ("method", "cloud.distance", "cloud.sharpness_per_mm")
    )
    wire.set_value(distance, "d1, by the level")
    wire.set_value(sharpness, 0.5)
    eventually(lambda: run().cloud.sharpness_per_mm == 0.5)
    eventually(lambda: "least radius" in panel.explanations["cloud.distance"].content)
    before = run()
    wire.set_value(method, "2007, conic fields")
    eventually(lambda: run().silhouettes.term == "conic_field")
    eventually(lambda: METHODS["paper2007"].words in panel.explanations["method"].content)
    eventually(lambda: panel.controls["solver.iterations"].widget.value == 10, "what it set shows")
    assert METHODS["paper2007"].values.items() <= run().flat().items()
    assert run().traits == METHODS["paper2007"].traits
    assert run().cloud.distance == "d1"  # no method says it
    wire.trigger("Undo")
    eventually(lambda: run() == before)


@pytest.fixture
def fits(monkeypatch):
    """Fits that bend the index finger to a tenth of the silhouettes' weight; with a weight of 2 they wait until they may go on."""
    fits = SimpleNamespace(asked=[], waits=threading.Event(), goes_on=threading.Event())

    def fitted(model, settings, seen, params, should_stop):
        weight = settings.silhouettes.weight
        fits.asked.append(weight)
        if weight == 2.0:
            fits.waits.set()
            eventually(lambda: fits.goes_on.is_set() or should_stop())
            if should_stop():
                return None
        joint = model.joint_params(params)
        joint[model.parameter_names.index("index_pip_flex")] = weight / 10
        return model.clipped(model.transform.solver_params(joint))

    monkeypatch.setattr(tuning_service, "fitted_again", fitted)
    return fits


def test_a_change_and_its_fit_are_one_step_and_the_newest_change_wins(worker, listener, fits):
    before = listener.wait(protocol.PoseSnapshot).values
    worker.engine.refit_while_tuning(True)
    worker.engine.set_setting("silhouettes.weight", 2.0)
    assert fits.waits.wait(600.0)
    worker.engine.set_setting("silhouettes.weight", 3.0)
    pose = listener.wait(protocol.PoseSnapshot, lambda p: p.origin == "refitted")
    bend = worker.document.model.parameter_names.index("index_pip_flex")
    assert worker.document.shown[bend] == pytest.approx(0.3)
    assert worker.document.by_hand.keys() == {3}
    assert worker.document.decided_pose(3).is_led, "tracking solves it anew"
    worker.engine.look_before(True)
    looked = listener.wait(protocol.PoseSnapshot, lambda p: p.origin == protocol.BEFORE)
    assert_allclose(looked.values, before, atol=1e-9)
    worker.engine.undo(pose.version + 1)
    back = listener.pose(pose.version + 1)
    assert_allclose(back.values, before, atol=1e-9)
    assert worker.document.run.settings.silhouettes.weight == 1.0


def test_who_poses_meanwhile_keeps_the_pose(worker, listener, fits):
    worker.engine.refit_while_tuning(True)
    worker.engine.set_setting("silhouettes.weight", 2.0)
    assert fits.waits.wait(600.0)
    worker.engine.take_pose(3, "fist", 5)
    fist = listener.pose(5)
    fits.goes_on.set()
    worker.engine.show_frame(4)
    worker.engine.show_frame(3)
    pose = listener.wait(protocol.PoseSnapshot, lambda p: p is not fist and p.frame == 3 and p.version == 5)  # fmt: skip
    assert_array_equal(pose.values, fist.values)
    assert pose.origin == "set"


def test_an_accepted_frame_is_not_fitted_and_that_is_said(worker, listener, fits):
    worker.engine.take_pose(3, "fist", 1)
    worker.engine.accept(((3, 3),), True)
    worker.engine.refit_while_tuning(True)
    worker.engine.set_setting("silhouettes.weight", 2.0)
    listener.refused()
    assert worker.document.run.settings.silhouettes.weight == 2.0, "the setting holds all the same"
    assert fits.asked == []


def test_a_setting_without_effect_is_told_by_its_label_until_it_is_put_back(worker, listener):
    for sigma, level, words in ((3.0, "warning", "“Point error mm” has"), (2.0, "done", "effect")):
        worker.engine.set_setting("cloud.sigma_mm", sigma)
        told = listener.wait(protocol.Notice, lambda n, level=level: n.level == level)
        assert told.title == "About the settings" and words in told.text
