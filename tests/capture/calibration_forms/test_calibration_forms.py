"""The same rig in the forms that other programs write: the same cameras, to the last byte of what is kept of them."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from handtrack.capture.calibration.formats.read_calibration import read_calibration
from handtrack.capture.calibration.formats.settle import named, pinholes, sized, unit_of
from handtrack.capture.calibration.rig_file import read_rig, write_rig
from handtrack.errors import HandtrackError
from handtrack.geometry.camera import CameraRig
from tests.capture.calibration_forms.writers import (
    WRITERS,
    colmap_text,
    kalibr,
    plain_json,
    rig_of_two,
)

SIZES = {"cam0": (640, 480), "cam1": (640, 480)}


def taken_in(
    paths: Path | list[Path], folder: Path, unit_m: float | None = None
) -> tuple[CameraRig, bytes]:
    """Return what `handtrack new` keeps of a calibration: the cameras that a session reads, and their file."""
    given, _ = named(
        read_calibration(paths if isinstance(paths, list) else [paths]), list(SIZES), "it"
    )
    given = sized(given, SIZES, "it")
    unit = unit_of(given)
    assert unit.sure == (unit_m is None), unit
    write_rig(folder / "kept.toml", given.rig(unit_m or unit.unit_m))
    return read_rig(folder / "kept.toml"), (folder / "kept.toml").read_bytes()


def largest_difference_px(rig: CameraRig, other: CameraRig) -> float:
    points = np.random.default_rng(0).uniform([-0.15, -0.1, 0.3], [0.15, 0.1, 0.7], (1000, 3))
    apart = [np.abs(rig[c].project(points) - other[c].project(points)) for c in rig.names]
    assert np.isfinite(apart).all()
    return float(np.max(apart))


@pytest.mark.parametrize("form", WRITERS)
def test_every_form_gives_the_same_cameras(form, tmp_path):
    rig = rig_of_two()
    _, expected = taken_in(WRITERS["anipose"](tmp_path, rig), tmp_path)
    found, kept = taken_in(
        WRITERS[form](tmp_path, rig), tmp_path, 1.0 if "colmap" in form else None
    )
    assert found.names == ("cam0", "cam1")
    assert [c.size for c in found] == list(SIZES.values())
    assert largest_difference_px(rig, found) < 1e-9
    assert kept == expected


def test_kalibr_gives_the_same_cameras(tmp_path):
    plain = [replace(c, distortions=c.distortions * [1, 1, 1, 1, 0]) for c in rig_of_two()]
    rig = CameraRig(tuple(plain))
    found, kept = taken_in(kalibr(tmp_path, rig), tmp_path)
    assert largest_difference_px(rig, found) < 1e-9
    assert kept == taken_in(WRITERS["anipose"](tmp_path, rig), tmp_path)[1]


def test_matlab_of_2022_gives_the_second_pose_in_columns(tmp_path):
    rig = rig_of_two()
    path = WRITERS["matlab json"](tmp_path, rig)
    table = json.loads(path.read_text())
    del table["RotationOfCamera2"], table["TranslationOfCamera2"]
    _, second = rig
    table["PoseCamera2"] = {
        "R": second.rotation.tolist(),
        "Translation": (1000 * second.translation).tolist(),
    }
    for i in (1, 2):
        lens = table[f"CameraParameters{i}"]
        lens["K"] = np.transpose(lens.pop("IntrinsicMatrix")).tolist()
    path.write_text(json.dumps(table))
    assert largest_difference_px(rig, taken_in(path, tmp_path)[0]) < 1e-9


@pytest.mark.parametrize("turn", [
    {"camera_matrix": "K", "dist_coeffs": "dist", "rvec": "R", "tvec": "t", "resolution": "size"},
    {"mtx": "K", "D": "dist", "rotation_matrix": "R", "translation_vector": "t", "image_size": "size"},
    {"intrinsics": "K", "distortion": "dist", "rotation": "R", "translation": "t", "imageSize": "size"},
])  # fmt: skip
@pytest.mark.parametrize("shape", ["table", "list", "below cameras", "keys with names"])
def test_usual_names_and_shapes_are_known(turn, shape, tmp_path):
    rig = rig_of_two()
    tables = json.loads(plain_json(tmp_path, rig).read_text())
    tables = {name: {key: t[old] for key, old in turn.items()} for name, t in tables.items()}
    forms = {
        "table": tables,
        "list": [{"name": name, **t} for name, t in tables.items()],
        "below cameras": {"cameras": tables, "unit": "m"},
        "keys with names": {
            f"{key}_{name}": v for name, t in tables.items() for key, v in t.items()
        },
    }
    path = tmp_path / "c.json"
    path.write_text(json.dumps(forms[shape]))
    assert largest_difference_px(rig, taken_in(path, tmp_path)[0]) < 1e-9


def test_intrinsics_and_extrinsics_of_opencv_s_sample_are_one_rig(tmp_path):
    import cv2

    rig = rig_of_two()
    first, second = rig
    inner, outer = tmp_path / "intrinsics.yml", tmp_path / "extrinsics.yml"
    file = cv2.FileStorage(str(inner), cv2.FILE_STORAGE_WRITE)
    for i, c in enumerate((first, second), 1):
        file.write(f"M{i}", c.matrix)
        file.write(f"D{i}", c.distortions)
    file.release()
    file = cv2.FileStorage(str(outer), cv2.FILE_STORAGE_WRITE)
    for name, value in {
        "R": second.rotation,
        "T": second.translation,
        "R1": np.eye(3),
        "R2": np.eye(3),
        "Q": np.eye(4),
    }.items():
        file.write(name, value)
    file.release()
    assert largest_difference_px(rig, taken_in([inner, outer], tmp_path)[0]) < 1e-9


def test_cameras_json_of_splatting_is_of_camera_poses(tmp_path):
    rig = CameraRig(tuple(
        replace(c, distortions=np.zeros(5), matrix=np.array([[600.0, 0, 319.5], [0, 601.0, 239.5], [0, 0, 1]])) for c in rig_of_two()
    ))  # fmt: skip
    rows = [
        {"id": i, "img_name": f"{c.name}.png", "width": 640, "height": 480, "position": c.centre.tolist(),
         "rotation": c.rotation.T.tolist(), "fx": c.matrix[0, 0], "fy": c.matrix[1, 1]}
        for i, c in enumerate(rig)
    ]  # fmt: skip
    path = tmp_path / "cameras.json"
    path.write_text(json.dumps(rows))
    assert largest_difference_px(rig, taken_in(path, tmp_path, 1.0)[0]) < 1e-9


def fisheyes(rig: CameraRig) -> dict[str, dict[str, object]]:
    """Return tables of two fisheyes at the places of a rig's cameras."""
    return {
        c.name: {
            "name": c.name, "size": list(c.size), "matrix": [[310.0, 0, 318.5], [0, 311.0, 240.25], [0, 0, 1]], "fisheye": True,
            "distortions": [0.02, -0.011, 0.004, -0.0006], "rotation": c.rotation.tolist(), "translation": c.translation.tolist(),
        }
        for c in rig
    }  # fmt: skip


