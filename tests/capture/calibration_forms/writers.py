"""One rig in the forms that other programs write: by their own libraries where these are installed, else by their documentation."""

import json
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import scipy.io
import tomlkit

from handtrack.geometry.camera import Camera, CameraRig
from handtrack.geometry.rotation import quaternion_wxyz, rotation_matrix, rotation_vector


def rig_of_two() -> CameraRig:
    """Return two cameras half a metre from a hand, the first at the origin, as a stereo calibration has them."""
    first = Camera(
        "cam0", (640, 480), np.array([[612.25, 0, 318.4375], [0, 611.5, 243.1875], [0, 0, 1]]),
        np.array([-0.21, 0.07, 0.0011, -0.0007, 0.013]), np.eye(3), np.zeros(3),
    )  # fmt: skip
    rotation = rotation_matrix(np.array([0.031, -0.52, 0.047]))
    second = Camera(
        "cam1", (640, 480), np.array([[598.75, 0, 325.5625], [0, 599.25, 236.3125], [0, 0, 1]]),
        np.array([-0.19, 0.05, -0.0004, 0.0009, 0.021]), rotation, np.array([0.271, -0.0123, 0.0817]),
    )  # fmt: skip
    return CameraRig((first, second))


def anipose(folder: Path, rig: CameraRig) -> Path:
    tables = {
        f"cam_{i}": {
            "name": c.name, "size": list(c.size), "matrix": c.matrix.tolist(), "distortions": c.distortions.tolist(),
            "rotation": rotation_vector(c.rotation).tolist(), "translation": c.translation.tolist(),
        }
        for i, c in enumerate(rig)
    }  # fmt: skip
    return _text(folder / "calibration.toml", tomlkit.dumps({**tables, "metadata": {"error": 0.3}}))


def freemocap(folder: Path, rig: CameraRig) -> Path:
    """In millimetres, and with keys of its own."""
    tables = {
        f"cam_{i}": {
            "name": c.name, "size": list(c.size), "matrix": c.matrix.tolist(), "distortions": c.distortions.tolist(),
            "rotation": rotation_vector(c.rotation).tolist(), "translation": (c.translation * 1000).tolist(),
            "world_position": (c.centre * 1000).tolist(), "world_orientation": c.rotation.T.tolist(),
        }
        for i, c in enumerate(rig)
    }  # fmt: skip
    about = {"charuco_square_size": 39, "path_to_recorded_videos": "videos", "adjusted": False}
    return _text(folder / "camera_calibration.toml", tomlkit.dumps({**tables, "metadata": about}))


def caliscope(folder: Path, rig: CameraRig) -> Path:
    tables = {
        str(i): {
            "cam_id": i, "rotation_count": 0, "error": 0.2, "ignore": False, "size": list(c.size),
            "matrix": c.matrix.tolist(), "distortions": c.distortions.tolist(),
            "translation": c.translation.tolist(), "rotation": c.rotation.tolist(),
        }
        for i, c in enumerate(rig)
    }  # fmt: skip
    return _text(folder / "camera_array.toml", tomlkit.dumps({"cameras": tables}))


def opencv_stereo(suffix: str) -> Callable[[Path, CameraRig], Path]:
    """Return what writes the result of stereoCalibrate with OpenCV's FileStorage, as .yml, .xml or .json."""

    def write(folder: Path, rig: CameraRig) -> Path:
        path = folder / f"stereo{suffix}"
        file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
        for i, c in enumerate(rig, 1):
            file.write(f"K{i}", c.matrix)
            file.write(f"D{i}", c.distortions.reshape(1, -1))
        _, second = rig
        for name, value in (
            ("R", second.rotation),
            ("T", second.translation.reshape(3, 1)),
            ("R1", np.eye(3)),
            ("P1", np.eye(3, 4)),
        ):
            file.write(name, value)
        file.write("image_width", rig["cam0"].size[0])
        file.write("image_height", rig["cam0"].size[1])
        file.release()
        return path

    return write


