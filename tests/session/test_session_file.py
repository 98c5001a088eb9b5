"""session.toml: written and read back, and nested settings by their dotted names."""

from __future__ import annotations

from pathlib import Path

import pytest

from handtrack.capture.masks.segmentation import DepthRange, SkinYCrCb
from handtrack.session.session_file import (
    CameraSettings,
    CloudSettings,
    HandSettings,
    RecordingSettings,
    SessionFile,
    dotted,
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
def test_what_is_written_reads_back(file: SessionFile, tmp_path: Path) -> None:
    write_session_file(tmp_path / "session.toml", file)
    assert read_session_file(tmp_path / "session.toml") == file


@pytest.mark.parametrize(
    "clouds",
    [
        CloudSettings(files="c/*.npz"),
        CloudSettings(depth=("kinect",)),
        CloudSettings(
            files="c/*",
            given={"crop_m": False, "outlier_neighbours": False, "near_m": False, "far_m": 2.0},
        ),
        CloudSettings(
            stereo=(("cam0", "cam1"),), given={"stereo_window_px": 9, "stereo_left_right_px": 0.5}
        ),
    ],
)
def test_every_source_of_clouds(clouds: CloudSettings, tmp_path: Path) -> None:
    file = SessionFile(FULL.session, FULL.hand, FULL.cameras, clouds)
    write_session_file(tmp_path / "session.toml", file)
    assert read_session_file(tmp_path / "session.toml").clouds == clouds


def test_defaults(tmp_path: Path) -> None:
    folder = tmp_path / "my recording"
    folder.mkdir()
    path = folder / "session.toml"
    path.write_text('[session]\nformat = 1\nfps = 30\n[[camera]]\nname = "a"\n')
    file = read_session_file(path)
    assert file.session == RecordingSettings("my recording", 30.0, None, 1.0)
    assert file.hand == HandSettings("hand26", "right", 1.0, "auto")
    assert file.clouds is None
    assert file.tracking == {}


def test_tracking_settings_by_dotted_names(tmp_path: Path) -> None:
    path = tmp_path / "session.toml"
    write_session_file(path, BARE)
    text = "\n[tracking]\nsilhouettes.weight = 2.0\n[tracking.solver]\niterations = 9\n"
    path.write_text(path.read_text() + text)
    expected = {"silhouettes.weight": 2.0, "solver.iterations": 9}
    assert dotted(read_session_file(path).tracking) == expected
