"""A small recording of point clouds for tests to damage: one camera without images, a hand that moves."""

from pathlib import Path

import numpy as np

from handtrack import PointCloud, load_model
from handtrack.capture.clouds.cloud_files import write_cloud
from handtrack.model.pose_library import named_pose
from handtrack.model.surfaces.metaballs import MetaballSurface
from handtrack.model.surfaces.surface_mesh import sample_surface
from handtrack.session.first_pose.first_pose import FirstPose, write_first_pose
from tests.session.small_session import CALIBRATION

FRAMES = 5
STEP_M = 0.003
_SETTINGS = """
[session]
format = 1
name = "clouds"
fps = 10.0

[hand]
scale = 1.0
forearm = false

[[camera]]
name = "cam0"

[clouds]
files = "clouds/*"

[tracking]
tracker.recovery = false
tracker.escape = false
"""


def cloud_recording(folder: Path) -> Path:
    """Write a session of clouds of the model's own hand, 3 mm a frame, and return its folder."""
    rng = np.random.default_rng(5)
    model = load_model()
    (folder / "clouds").mkdir(parents=True)
    (folder / "session.toml").write_text(_SETTINGS)
    (folder / "calibration.toml").write_text(CALIBRATION.split("[cam_1]")[0])
    joint = named_pose(model, "open")
    write_first_pose(
        folder / "init.json", FirstPose(0, dict(zip(model.parameter_names, joint.tolist())))
    )
    for frame in range(FRAMES):
        joint[0] = STEP_M * frame
        bones = model.bones(model.transform.solver_params(joint))
        points, _ = sample_surface(MetaballSurface.of(model), bones, 3000, rng)
        write_cloud(
            cloud_file(folder, frame),
            PointCloud(points + rng.normal(scale=3e-4, size=points.shape)),
        )
    return folder


def cloud_file(folder: Path, frame: int) -> Path:
    return folder / "clouds" / f"{frame:03d}.npz"
