"""A person's constants of linked abduction."""

from dataclasses import replace

import numpy as np
import pytest

from handtrack import Status, load_model
from handtrack.tracking.size.person import spread_of_track
from tests.conftest import refused
from tests.sample_track import sample_track

OWN = {"index": 1.0, "middle": -0.15, "ring": 0.8, "little": 1.5}


def test_only_frames_that_show_it_count(rng):
    model = load_model(coupling="18", spread=OWN)
    abducted = np.tile(model.rest_params(), (6, 1))
    abducted[:, model.transform.names.index("spread")] = np.deg2rad(rng.uniform(2, 20, 6))
    poses = np.stack([model.joint_params(pose) for pose in abducted])
    std = np.full_like(poses, 0.01)
    std[3, :] = np.inf
    status = np.array([Status.TRACKED] * 5 + [Status.LOST])
    poses[3] = poses[5] = 0.3  # neither may count
    shown = replace(sample_track(rng, range(6)), parameters=poses, parameter_std=std, status=status)
    found = spread_of_track(shown)
    assert found["frames"] == 4
    assert found["settings"] == pytest.approx({f"model.spread_{f}": c for f, c in OWN.items()})
    refused(" 6 ", spread_of_track, replace(shown, parameter_std=np.full_like(poses, np.inf)))
