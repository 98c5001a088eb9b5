"""[clouds] in a session.toml's text: what changes is changed, everything else stays as it is written."""

from __future__ import annotations

import tomllib
from dataclasses import replace

import pytest

from handtrack.capture.clouds.skin_ellipse import SkinEllipse
from handtrack.errors import HandtrackError
from handtrack.session.clouds_table import with_clouds
from handtrack.session.session_file import CloudSettings

TEXT = """# mine
[session]
fps = 25.0

[clouds]  # from the desk
stereo = [["cam0", "cam1"]]
crop_m = 0.1   # about a hand's width
voxel_m = 0.004
stereo_method = "sgbm"

[tracking]
cloud.weight = 2.0
"""
STANDS = CloudSettings(stereo=(("cam0", "cam1"),), crop_m=0.1, voxel_m=0.004)


def test_the_same_settings_leave_the_text_alone() -> None:
    assert with_clouds(TEXT, STANDS) == TEXT


def test_only_what_changed_is_written_anew() -> None:
    skin = SkinEllipse((0.4, 0.3), (0.001, 0.0, 0.002), 3.0)
    changed = with_clouds(
        TEXT, replace(STANDS, crop_m=0.05, voxel_m=None, outlier_neighbours=False, skin=skin)
    )
    assert changed == TEXT.replace("crop_m = 0.1 ", "crop_m = 0.05 ").replace(
        "voxel_m = 0.004\n", ""
    ).replace(
        '"sgbm"\n',
        '"sgbm"\nskin = { mean = [0.4, 0.3], covariance = [0.001, 0.0, 0.002], size = 3.0 }\n'
        "outlier_neighbours = false\n",
    )


def test_a_session_without_the_table_gets_one() -> None:
    text = "[session]\nfps = 25.0\n"
    changed = with_clouds(text, CloudSettings(depth=("cam0",), max_points=500))
    assert changed.startswith(text)
    assert tomllib.loads(changed)["clouds"] == {"depth": ["cam0"], "max_points": 500}


@pytest.mark.parametrize(
    "text",
    [
        'clouds = { files = "c/*.ply" }\n',
        '[clouds]\nfiles = "c/*.ply"\n[clouds.skin]\nsize = 2.0\n',
    ],
)
def test_what_is_not_understood_is_refused(text: str) -> None:
    with pytest.raises(HandtrackError, match="Nothing was written"):
        with_clouds(text, CloudSettings(files="d/*.ply"))
