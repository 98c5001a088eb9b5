"""session.toml: written and read back, and nested settings by their dotted names."""

import pytest

from handtrack.capture.masks.segmentation import DepthRange, SkinYCrCb
from handtrack.session.session_file import (
    CameraSettings,
    CloudSettings,
    HandSettings,
    RecordingSettings,
    SessionFile,
    read_session_file,
    write_session_file,
)

FULL = SessionFile(
    RecordingSettings('two "views"', 29.97, "times.csv", 0.043),
    HandSettings("hand26", "left", 1.05, True),
    (
        CameraSettings("cam0", "cam0.mp4", SkinYCrCb(y_min=50), roi=(1, 2, 30, 40)),
        CameraSettings("cam1", "cam1/*.png", "masks/cam1/*.png"),
        CameraSettings("kinect", masks=DepthRange(0.2, 0.9), depth="d/*.png", depth_scale_m=0.001),
        CameraSettings("drawn"),
    ),
    CloudSettings(stereo=(("cam0", "cam1"),), given={"crop_m": 0.1, "max_points": 2000}),
    {"silhouettes": {"weight": 2.0, "term": "coverage"}, "model": {"coupling": "21"}},
)
BARE = SessionFile(RecordingSettings("bare", 30.0), HandSettings(), (CameraSettings("a"),))


@pytest.mark.parametrize("file", [FULL, BARE], ids=["full", "bare"])
def test_what_is_written_reads_back(file, tmp_path):
    write_session_file(tmp_path / "session.toml", file)
    assert read_session_file(tmp_path / "session.toml") == file


def test_defaults(tmp_path):
    folder = tmp_path / "my recording"
    folder.mkdir()
    path = folder / "session.toml"
    path.write_text('[session]\nformat = 1\nfps = 30\n[[camera]]\nname = "a"\n')
    file = read_session_file(path)
    assert file.session == RecordingSettings("my recording", 30.0, None, 1.0)
    assert file.hand == HandSettings("hand26", "right", 1.0, "auto")
    assert file.clouds is None
    assert file.tracking == {}
