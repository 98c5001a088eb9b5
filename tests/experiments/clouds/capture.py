"""Benchmark: a matched pair's depth of a hand, and photographs from mosaics, against what is true."""

from __future__ import annotations

import cv2
import numpy as np

from handtrack.bench.measuring import data_folder
from handtrack.capture.calibration.rig_file import read_rig
from handtrack.capture.clouds.stereo import StereoMatcher, StereoSettings
from handtrack.capture.images.raw_frames import demosaic
from tests.capture.mosaics import mosaic_of

_FRAMES, _BORDER = range(0, 60, 3), 4
_TRUTH_M = 1e-4
"""what one step of the true depth images is"""


def capture() -> dict[str, float]:
    """Return errors of a hand's depth [mm] by method, its mask given, and peak signals over noise [dB] of a photograph."""
    folder = data_folder() / "sessions" / "webxr_stereo_768"
    rig = read_rig(folder / "calibration.toml")
    files = {
        kind: sorted((folder / kind).glob("*"))
        for kind in ("left", "right", "masks/left", "masks/right", "truth_depth/left")
    }
    figures: dict[str, float] = {}
    for method in ("sgbm", "correlation"):
        matcher, errors = StereoMatcher(rig["left"], rig["right"], StereoSettings(method)), []
        for frame in _FRAMES:
            *taken, truth = (
                cv2.imread(str(paths[frame]), cv2.IMREAD_UNCHANGED) for paths in files.values()
            )
            points = matcher.triangulate(matcher.match(*taken)).points
            columns, rows = rig["left"].project(points).round().astype(int).T
            true = truth[rows, columns] * _TRUTH_M
            errors.append(np.abs(rig["left"].to_camera(points)[:, 2] - true)[true > 0])
        off = 1e3 * np.concatenate(errors)
        figures[f"stereo_{method}_median_mm"] = float(np.median(off))
        figures[f"stereo_{method}_p90_mm"] = float(np.quantile(off, 0.9))
    photograph = cv2.imread(str(data_folder() / "rgb_truth_demosaic" / "astronaut.png"))
    inside = slice(_BORDER, -_BORDER)
    for method in ("library", "level_line_hue"):
        made = demosaic(mosaic_of(photograph, "RGGB"), "RGGB", method).astype(float)
        square = ((made - photograph)[inside, inside] ** 2).mean()
        figures[f"demosaic_{method}_astronaut_db"] = float(10.0 * np.log10(255.0**2 / square))
    return figures
