"""The same rig in the forms that other programs write: the same cameras, to the last byte of what is kept of them."""

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest

from handtrack import CameraRig, HandtrackError
from handtrack.capture.calibration.formats.read_calibration import (
    named,
    pinholes,
    read_calibration,
    sized,
    unit_of,
)
from handtrack.capture.calibration.rig_file import read_rig, write_rig
from tests.cameras import FACING, pinhole
from tests.capture.sample_files import SAMPLES, forms, rig_of_two, sample

SIZES = {"cam0": (640, 480), "cam1": (640, 480)}


def taken_in(paths, folder):
    """Return what `handtrack new` keeps of a calibration: the cameras that a session reads, and their file."""
    given, _ = named(read_calibration(paths), list(SIZES), "it")
    given, said = sized(given, SIZES, "it")
    assert bool(said) == folder.name.endswith("height_before_width")
    unit = unit_of(given)
    leaves_open = any(form in str(folder) for form in ("colmap", "nerf", "splatting"))
    assert unit.sure != leaves_open, unit
    write_rig(folder / "kept.toml", given.rig(1.0 if leaves_open else unit.unit_m))
    return read_rig(folder / "kept.toml"), (folder / "kept.toml").read_bytes()


def largest_difference_px(rig, other):
    points = np.random.default_rng(0).uniform([-0.15, -0.1, 0.3], [0.15, 0.1, 0.7], (1000, 3))
    apart = [np.abs(rig[c].project(points) - other[c].project(points)) for c in rig.names]
    assert np.isfinite(apart).all()
    return float(np.max(apart))


LENSES = {
    "kalibr": lambda c: {"distortions": c.distortions * [1, 1, 1, 1, 0]},
    "splatting": lambda c: {
        "distortions": np.zeros(5),
        "matrix": pinhole("", (640, 480), (600.0, 601.0)).matrix,
    },
}
"""of the forms that have no place for the rig's own"""
OTHERS = ("ros", "fisheye_json", "fisheye_kalibr", "fisheye_colmap")


@pytest.mark.parametrize("form", [f for f in forms("calibration") if not f.endswith(OTHERS)])
def test_every_form_gives_the_same_cameras(form, tmp_path):
    """Also to the last byte of the file, where all of it has a place."""
    name = form.split("/")[1]
    lens = LENSES.get(name, lambda camera: {})
    rig = CameraRig(tuple(replace(camera, **lens(camera)) for camera in rig_of_two()))
    found, kept = taken_in(sample(form, tmp_path / name), tmp_path / name)
    assert found.names == ("cam0", "cam1")
    assert [c.size for c in found] == list(SIZES.values())
    assert largest_difference_px(rig, found) < 1e-9
    _, expected = taken_in(sample("calibration/anipose", tmp_path / "a"), tmp_path / "a")
    assert (kept == expected) == (name not in LENSES)


def test_camera_infos_of_ros_stand_in_their_rectified_frame(tmp_path):
    _, second = rig_of_two()
    given = read_calibration(sample("calibration/ros", tmp_path)).cameras
    between = given[1].rotation @ given[0].rotation.T
    assert np.abs(between - second.rotation).max() < 1e-9
    moved = given[1].translation - between @ given[0].translation
    assert np.abs(moved - second.translation).max() < 1e-9


@pytest.mark.parametrize("form", ["fisheye_json", "fisheye_kalibr", "fisheye_colmap"])
def test_fisheyes_are_seen_through_pinholes(form, tmp_path):
    rig, tables = rig_of_two(), fisheyes()
    given, views = pinholes(read_calibration(sample(f"calibration/{form}", tmp_path)), {})
    points = np.random.default_rng(0).uniform([-0.3, -0.3, 0.3], [0.3, 0.3, 0.7], (2000, 3))
    for camera in given.rig(1.0):
        lens, view = views[camera.name]
        source, table = rig[view.name], tables[view.name]
        taken, _ = cv2.fisheye.projectPoints(
            source.to_camera(points)[:, None], np.zeros(3), np.zeros(3), np.array(table["matrix"]), np.array(table["distortions"])
        )  # fmt: skip
        moved = view.project(lens.rays(taken[:, 0]))
        shown = ((camera.project(points) > 0) & (camera.project(points) < camera.size)).all(axis=1)
        assert shown.sum() > 300
        assert np.abs(moved - camera.project(points))[shown].max() < 1e-6


def fisheyes():
    """Return the tables of two fisheyes at the places of the rig's cameras."""
    return json.loads((SAMPLES / "calibration/fisheye_json/fisheye.json").read_text())


def tables_in(folder):
    """Return the rig as JSON has it: K, dist, R, t, size by camera."""
    (path,) = sample("calibration/json", folder)
    return json.loads(path.read_text())


def written(tables, folder):
    (path := folder / "c.json").write_text(json.dumps(tables))
    return [path]


@pytest.mark.parametrize("words", [
    "camera_matrix dist_coeffs rvec tvec resolution", "mtx D rotation_matrix translation_vector image_size",
    "intrinsics distortion rotation translation imageSize",
])  # fmt: skip
@pytest.mark.parametrize("shape", ["table", "list", "below cameras", "keys with names", "rows"])
def test_usual_names_and_shapes_are_known(words, shape, tmp_path):
    rig, tables = rig_of_two(), tables_in(tmp_path)
    tables = {name: dict(zip(words.split(), t.values())) for name, t in tables.items()}
    forms = {
        "table": tables,
        "list": [{"name": name, **t} for name, t in tables.items()],
        "below cameras": {"cameras": tables, "unit": "m"},
        "keys with names": {
            f"{key}_{name}": v for name, t in tables.items() for key, v in t.items()
        },
        "rows": {
            "names": [*tables][::-1],  # by order alone they would be exchanged
            **{key: [t[key] for t in tables.values()][::-1] for key in words.split()},
        },
    }
    found, _ = taken_in(written(forms[shape], tmp_path), tmp_path)
    assert largest_difference_px(rig, found) < 1e-9


def test_a_pose_of_null_is_none(tmp_path):
    tables = tables_in(tmp_path)
    tables["cam2"] = {**tables["cam1"], "R": "null", "t": "null"}
    tables["cam3"] = {**tables["cam1"], "t": [[0.1, 0.2, 0.5]] * 20}  # of the board, in 20 views
    assert read_calibration(written(tables, tmp_path)).unposed == ("cam2", "cam3")


@pytest.mark.parametrize("change", [
    {"K": [[1.0, 0, 0.5], [0, 1.0, 0.5], [0, 0, 1]]}, {"xi": 1.2},
    {"R": [104.5, 54.4, -32.3]}, {"R": None, "w2c": np.eye(4)[::-1].tolist()},
])  # fmt: skip
def test_what_is_no_pinhole_in_pixels_or_no_pose_is_refused(change, tmp_path):
    tables = tables_in(tmp_path)
    tables = {name: {**t, **change} for name, t in tables.items()}
    with pytest.raises(HandtrackError):
        read_calibration(written(tables, tmp_path))


@pytest.mark.parametrize("change", [
    lambda R, t: (R.T, -R.T @ t), lambda R, t: (FACING @ R, FACING @ t),
])  # fmt: skip
def test_poses_of_another_convention_are_not_taken_unasked(change, tmp_path):
    tables = tables_in(tmp_path)
    for table in tables.values():  # with the world's origin where the hand is
        R = np.array(table["R"])
        table["R"], table["t"] = (part.tolist() for part in change(R, R @ [0, 0, 0.5] + table["t"]))
    assert not unit_of(read_calibration(written(tables, tmp_path))).sure
