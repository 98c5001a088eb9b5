"""Benchmark: distance between body34's joints and those of captured motion, sizes fitted.

`handtrack bench body_retarget` prints the figures; needs the shared test data (HANDTRACK_DATA).
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from handtrack.bench.measuring import data_folder
from handtrack.model.articulated import ArticulatedModel, HandScale
from handtrack.model.model_file import load_model
from handtrack.simulation.motion_files.asf_amc import read_asf_amc
from handtrack.simulation.motion_files.bvh import read_bvh
from handtrack.simulation.motion_files.clip import MotionClip
from handtrack.simulation.motion_files.joint_tables import BANDAI_JOINTS, CMU_JOINTS
from handtrack.simulation.retarget import fitted_model, retarget, retarget_errors

_MM = 1e3


def captured_clips(folder: Path) -> dict[str, MotionClip]:
    """Return the shared clips of people that are there, by what they show, with body34's joint names."""
    bandai, cmu = folder / "bandai_body_motion", folder / "cmu_body_mocap"
    clips = {}
    for name, file in (
        ("dance", "dance-short_frames_0300-0899.bvh"),
        ("raise", "raise-up-both-hands_active_022.bvh"),
    ):
        if (bandai / file).is_file():
            clips[name] = read_bvh(bandai / file, "replace").renamed(BANDAI_JOINTS)
    if cmu.is_dir():
        clip = read_asf_amc(cmu / "01.asf", cmu / "01_01_frames_0001-1200.amc")
        clips["walk"] = MotionClip(clip.names, clip.positions[::4], clip.fps / 4).renamed(
            CMU_JOINTS
        )
    return clips


def body_retarget(folder: Path | None = None) -> dict[str, Any]:
    """Return joint errors [mm] of each clip: of an adult's mean body (median), and of the person's own."""
    figures: dict[str, Any] = {}
    for name, clip in captured_clips(folder or data_folder()).items():
        mean = load_model("body34")
        own = fitted_model(_sized, clip.names, clip.positions)
        for label, model in (("mean_body", mean), ("own_body", own)):
            params = retarget(model, clip.names, clip.positions)
            errors = _MM * retarget_errors(model, clip.names, clip.positions, params)
            figures[f"{name}_{label}_median_mm"] = float(np.median(errors))
        figures[f"{name}_own_body_95_percent_mm"] = float(np.percentile(errors, 95))
        figures[f"{name}_frames"] = len(clip.positions)
    return figures


def _sized(scale: HandScale) -> ArticulatedModel:
    return load_model("body34", scale=scale)
