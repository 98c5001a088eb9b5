"""Recordings to judge a mean hand by: python -m tests.experiments.mean_hand.recordings DATA MAKEHUMAN OUT

DATA: the folder of test data, with the hand meshes and their sessions. MAKEHUMAN: the git folder of a copy of its repository.
"""

from __future__ import annotations

import shutil
import sys
import zlib
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from handtrack.capture.calibration.rig_file import read_rig
from handtrack.geometry.camera import CameraRig
from handtrack.session import layout
from handtrack.simulation.simulate import simulated_rig
from tests.experiments.honesty import motions
from tests.experiments.honesty.meshes import HandMesh, read_meshes
from tests.experiments.honesty.recordings import about, describe, moved, write
from tests.experiments.mean_hand.makehuman import Base, people

FRAMES, SIZE = 36, (320, 240)


def made(folder: Path, mesh: HandMesh, motion: str) -> None:
    """Write a recording of three cameras."""
    rng = np.random.default_rng(zlib.crc32(f"{mesh.name} {motion}".encode()))
    angles = motions.moving(motion, FRAMES + 20, rng)[18:]
    write(folder, moved(mesh, angles, motion, rng), simulated_rig(3, SIZE, 0.55), rng)


def taken(folder: Path, session: Path, cameras: tuple[str, ...], frames: range) -> None:
    """Write some cameras and frames of a recording that exists, at half its size."""
    folder.mkdir(parents=True)
    found = []
    for camera in read_rig(session / layout.CALIBRATION_FILE):
        if camera.name not in cameras:
            continue
        half = np.array([[0.5, 0, -0.25], [0, 0.5, -0.25], [0, 0, 1]])
        size = (camera.size[0] // 2, camera.size[1] // 2)
        found.append(replace(camera, matrix=half @ camera.matrix, size=size))
        to = folder / "masks" / camera.name
        to.mkdir(parents=True)
        files = sorted((session / "masks" / camera.name).glob("*.png"))
        for number, frame in enumerate(frames):
            mask = cv2.imread(str(files[frame]), cv2.IMREAD_GRAYSCALE)
            small = cv2.resize(mask, size, interpolation=cv2.INTER_AREA)
            cv2.imwrite(
                str(to / f"{number:06d}.png"), np.where(small >= 128, 255, 0).astype(np.uint8)
            )
    truth = np.load(session / layout.TRUTH_FILE)["keypoints21"][list(frames)]
    first = about(truth[0], np.random.default_rng(len(frames)))
    describe(folder, CameraRig(tuple(found)), truth, first)


def main() -> None:
    data, makehuman, out = map(Path, sys.argv[1:4])
    shutil.rmtree(out, ignore_errors=True)
    base, who = Base.read(makehuman), people()
    sessions = data / "sessions"
    taken(out / "webxr_fist", sessions / "webxr_fist_6cam", ("cam0", "cam1", "cam2"), range(10, 46))
    taken(
        out / "webxr_open_close",
        sessions / "webxr_open_close_3cam",
        ("cam0", "cam1", "cam2"),
        range(20, 56),
    )
    hands = read_meshes(data)
    for mesh, motion in (
        (hands["webxr"], "letters"),
        (hands["umetrack"], "fist"),
        (hands["umetrack"], "letters"),
    ):
        made(out / f"{mesh.name}_{motion}", mesh, motion)
    for number, motion in ((1, "fist"), (4, "fist"), (3, "letters"), (6, "curls")):
        made(out / f"makehuman{number}_{motion}", base.hand(who[number]), motion)


if __name__ == "__main__":
    main()
