"""Looking through a camera on the wire: a page of one's own, the wheel, a walk out of the camera and the way back."""

import time

import numpy as np
import pytest

from handtrack_app.page.scene import looking
from tests.app.waiting import eventually


def test_it_stands_in_the_camera_and_shows_the_hand(bench, page):
    page.press("Camera view: front")
    eventually(lambda: page.view is not None and page.view.follows, "it looks through")
    page.obey()
    np.testing.assert_allclose(page.centre, page.view.card.centre, atol=1e-9)
    assert 1.0 < page.times() <= 12.0
    assert page.told("SetCameraFovMessage") == pytest.approx(page.view.eye.fov)
    page.press("View: the whole image")
    eventually(lambda: page.times() == 1.0, "all of it")


def test_the_wheel_enlarges_and_nothing_is_counted_twice(bench, page):
    page.press("Camera view: front")
    page.obey()
    page.press("View: the whole image")
    eventually(lambda: page.times() == 1.0, "all of it")
    page.obey()
    centre, target, fov = page.centre, page.target, page.told("SetCameraFovMessage")
    for notch in range(1, 5):  # the browser goes on while the answers are under way
        page.tell(target + 0.95**notch * (centre - target), target)
    eventually(lambda: page.times() == pytest.approx(0.95**-12, rel=1e-3), "four notches, no more")
    eventually(
        lambda: (
            np.tan(page.told("SetCameraFovMessage") / 2)
            == pytest.approx(np.tan(fov / 2) * 0.95**12, rel=1e-3)
        ),
        "the field of view follows",
    )
    assert page.view is not None and not page.view.follows and not page.view.left


def test_an_answer_to_what_it_was_told_before_undoes_nothing(bench, monkeypatch, page):
    monkeypatch.setattr(looking, "_SETTLED_S", 1e6)  # however slow the machine
    page.press("Camera view: front")
    page.obey()
    old = page.centre, page.target
    page.press("View: the whole image")
    eventually(lambda: page.times() == 1.0, "all of it")
    page.tell(*old)
    page.obey()
    time.sleep(0.3)
    assert page.times() == 1.0


def test_who_walks_out_is_told_and_one_key_leads_back(bench, monkeypatch, wire, page):
    monkeypatch.setattr(looking, "_SETTLED_S", 0.0)
    page.press("Camera view: front")
    page.obey()
    page.tell(page.centre + 0.05, page.target + 0.05)
    eventually(lambda: page.view is not None and page.view.left, "left")
    eventually(lambda: "You left front" in str(wire.messages), "told")
    page.press("View: the hand, and back into the camera")
    eventually(lambda: page.view is not None and not page.view.left, "back")
    page.obey()
    assert page.view is not None and page.view.follows


def test_a_window_of_another_shape_shows_the_hand_as_well(bench, page):
    page.press("Camera view: front")
    page.obey()
    page.obey(width=300)
    eventually(lambda: page.view is not None and page.view.aspect == 0.5, "the new shape")
    assert page.view.follows
    eventually(
        lambda: page.told("SetCameraFovMessage") == pytest.approx(page.view.eye.fov),  # type: ignore[union-attr]
        "its field of view",
    )