def opencv_files(folder: Path, rig: CameraRig) -> list[Path]:
    """Write a file a camera, under the names of OpenCV's samples and its rotation vectors."""
    paths = []
    for c in rig:
        path = folder / f"{c.name}.yml"
        file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
        file.write("calibration_time", "Tue 01 Feb 2022 10:11:12")
        file.write("image_width", c.size[0])
        file.write("image_height", c.size[1])
        file.write("camera_matrix", c.matrix)
        file.write("distortion_coefficients", c.distortions.reshape(-1, 1))
        file.write("rvec", rotation_vector(c.rotation).reshape(3, 1))
        file.write("tvec", c.translation.reshape(3, 1))
        file.release()
        paths.append(path)
    return paths


def kalibr(folder: Path, rig: CameraRig) -> Path:
    """As its camchain files stand: without k3, so that only a rig without it can be written."""
    lines, before = list[str](), np.eye(4)
    for i, c in enumerate(rig):
        assert not c.distortions[4:].any()
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = c.rotation, c.translation
        lines.append(f"cam{i}:")
        if i:
            lines.append("  T_cn_cnm1:")
            lines += [f"  - {row}" for row in (pose @ np.linalg.inv(before)).tolist()]
        before = pose
        lines += [
            f"  cam_overlaps: [{1 - i}]", "  camera_model: pinhole", f"  distortion_coeffs: {c.distortions[:4].tolist()}",
            "  distortion_model: radtan",
            f"  intrinsics: {[float(c.matrix[a]) for a in ((0, 0), (1, 1), (0, 2), (1, 2))]}",
            f"  resolution: {list(c.size)}", f"  rostopic: /cam{i}/image_raw",
        ]  # fmt: skip
    return _text(folder / "camchain.yaml", "\n".join(lines) + "\n")


def colmap_text(folder: Path, rig: CameraRig) -> Path:
    model = folder / "model"
    model.mkdir()
    cameras, images = (
        ["# Camera list with one line of data per camera:"],
        ["# Image list with two lines of data per image:"],
    )
    for i, (c, lens, pose) in enumerate(_colmap(rig), 1):
        cameras.append(f"{i} FULL_OPENCV {c.size[0]} {c.size[1]} " + " ".join(map(repr, lens)))
        images.append(f"{i} " + " ".join(map(repr, pose)) + f" {i} {c.name}.png")
        images.append("12.5 30.25 -1 100.5 20.25 7")
    _text(model / "cameras.txt", "\n".join(cameras) + "\n")
    _text(model / "images.txt", "\n".join(images) + "\n")
    return model


def colmap_binary(folder: Path, rig: CameraRig) -> Path:
    model = folder / "binary"
    model.mkdir()
    cameras, images = struct.pack("<Q", len(rig.names)), struct.pack("<Q", len(rig.names))
    for i, (c, lens, pose) in enumerate(_colmap(rig), 1):
        cameras += struct.pack("<IiQQ12d", i, 6, *c.size, *lens)
        images += struct.pack("<I7dI", i, *pose, i) + f"{c.name}/000000.png".encode() + b"\0"
        images += struct.pack("<Q", 2) + struct.pack("<ddQ", 1.5, 2.5, 3) * 2
    (model / "cameras.bin").write_bytes(cameras)
    (model / "images.bin").write_bytes(images)
    return model


def _colmap(rig: CameraRig) -> list[tuple[Camera, list[float], list[float]]]:
    rows = []
    for c in rig:
        k1, k2, p1, p2, k3 = c.distortions.tolist()
        fx, fy, cx, cy = (float(c.matrix[a]) for a in ((0, 0), (1, 1), (0, 2), (1, 2)))
        pose = [*quaternion_wxyz(c.rotation).tolist(), *c.translation.tolist()]
        rows.append((c, [fx, fy, cx + 0.5, cy + 0.5, k1, k2, p1, p2, k3, 0.0, 0.0, 0.0], pose))
    return rows


