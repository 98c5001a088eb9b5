"""What is told of a timeline frame by frame adds up to the whole (fault A18); a smaller picture's camera."""

from dataclasses import replace

import numpy as np
from numpy.testing import assert_allclose, assert_array_equal

from handtrack import Camera
from handtrack.session.session_state import decide
from handtrack.store.current_track import TakeFrames
from handtrack.store.spans import Span
from handtrack_app.engine.document_snapshots import timeline_change, timeline_snapshot
from handtrack_app.engine.pictures.camera_pictures import smaller
from handtrack_app.engine.posing_service import pose as pose_edit
from tests.app.fake_run import fake_document


def test_a18_what_is_told_of_the_timeline_adds_up_to_the_whole(tmp_path):
    document = fake_document(tmp_path)
    take = TakeFrames(document.model.parameter_names)
    document.takes.put(1, take)
    document.apply(decide(spans=(Span(1, 0, len(document.frames)),)))
    strip = timeline_snapshot(document)
    result = document.run._result  # type: ignore[attr-defined]
    document.apply(pose_edit(document, 5, (document.start + 0.01).tolist()))
    for frame in (3, 4, 5, 4):
        take.put(replace(result(frame, document.model.rest_params(), 0), energies={"rest": 2.0}), None)  # fmt: skip
        strip = timeline_change(document).over(strip)
    whole = timeline_snapshot(document)
    for name in ("status", "energy", "error_mm"):
        assert_array_equal(getattr(strip, name), getattr(whole, name))
    assert_array_equal(strip.terms["priors"], whole.terms["priors"])
    other = replace(timeline_change(document), frames=range(99))
    assert other.over(strip) is strip, "of a recording that is counted anew meanwhile"


def test_a_smaller_camera_sees_the_same():
    matrix = np.array([[600.0, 0, 321.5], [0, 610.0, 238.0], [0, 0, 1]])
    camera = Camera("c", (640, 480), matrix, np.zeros(5), np.eye(3), np.array([0.0, 0, 0.5]))
    point = np.array([0.03, -0.02, 0.1])
    half = smaller(camera, 320, 240).project(point)
    assert_allclose(half, (camera.project(point) + 0.5) / 2 - 0.5, atol=1e-9)