@pytest.mark.parametrize("form", ["json", "kalibr", "colmap"])
def test_fisheyes_are_seen_through_pinholes(form, tmp_path):
    import cv2

    rig = rig_of_two()
    tables = fisheyes(rig)
    bent = CameraRig(tuple(
        replace(c, matrix=np.array(t["matrix"]), distortions=np.array(t["distortions"]))
        for c, t in zip(rig, tables.values(), strict=True)
    ))  # fmt: skip
    if form == "json":
        path = tmp_path / "fisheye.json"
        path.write_text(json.dumps(tables))
    elif form == "kalibr":
        path = kalibr(tmp_path, bent)
        path.write_text(path.read_text().replace("radtan", "equidistant"))
    else:
        path = colmap_text(tmp_path, rig)
        rows = [
            f"{i} OPENCV_FISHEYE 640 480 310 311 319 240.75 0.02 -0.011 0.004 -0.0006\n"
            for i in (1, 2)
        ]
        numbers = [
            r.split()[0] for r in (path / "cameras.txt").read_text().splitlines() if r[:1] != "#"
        ]
        rows = [row.replace(row.split()[0], n, 1) for row, n in zip(rows, numbers, strict=True)]
        (path / "cameras.txt").write_text("".join(rows))
    given, views = pinholes(read_calibration([path]), {})
    seen = given.rig(1.0)
    points = np.random.default_rng(0).uniform([-0.3, -0.3, 0.3], [0.3, 0.3, 0.7], (2000, 3))
    for camera in seen:
        source, lens = rig[views[camera.name].camera], tables[views[camera.name].camera]
        taken, _ = cv2.fisheye.projectPoints(
            source.to_camera(points)[:, None], np.zeros(3), np.zeros(3), np.array(lens["matrix"]), np.array(lens["distortions"])
        )  # fmt: skip
        moved = views[camera.name].view.pixels(views[camera.name].lens.rays(taken[:, 0]))
        shown = ((camera.project(points) > 0) & (camera.project(points) < camera.size)).all(axis=1)
        assert shown.sum() > 300
        assert np.abs(moved - camera.project(points))[shown].max() < 1e-6


def as_others_write(rig: CameraRig) -> dict[str, object]:
    """Return a rig's cameras as JSON in ways in which public repositories have them."""
    tables = {
        c.name: {"K": c.matrix.tolist(), "dist": c.distortions.tolist(), "R": c.rotation.tolist(), "t": c.translation.tolist()}
        for c in rig
    }  # fmt: skip
    lenses = {name: {key: t[key] for key in ("K", "dist")} for name, t in tables.items()}
    second = rig["cam1"]
    return {
        "lens and pose in tables of their own": {
            name: {
                "intrinsics": {"camera_matrix": t["K"], "distortion_coefficients": t["dist"]},
                "extrinsics": {"R_world_to_cam": t["R"], "t_world_to_cam": t["t"]},
            }
            for name, t in tables.items()
        },
        "a pair under names of its own": {
            **{f"{key}_{name}": v for name, t in lenses.items() for key, v in t.items()},
            "R": second.rotation.tolist(),
            "T": second.translation.tolist(),
        },
        "a pair of tables": {
            **lenses,
            "R": second.rotation.tolist(),
            "T": second.translation.tolist(),
        },
        "a list below another key": {
            "poses": [{"name": name, **table} for name, table in tables.items()],
            "board": {"rows": 7},
        },
        "height before width": {
            name: {**t, "image_size": [480, 640]} for name, t in tables.items()
        },
    }


