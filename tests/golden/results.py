"""Small recordings whose results are written down whole: python -m tests.golden.results writes them anew.

They are tracked in a second or two each and compared to the sixth digit, where builds for other processors differ in the ninth. Who changes an algorithm
writes them anew and says what changed.
"""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path

from handtrack import Session
from handtrack.files.toml_edit import edit_toml
from handtrack.session.run import TrackingRun
from handtrack.session.tables import write_npz
from handtrack.session.track_session import track_session
from handtrack.simulation.simulate import Simulation, simulate

RESULTS = Path(__file__).parent / "results"
SCENES = {
    "masks": ({"cameras": 3, "distortion": True, "scale": 1.05}, {}),
    "joints": ({"cameras": 3, "joints_px": 2.0}, {}),
    "cloud": ({"cameras": 2, "clouds": True}, {}),
    "body": ({"cameras": 2, "frames": 3, "motion": "dance", "model": "body34", "distance_m": 3.5}, {"tracker.hypotheses": 4}),
    "paper2003": ({"cameras": 1, "joints_px": 1.0}, {"method": "paper2003"}),
    "paper2004": ({"cameras": 2, "frames": 3, "clouds": True}, {"method": "paper2004"}),
    "paper2007": ({"cameras": 2}, {"method": "paper2007"}),
}  # fmt: skip
"""what is simulated, and the settings with which it is tracked"""


def tracked(scene: str, folder: Path) -> Path:
    """Simulate and track a recording in an empty folder; return the file of poses."""
    made, settings = SCENES[scene]
    how = Simulation(**{"size": (320, 240), "frames": 4, "images": False} | made)
    session = simulate(folder / "session", how)
    for path in session.glob(
        "joints/cam2/000003.json"
    ):  # a camera shows another moment, and the person is found
        shutil.copyfile(path, path.with_name("000001.json"))
        edit_toml(session / "session.toml", {"hand.scale": "fit"}, "a session")
    *_, ended = track_session(TrackingRun.open(Session.open(session), settings))
    write_npz(folder / "poses.npz", ended.track)
    return folder / "poses.npz"


if __name__ == "__main__":
    for scene in SCENES:
        with tempfile.TemporaryDirectory() as place:
            shutil.copyfile(tracked(scene, Path(place)), RESULTS / f"{scene}.npz")