def matlab_struct(rig: CameraRig) -> dict[str, Any]:
    """Return what toStruct gives of stereoParameters, in millimetres."""

    def lens(c: Camera) -> dict[str, Any]:
        matrix = c.matrix.copy()
        matrix[:2, 2] += 1
        return {
            "RadialDistortion": c.distortions[[0, 1, 4]], "TangentialDistortion": c.distortions[2:4],
            "WorldPoints": np.zeros((20, 2)), "WorldUnits": "millimeters", "EstimateSkew": False,
            "NumRadialDistortionCoefficients": 3, "EstimateTangentialDistortion": True, "RotationVectors": np.zeros((4, 3)),
            "IntrinsicMatrix": matrix.T, "ImageSize": np.array(c.size[::-1]), "Version": {"Name": "MATLAB", "Release": "(R2021b)"},
        }  # fmt: skip

    first, second = rig
    return {
        "CameraParameters1": lens(first), "CameraParameters2": lens(second), "RotationOfCamera2": second.rotation.T,
        "TranslationOfCamera2": second.translation * 1000, "Version": {"Name": "MATLAB"}, "RectificationParams": [],
    }  # fmt: skip


def matlab_mat(folder: Path, rig: CameraRig) -> Path:
    scipy.io.savemat(folder / "stereo.mat", {"s": matlab_struct(rig)}, do_compression=True)
    return folder / "stereo.mat"


def matlab_object(folder: Path, rig: CameraRig) -> Path:
    """As MATLAB saves stereoParams itself: an object, here below a session as the calibrator app does."""
    matio = pytest.importorskip("matio")
    from matio.utils.matclass import MatlabOpaque

    table = matlab_struct(rig)
    for i in (1, 2):
        lens = {
            k: np.atleast_2d(v) if isinstance(v, np.ndarray) else v
            for k, v in table[f"CameraParameters{i}"].items()
            if k not in ("Version", "WorldPoints", "RotationVectors")
        }
        table[f"CameraParameters{i}"] = MatlabOpaque(lens, "cameraParameters")
    table["TranslationOfCamera2"] = np.atleast_2d(table["TranslationOfCamera2"])
    del table["Version"], table["RectificationParams"]
    session = {"CameraParameters": MatlabOpaque(table, "stereoParameters")}
    matio.save_to_mat(
        str(folder / "calibrationSession.mat"), {"calibrationSession": session}, version="v7"
    )
    return folder / "calibrationSession.mat"


def bouguet(folder: Path, rig: CameraRig) -> Path:
    """As stereo_gui of Bouguet's toolbox saves it, in metres here."""
    table: dict[str, Any] = {"nx": 640.0, "ny": 480.0}
    for side, c in zip(("left", "right"), rig, strict=True):
        table |= {
            f"fc_{side}": c.matrix[[0, 1], [0, 1]].reshape(2, 1), f"cc_{side}": c.matrix[:2, 2].reshape(2, 1),
            f"alpha_c_{side}": 0.0, f"kc_{side}": c.distortions.reshape(5, 1),
        }  # fmt: skip
    _, second = rig
    table |= {"R": second.rotation, "T": second.translation.reshape(3, 1)}
    scipy.io.savemat(folder / "Calib_Results_stereo.mat", table)
    return folder / "Calib_Results_stereo.mat"


def handpose3d(folder: Path, rig: CameraRig) -> Path:
    """A folder with two files of rows a camera."""
    folder = folder / "camera_parameters"
    folder.mkdir(exist_ok=True)
    for i, c in enumerate(rig):

        def rows(values: Any) -> str:
            return "".join(
                " ".join(map(repr, row)) + " \n" for row in np.atleast_2d(values).tolist()
            )

        _text(
            folder / f"c{i}.dat", f"intrinsic:\n{rows(c.matrix)}distortion:\n{rows(c.distortions)}"
        )
        pose = f"R:\n{rows(c.rotation)}T:\n{rows(c.translation.reshape(3, 1))}"
        _text(folder / f"rot_trans_c{i}.dat", f"#below is a pose\n{pose}")
    return folder


