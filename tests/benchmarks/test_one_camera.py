"""The experiments with one camera, small: the camera frames the dancer, points are triangulated, errors are counted."""

import numpy as np
import pytest

from tests.experiments.silhouettes.balancing import tracked
from tests.experiments.silhouettes.four_cameras import residuals_px
from tests.experiments.silhouettes.person_session import CAMERAS, DATA


def test_a_real_person_in_four_cameras(data_dir, tmp_path, monkeypatch):
    """Two frames of the recording: the fit is as near to the detections as triangulated points are (13 px), or nearly."""
    if not (data_dir / DATA).is_dir():
        pytest.skip(f"no {DATA} in the shared test data")
    monkeypatch.setenv("HANDTRACK_DATA", str(data_dir))
    monkeypatch.setattr("tests.experiments.silhouettes.balancing.FRAMES", 2)
    few = {"tracker.hypotheses": 2, "mixture.draws": 2, "mixture.carried": 2}
    found = tracked(tmp_path, CAMERAS, None, **few)
    assert [camera.size[1] for camera in found.run.session.rig] == [1920] * 4
    off = np.concatenate(
        [
            np.linalg.norm(d, axis=1)
            for d in residuals_px(found.run, found.run.model, found.results).values()
        ]
    )
    assert np.median(off) < 25.0
