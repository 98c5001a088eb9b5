"""A small recording with clouds: a hand's surface in skin colour before a grey wall, and two cameras with images."""

import json
from pathlib import Path

import cv2
import numpy as np

from handtrack import CameraRig, PointCloud, load_model
from handtrack.arrays import Floats
from handtrack.capture.calibration.rig_file import write_rig
from handtrack.capture.clouds.cloud_files import write_cloud
from handtrack.model.metaballs import MetaballSurface, sample_surface
from tests.cameras import FACING, pinhole

HAND, WALL = 1500, 400
SKIN, GREY = (200, 140, 110), (120, 120, 120)
BOX = (40, 20, 16, 20)
"""x, y, w, h [px] of the skin in the images"""
SETTINGS = """# a comment that stays
[session]
format = 1
fps = 25.0
name = "cloudy"

[hand]
model = "hand26"
forearm = false

[[camera]]
name = "cam0"
images = "cam0/*.png"

[[camera]]
name = "cam1"
images = "cam1/*.png"

[clouds]
files = "clouds/*.npz"
voxel_m = 0.003  # fine
"""


def start() -> Floats:
    """Return solver parameters (P,) of the relaxed hand at the origin, its back to the cameras."""
    return load_model("hand26").rest_params()


def cloudy_session(folder: Path, frames: int = 3, more: str = "") -> Path:
    """Write the recording into a folder and return it. more: settings."""
    rng = np.random.default_rng(7)
    cameras = tuple(
        pinhole(f"cam{i}", (96, 72), 150.0, FACING, (-0.06 * i, 0.09, 0.5)) for i in range(2)
    )
    write_rig(folder / "calibration.toml", CameraRig(cameras))
    (folder / "session.toml").write_text(SETTINGS + more)
    texture = rng.integers(0, 40, (72, 96, 3), dtype=np.uint8)
    texture[BOX[1] : BOX[1] + BOX[3], BOX[0] : BOX[0] + BOX[2]] += np.uint8(SKIN[::-1]) - 20
    for i in range(2):
        (folder / f"cam{i}").mkdir()
        for frame in range(frames):
            cv2.imwrite(str(folder / f"cam{i}" / f"{frame:03d}.png"), np.roll(texture, -18 * i, 1))
    model = load_model("hand26")
    points, _ = sample_surface(MetaballSurface.of(model), model.bones(start()), HAND, rng)
    wall = np.column_stack([rng.uniform(-0.2, 0.2, (WALL, 2)), np.full(WALL, -0.4)])
    colors = np.repeat(np.uint8([SKIN, GREY]), [HAND, WALL], axis=0)
    (folder / "clouds").mkdir()
    for frame in range(frames):
        cloud = PointCloud(np.vstack([points, wall]), colors)
        write_cloud(folder / "clouds" / f"{frame:03d}.npz", cloud)
    values = dict(zip(model.parameter_names, model.joint_params(start()).tolist(), strict=True))
    (folder / "init.json").write_text(json.dumps({"frame": 0, "parameters": values}))
    return folder