def matlab_json(folder: Path, rig: CameraRig) -> Path:
    return _text(
        folder / "matlab.json", json.dumps(matlab_struct(rig), default=lambda array: array.tolist())
    )


def qualisys(folder: Path, rig: CameraRig) -> Path:
    lines = ['<?xml version="1.0" encoding="UTF-8"?>', "<calibration><results/><cameras>"]
    for c in rig:
        turned = np.diag([1.0, -1.0, -1.0]) @ c.rotation
        x, y, z = (c.centre * 1000).tolist()
        r = " ".join(
            f'r{i + 1}{k + 1}="{turned[i, k]!r}"'.replace("np.float64(", "").replace(")", "")
            for i in range(3)
            for k in range(3)
        )
        u = {
            "focalLengthU": c.matrix[0, 0],
            "focalLengthV": c.matrix[1, 1],
            "centerPointU": c.matrix[0, 2],
            "centerPointV": c.matrix[1, 2],
        }
        k1, k2, p1, p2, k3 = c.distortions.tolist()
        lines += [
            f'<camera active="1" calibrated="true" serial="{c.name}" model="Miqus Video" viewrotation="0">',
            f'<fov_video left="0" top="0" right="{c.size[0] - 1}" bottom="{c.size[1] - 1}"/>',
            f'<transform x="{x!r}" y="{y!r}" z="{z!r}" {r}/>',
            "<intrinsic " + " ".join(f'{key}="{float(64 * value)!r}"' for key, value in u.items()),
            f' radialDistortion1="{k1!r}" radialDistortion2="{k2!r}" radialDistortion3="{k3!r}"',
            f' tangentalDistortion1="{p1!r}" tangentalDistortion2="{p2!r}" skew="0"/></camera>',
        ]  # fmt: skip
    return _text(folder / "rig.qca.txt", "\n".join([*lines, "</cameras></calibration>"]))


def plain_json(folder: Path, rig: CameraRig) -> Path:
    table = {
        c.name: {"K": c.matrix.tolist(), "dist": c.distortions.tolist(), "R": c.rotation.tolist(), "t": c.translation.tolist(),
                 "size": list(c.size)}
        for c in rig
    }  # fmt: skip
    return _text(folder / "cameras.json", json.dumps(table))


def plain_npz(folder: Path, rig: CameraRig) -> Path:
    cameras = list(rig)
    np.savez(
        folder / "cameras.npz", names=np.array(rig.names), K=np.stack([c.matrix for c in cameras]),
        dist=np.stack([c.distortions for c in cameras]), R=np.stack([c.rotation for c in cameras]),
        t=np.stack([c.translation for c in cameras]), size=np.array([c.size for c in cameras]),
    )  # fmt: skip
    return folder / "cameras.npz"


def _text(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8")
    return path


WRITERS: dict[str, Callable[[Path, CameraRig], Path | list[Path]]] = {
    "anipose": anipose, "freemocap": freemocap, "caliscope": caliscope, "opencv yaml": opencv_stereo(".yml"),
    "opencv xml": opencv_stereo(".xml"), "opencv json": opencv_stereo(".json"), "opencv a file a camera": opencv_files,
    "colmap text": colmap_text, "colmap binary": colmap_binary, "matlab mat": matlab_mat, "matlab json": matlab_json,
    "qualisys": qualisys, "json": plain_json, "npz": plain_npz, "bouguet": bouguet, "handpose3d": handpose3d,
    "matlab object": matlab_object,
}  # fmt: skip
