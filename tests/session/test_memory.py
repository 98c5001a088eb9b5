"""An image that does not fit into the memory that is left: which one it is, and what to do."""

import re
from pathlib import Path

import cv2
import numpy as np
import pytest

from handtrack.errors import HandtrackError
from handtrack.geometry.camera import Camera
from handtrack.session.session_file import CameraSettings
from handtrack.session.sources.views import View

SIDE = 5000
STATUS = Path("/proc/self/status")


@pytest.mark.skipif(not STATUS.is_file(), reason="memory is limited on Linux only")
def test_c40_an_image_that_finds_no_memory_is_named_with_its_camera(tmp_path):
    import resource

    cv2.imwrite(str(tmp_path / "007.png"), np.zeros((SIDE, SIDE, 3), np.uint8))
    camera = Camera("left", (SIDE, SIDE), np.eye(3), np.zeros(5), np.eye(3), np.zeros(3))
    view = View(tmp_path, CameraSettings("left", images="*.png"), camera)
    before = resource.getrlimit(resource.RLIMIT_DATA)
    used = re.search(r"VmData:\s*(\d+) kB", STATUS.read_text())
    assert used is not None
    resource.setrlimit(resource.RLIMIT_DATA, (int(used[1]) * 1024 + 20_000_000, before[1]))
    try:
        with pytest.raises(HandtrackError) as told:
            view.image(7)
    finally:
        resource.setrlimit(resource.RLIMIT_DATA, before)
    assert re.match(
        r"Frame 7 of camera 'left' needs more memory than the \d+\.\d GB that handtrack may use here \(Failed to allocate "
        r"75000000 bytes\)\. Close other programs, allow it more \(`handtrack open --memory GB`\), or use",
        str(told.value),
    ), told.value
    assert view.image(7) is not None, "it is no damaged image"
