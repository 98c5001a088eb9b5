"""The cloud in the scene, to which frames and display options come on threads of their own."""

import threading
from types import SimpleNamespace

import numpy as np

from handtrack_app.page.page import Display
from handtrack_app.page.scene import camera_view
from handtrack_app.page.scene.camera_view import CloudView, Moments
from handtrack_app.protocol.snapshots import CloudSnapshot


def test_a_colour_that_is_chosen_while_a_frame_comes_stays(monkeypatch):
    """The frame's colours were worked out by the old choice, and are set after the new one was."""
    points = np.zeros((2, 3))
    cloud = CloudSnapshot(0, points, None, np.array([0.0, 9.0]), np.zeros((0, 3)), 2, 2)
    shown = [
        SimpleNamespace(points=points, colors=None, visible=False, point_size=0.0) for _ in "ab"
    ]
    view, display = CloudView(*shown), Display()  # pyright: ignore[reportArgumentType]
    display.cloud_colour = "residual"
    worked_out, go_on, colours = threading.Event(), threading.Event(), camera_view.cloud_colours

    def slow(*given):
        found = colours(*given)
        if given[1] == "residual":
            worked_out.set()
            assert go_on.wait(60.0)
        return found

    monkeypatch.setattr(camera_view, "cloud_colours", slow)
    comes = threading.Thread(target=camera_view.update_cloud, args=(view, cloud, display))
    comes.start()
    assert worked_out.wait(60.0)
    display.cloud_colour = "plain"
    chosen = threading.Thread(target=camera_view.show_cloud, args=(view, display, Moments(), True))
    chosen.start()
    chosen.join(0.2)  # without a lock it ends here, and what comes lies over it
    go_on.set()
    comes.join()
    chosen.join()
    np.testing.assert_array_equal(shown[0].colors, colours(cloud, "plain"))
