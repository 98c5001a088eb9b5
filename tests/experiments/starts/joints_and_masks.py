"""Benchmark: a hand tracked by a detector's joints alone, by masks alone, and by both, from a recording's images as
`handtrack track SESSION --init auto` does.

Recordings that have both: of the shared test data (HANDTRACK_DATA), the bundled one of somebody else's hand, and those named after
python -m tests.experiments.starts.joints_and_masks. Joints are detected in the images, unless a recording has its own.
"""

from __future__ import annotations

import json
import sys
import tempfile
from pathlib import Path

from handtrack import bundled_session
from handtrack.bench.measuring import data_folder
from tests.experiments.starts.triangulated_landmarks import (
    RECORDING,
    detected_session,
    errors,
    tracked_with,
)

USES: dict[str, dict[str, object]] = {
    "joints": {"silhouettes.weight": 0.0, "cloud.weight": 0.0},
    "masks": {"keypoints.weight": 0.0, "cloud.weight": 0.0},
    "both": {"cloud.weight": 0.0},
}
"""settings"""


def joints_and_masks(*more: str) -> dict[str, object]:
    """Return the errors of each recording's joint centres by what was looked at."""
    sources = (data_folder() / "sessions" / RECORDING, bundled_session(), *map(Path, more))
    figures: dict[str, object] = {}
    for source in sources:
        with tempfile.TemporaryDirectory() as place:
            session, truth = detected_session(source, Path(place) / source.name)
            for use, settings in USES.items():
                figures |= errors(f"{source.name}_{use}", tracked_with(session, settings), truth)
    return figures


if __name__ == "__main__":
    print(json.dumps(joints_and_masks(*sys.argv[1:]), indent=1))
