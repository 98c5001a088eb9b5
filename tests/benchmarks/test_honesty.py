"""What `handtrack bench honesty` measures, and the people it is measured on."""

from dataclasses import replace

import numpy as np
import pytest

from tests.experiments.honesty.honesty import compared, figures_of
from tests.sample_track import sample_frame, stacked


def test_regions_that_are_right_hold_ninety_percent_and_wrong_frames_are_counted(rng):
    first = sample_frame(rng, 0)
    assert first.keypoints21 is not None
    true, frames = first.keypoints21, []
    for n in range(200):
        off = rng.normal(0, 0.002, (21, 3))
        if n >= 180:
            off[4] += 0.05
        points = true + off
        status = 1 if n >= 190 else 0
        frames.append(
            replace(
                first, frame=n, keypoints21=points, joint_positions=points, status=status,
                p_off_25mm=0.05 if n < 180 else 0.9, p_off_10mm=np.full(6, 0.1),
            )
        )  # fmt: skip
    found = figures_of({"one": compared(stacked(frames), np.tile(true, (200, 1, 1)))})
    assert found["coverage90_tracked"] == pytest.approx(0.9, abs=0.02)
    assert found["recall"] == 0.5
    assert found["precision"] == 1.0
    assert found["P 0.8-1.0: bad"] == 1.0
    assert found["P 0.0-0.1: bad"] == 0.0


def test_a_constant_offset_of_definition_is_nobody_s_error(rng):
    first = sample_frame(rng, 0)
    assert first.keypoints21 is not None
    frames = [
        replace(first, frame=n, keypoints21=p, joint_positions=p)
        for n, p in enumerate(first.keypoints21 + rng.normal(0, 1e-4, (9, 21, 3)))
    ]
    other = first.keypoints21 + 0.03
    found = compared(stacked(frames), np.tile(other, (9, 1, 1)))
    assert not found.bad.any()
    assert found.inside.all()
