"""A person's constants of linked abduction."""

from dataclasses import replace

import numpy as np
import pytest

from handtrack import HandtrackError, Status, load_model
from handtrack.tracking.size.spread import spread_of_track
from tests.sample_track import sample_track

OWN = {"index": 1.0, "middle": -0.15, "ring": 0.8, "little": 1.5}


def spreading(rng, count, noise_deg=0.0):
    """Return joint parameters (count, 26) of a person whose fingers spread by OWN."""
    model = load_model(coupling="18", spread=OWN)
    at = model.transform.names.index("spread")
    poses = np.tile(model.rest_params(), (count, 1))
    poses[:, at] = np.deg2rad(rng.uniform(2, 20, count))
    joint = np.stack([model.joint_params(p) for p in poses])
    return joint + np.deg2rad(noise_deg) * rng.normal(size=joint.shape)


def test_only_frames_that_show_it_count(rng):
    track = replace(sample_track(rng, range(6)), parameter_names=load_model().parameter_names)
    poses = spreading(rng, 6)
    std = np.full_like(poses, 0.01)
    std[3, :] = np.inf
    status = np.array([Status.TRACKED] * 5 + [Status.LOST])
    poses[3] = poses[5] = 0.3  # neither may count
    shown = replace(track, parameters=poses, parameter_std=std, status=status)
    found = spread_of_track(shown)
    assert found.frames == 4
    assert found.ratio == pytest.approx(OWN)
    with pytest.raises(HandtrackError, match="in none of the 6 frames"):
        spread_of_track(replace(shown, parameter_std=np.full_like(poses, np.inf)))
