"""The benchmark of forearms: its recordings are what they say."""

from __future__ import annotations

import numpy as np
import pytest

from tests.experiments.silhouettes.forearms import ARMS, cameras, recording


def areas(arm):
    rng = np.random.default_rng(3)
    seen, truth = recording(cameras("near_pair"), *ARMS[arm], 2, rng)
    assert np.isfinite(truth).all()
    return np.array([[s.mask.sum() for s in frame.silhouettes] for frame in seen])


def test_longer_arms_and_wider_sleeves_cover_more():
    none, short, long, sleeve = (areas(arm) for arm in ("none", "30mm", "long", "sleeve_50mm"))
    assert (none < short).all()
    assert (short < long).all()
    assert (long < sleeve).all()


@pytest.mark.parametrize("rig", ["near_pair", "3_cameras"])
def test_cameras_see_the_whole_hand(rig):
    seen, truth = recording(cameras(rig), *ARMS["none"], 2, np.random.default_rng(3))
    for silhouette in seen[0].silhouettes:
        u, v = np.rint(silhouette.camera.project(truth[0])).astype(int).T
        assert silhouette.mask[v, u].mean() > 0.9
