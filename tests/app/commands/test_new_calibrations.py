"""`handtrack new` with calibrations of others: taken in as our own, or refused in one sentence before anything is written."""

import json

import numpy as np
import pytest

from handtrack import Session
from tests.app.command_line import refused
from tests.app.commands.test_new import video
from tests.capture.calibration_forms.hostile import HOSTILE
from tests.capture.sample_files import rig_of_two, sample


@pytest.fixture(scope="module")
def videos(tmp_path_factory):
    """Return options for two videos of three frames."""
    folder = tmp_path_factory.mktemp("videos")
    files = {name: video(folder / f"{name}.avi", 25, 3, (640, 480)) for name in ("cam0", "cam1")}
    return [word for name, path in files.items() for word in ("--video", f"{name}={path}")]


@pytest.mark.parametrize("kind", HOSTILE)
def test_a_calibration_that_cannot_be_taken_is_refused_in_a_sentence(
    kind, handtrack, videos, tmp_path
):
    write, expected = HOSTILE[kind]
    folder = tmp_path / "given"
    folder.mkdir()
    path = write(folder)
    (tmp_path / "out").mkdir()
    words = ["new", "--out", tmp_path / "out", *videos, "--calibration", path]
    refused(handtrack, tmp_path / "out", words, expected)


def test_four_coefficients_are_taken_where_their_lens_is_said(handtrack, videos, tmp_path):
    rig = rig_of_two()
    (path,) = sample("calibration/json", tmp_path)
    tables = json.loads(path.read_text())
    for table in tables.values():
        table["dist"] = table["dist"][:4]
    path.write_text(json.dumps(tables))
    words = ["new", *videos, "--calibration", path, "--out"]
    for more in ([], ["--yes"]):
        assert handtrack(*words, tmp_path / "no", *more).code == 2
        assert not (tmp_path / "no").exists()
    handtrack.does(*words, tmp_path / "out", "--lens", "plain")
    kept = Session.open(tmp_path / "out").rig
    for camera in rig:
        assert np.allclose(kept[camera.name].distortions, [*camera.distortions[:4], 0.0])
