"""Calibrations that cannot be taken as they are: made to do harm, cut off, of other lenses, or that leave something open."""

import json
import os
import struct
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from tests.capture.sample_files import rig_of_two, sample

_MAT = b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<H", 0x0100) + b"IM"


def _text(text):
    return _bytes(text.encode())


def _bytes(data, name="c.bin"):
    def write(folder):
        (folder / name).write_bytes(data)
        return folder / name

    return write


def _pipe(folder):
    os.mkfifo(folder / "c.yml")
    return folder / "c.yml"


def _huge(folder):
    with (folder / "c.yml").open("wb") as file:
        file.truncate(1 << 34)
    return folder / "c.yml"


def _pickle(folder):
    np.savez(folder / "c.npz", K=np.array([{"a": 1}], dtype=object))
    return folder / "c.npz"


def _bomb(folder):
    with zipfile.ZipFile(folder / "c.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("K.npy", bytes(260 << 20))
    return folder / "c.npz"


def _element(kind, data):
    return struct.pack("<II", kind, len(data)) + data + bytes(-len(data) % 8)


def _nested_cells(folder):
    head = (
        _element(6, struct.pack("<II", 1, 0))
        + _element(5, struct.pack("<ii", 1, 1))
        + _element(1, b"")
    )
    sizes = [0]
    for _ in range(30_000):
        sizes.append(sizes[-1] + len(head) + 8)
    body = b"".join(struct.pack("<II", 14, size - 8) + head for size in reversed(sizes[1:]))
    return _bytes(_MAT + body)(folder)


def _changed(change):
    def write(folder):
        (path,) = sample("calibration/json", folder)
        tables = json.loads(path.read_text())
        change(tables)
        path.write_text(json.dumps(tables))
        return path

    return write


def _opencv_fisheye(folder):
    """As cv2.fisheye.stereoCalibrate's results are saved; read as k1 k2 p1 p2 the second of these is 400 px off."""
    first, second = rig_of_two()
    lenses = {"D1": [-0.02, 0.011, -0.004, 0.0006], "D2": [-0.21, 1.96, -17.2, 50.9]}
    lenses = {name: np.array(bent).reshape(4, 1) for name, bent in lenses.items()}
    pose = {"R": second.rotation, "T": second.translation.reshape(3, 1)}
    np.savez(folder / "c.npz", K1=first.matrix, K2=second.matrix, **lenses, **pose)
    return folder / "c.npz"


def _far(unit):
    def change(tables):
        for table in tables.values():
            table["t"] = [value * unit for value in table["t"]]

    return change


HOSTILE: dict[str, tuple[Callable[[Path], Path], list[str]]] = {
    "a pipe": (_pipe, ["is a pipe or a device"]),
    "16 GB": (_huge, ["is not read"]),
    "bytes": (_bytes(bytes(range(256)) * 40), ["no calibration that is known here", "Accepted: ", '"K": 3x3']),
    "nothing": (_text(""), ["no calibration that is known here"]),
    "a folder": (lambda folder: folder, ["without a COLMAP model"]),
    "YAML with aliases": (_text("%YAML:1.0\na: &a [1, 2]\nb: [*a, *a]\n"), ["not readable YAML: line 2", "aliases"]),
    "YAML unclosed": (_text("cam0:\n  intrinsics: [1, 2\n" * 3), ["not readable YAML: line 3"]),
    "JSON nested": (_text('{"a":' * 100_000), ["cannot be read as JSON"]),
    "XML with entities": (_text('<?xml version="1.0"?><!DOCTYPE a [<!ENTITY b "c">]><a>&b;</a>'), ["DOCTYPE"]),
    "XML cut off": (_text("<opencv_storage><K1>"), ["not valid XML"]),
    "a pickle": (_pickle, ["not a readable .npz of plain arrays"]),
    "a bomb": (_bomb, ["made to fill the memory"]),
    "cells in cells": (_nested_cells, ["not a readable .mat file", "nested more than"]),
    "a .mat cut off": (_bytes(_MAT + struct.pack("<II", 14, 4000)), ["not a readable .mat file"]),
    "a .mat of HDF5": (_bytes(b"MATLAB 7.3 MAT-file" + bytes(600)), ["mat-io"]),
    "COLMAP cut off": (_bytes(struct.pack("<Q", 2), "cameras.bin"), ["images.bin: no such file"]),
    "COLMAP's unit": (lambda f: sample("calibration/colmap_text", f)[0], ["no unit of length", "--world-unit-m (1 would be usual"]),
    "cv2.fisheye's stereo pair": (_opencv_fisheye, ["fisheye", "--lens"]),
    "coefficients in disorder": (_changed(lambda t: t["cam0"].update(dist=[-0.2, 0.07, 0.3, 0.001, 0])), ["'cam0'", "0.3"]),
    "an unknown lens": (_changed(lambda t: t["cam0"].update(model="double_sphere")), ["'double_sphere' cannot be written"]),
    "a fisheye of five numbers": (_changed(lambda t: t["cam0"].update(fisheye=True)), ["5 coefficients", "k1 k2 k3 k4"]),
    "no distortion": (_changed(lambda t: t["cam0"].pop("dist")), ["camera cam0: no distortion coefficients"]),
    "no pose": (_changed(lambda t: t["cam1"].pop("R")), ["cam1", "no pose"]),
    "NaN": (_changed(lambda t: t["cam1"].update(t=["nan", 0, 0])), ["camera cam1, translation", "finite"]),
    "a mirrored rotation": (_changed(lambda t: t["cam1"].update(R=(-np.eye(3)).tolist())), ["cam1", "no rotation matrix"]),
    "squares of 25 mm": (_changed(_far(1 / 0.025)), ["neither metres nor millimetres", "--world-unit-m"]),
    "centimetres": (_changed(_far(100)), ["neither metres nor millimetres", "cameras are 28.3 apart"]),
}  # fmt: skip
