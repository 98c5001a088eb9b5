"""The recordings and settings whose results are written down, each bundled and shared session and each mode, and how each is run: as a user
would, by `handtrack track`.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from handtrack.bench.measuring import data_folder
from handtrack.session.bundled import bundled_session
from handtrack.simulation.simulate import Simulation, simulate
from tests.conftest import REPOSITORY


@dataclass(frozen=True)
class Case:
    """One run."""

    recording: Callable[[Path], Path]
    """writes the session into an empty folder, returns it"""
    options: str = ""
    """of the command"""

    def run(self, folder: Path) -> Path:
        """Track; return the file of poses. Raises CalledProcessError with what the command said."""
        session, out = self.recording(folder / "session"), folder / "poses.npz"
        command = [sys.executable, "-m", "handtrack_app.cli", "track", str(session)]
        done = subprocess.run(
            [*command, "--out", str(out), *self.options.split()],
            cwd=REPOSITORY,
            env=os.environ | {"PYTHONPATH": os.pathsep.join((str(REPOSITORY), str(REPOSITORY / "app")))},
            capture_output=True,
            text=True,
            check=False,
        )  # fmt: skip
        if done.returncode:
            raise RuntimeError(f"{' '.join(command)} {self.options}\n{done.stderr}")
        return out


def copied(name: str) -> Callable[[Path], Path]:
    """Return a case's recording: a copy of a bundled one."""
    return lambda folder: Path(shutil.copytree(bundled_session(name), folder))


def shared(name: str) -> Callable[[Path], Path]:
    """Return a case's recording: a copy of one of the shared ones."""
    return lambda folder: Path(shutil.copytree(data_folder() / "sessions" / name, folder))


def poor_depth(folder: Path) -> Path:
    """Write a depth recording of which 40 % is missing in patches and 30 % of the rest 2 to 8 cm off: its cloud is poor."""
    shared("webxr_depth_640")(folder)
    rng = np.random.default_rng(5)
    for path in sorted((folder / "depth" / "cam0").glob("*.png"))[:12]:
        depth = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        height, width = depth.shape
        patches = (
            (rng.random((height // 32 + 1, width // 32 + 1)) < 0.6).repeat(32, 0).repeat(32, 1)
        )
        off = rng.uniform(200, 800, depth.shape) * rng.choice([-1.0, 1.0], depth.shape)
        wrong = np.where(rng.random(depth.shape) < 0.3, depth + off, depth)
        kept = patches[:height, :width] & (depth > 0)
        cv2.imwrite(str(path), np.where(kept, wrong, 0).clip(0, 65535).astype(np.uint16))
    return folder


def simulated_body(folder: Path) -> Path:
    """Write a dancing body seen by two cameras."""
    return simulate(
        folder,
        Simulation(
            cameras=2, frames=5, motion="dance", model="body34", distance_m=3.5, images=False
        ),
    )


CASES: dict[str, Case] = {
    "bundled": Case(copied("open_fist_open")),
    "another_hand": Case(copied("another_hand"), "--frames 0:30"),
    "stereo_768": Case(shared("webxr_stereo_768"), "--use cloud --frames 0:30"),
    "depth_640": Case(shared("webxr_depth_640"), "--use cloud --frames 0:30"),
    "exact_depth_768": Case(shared("webxr_exact_depth_768"), "--frames 0:12"),
    "open_close_3cam": Case(shared("webxr_open_close_3cam"), "--frames 0:30"),
    "fist_6cam": Case(shared("webxr_fist_6cam"), "--frames 0:12"),
    "marked_real_5cam": Case(shared("marked_real_5cam"), "--frames 0:12"),
    "desk_two_view": Case(shared("desk_two_view"), "--frames 18:58"),
    "auto_start": Case(copied("open_fist_open"), "--init auto --frames 0:6"),
    "hypotheses_8": Case(
        shared("d405_real_stereo"), "--use keypoints --set tracker.hypotheses=8 --frames 0:8"
    ),
    "body_hypotheses_4": Case(simulated_body, "--set tracker.hypotheses=4"),
    "fallback_glove9": Case(poor_depth, "--use cloud --set model.fallback=glove9 --frames 0:12"),
    "fallback_auto": Case(poor_depth, "--use cloud --frames 0:12"),
    "edges_intensity": Case(
        copied("open_fist_open"), "--use silhouettes,edges,intensity --frames 0:12"
    ),
    "coupling_18": Case(copied("open_fist_open"), "--set model.coupling=18 --frames 0:30"),
    "size_from_points": Case(copied("another_hand"), "--set model.fit_size=false --frames 0:12"),
}  # fmt: skip
"""`scale = "fit"` is in another hand's own files: by points, then by silhouettes or the cloud"""