@pytest.mark.parametrize("form", as_others_write(rig_of_two()))
def test_shapes_of_public_repositories_are_known(form, tmp_path):
    rig = rig_of_two()
    path = tmp_path / "c.json"
    path.write_text(json.dumps(as_others_write(rig)[form]))
    found, _ = taken_in(path, tmp_path)
    assert largest_difference_px(rig, found) < 1e-9
    assert [c.size for c in found] == list(SIZES.values())


def test_lenses_and_poses_in_two_files_by_camera_are_one_rig(tmp_path):
    rig = rig_of_two()
    tables = json.loads(plain_json(tmp_path, rig).read_text())
    paths = [tmp_path / "intrinsics.json", tmp_path / "extrinsics.json"]
    for path, keys in zip(paths, (("K", "dist", "size"), ("R", "t")), strict=True):
        path.write_text(json.dumps({n: {k: t[k] for k in keys} for n, t in tables.items()}))
    assert largest_difference_px(rig, taken_in(paths, tmp_path)[0]) < 1e-9


def test_camera_infos_of_ros_stand_in_their_rectified_frame(tmp_path):
    import cv2

    rig = rig_of_two()
    first, second = rig
    turned_1, turned_2, projected_1, projected_2, *_ = cv2.stereoRectify(
        first.matrix, first.distortions, second.matrix, second.distortions, first.size, second.rotation, second.translation[:, None]
    )  # fmt: skip
    paths = []
    for c, turned, projected in ((first, turned_1, projected_1), (second, turned_2, projected_2)):
        lines = [f"camera_name: {c.name}", "distortion_model: plumb_bob", f"image_width: {c.size[0]}", f"image_height: {c.size[1]}"]  # fmt: skip
        for name, m in (("camera_matrix", c.matrix), ("distortion_coefficients", c.distortions[None]),
                        ("rectification_matrix", turned), ("projection_matrix", projected)):  # fmt: skip
            rows, cols = m.shape
            lines += [f"{name}:", f"  rows: {rows}", f"  cols: {cols}", f"  data: {m.ravel().tolist()}"]  # fmt: skip
        paths.append(tmp_path / f"{c.name}.yaml")
        paths[-1].write_text("\n".join(lines))
    given = named(read_calibration(paths), list(SIZES), "it")[0].cameras
    between = given[1].rotation @ given[0].rotation.T
    assert np.abs(between - second.rotation).max() < 1e-9
    moved = given[1].translation - between @ given[0].translation
    assert np.abs(moved - second.translation).max() < 1e-9


def test_transforms_of_nerf_look_backwards_and_count_from_the_corner(tmp_path):
    rig = rig_of_two()
    frames = []
    for c in rig:
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = c.rotation.T * [1, -1, -1], c.centre
        k = dict(zip(("k1", "k2", "p1", "p2", "k3"), c.distortions.tolist(), strict=True))
        frames.append({
            "file_path": f"./images/{c.name}.png", "transform_matrix": pose.tolist(), "fl_x": c.matrix[0, 0], "fl_y": c.matrix[1, 1],
            "cx": c.matrix[0, 2] + 0.5, "cy": c.matrix[1, 2] + 0.5, **k,
        })  # fmt: skip
    path = tmp_path / "transforms.json"
    path.write_text(json.dumps({"w": 640, "h": 480, "camera_model": "OPENCV", "frames": frames}))
    assert largest_difference_px(rig, taken_in(path, tmp_path, 1.0)[0]) < 1e-9


def test_a_pose_of_null_is_none(tmp_path):
    tables = json.loads(plain_json(tmp_path, rig_of_two()).read_text())
    tables["cam2"] = {**tables["cam1"], "R": "null", "t": "null"}
    path = tmp_path / "c.json"
    path.write_text(json.dumps(tables))
    assert read_calibration([path]).unposed == ("cam2",)


@pytest.mark.parametrize("change", [
    {"K": [[1.0, 0, 0.5], [0, 1.0, 0.5], [0, 0, 1]]}, {"xi": 1.2},
])  # fmt: skip
def test_lenses_that_are_no_pinhole_in_pixels_are_refused(change, tmp_path):
    tables = json.loads(plain_json(tmp_path, rig_of_two()).read_text())
    path = tmp_path / "c.json"
    path.write_text(json.dumps({name: {**t, **change} for name, t in tables.items()}))
    with pytest.raises(HandtrackError):
        read_calibration([path])
