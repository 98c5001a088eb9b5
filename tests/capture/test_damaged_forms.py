"""Others' files with some bytes changed: read, or refused in words, and nothing else."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from handtrack.capture.calibration.formats.read_calibration import read_calibration
from handtrack.capture.calibration.formats.settle import named, sized, unit_of
from handtrack.capture.joints.read_joints import read_joints
from handtrack.errors import HandtrackError
from handtrack.geometry.camera import CameraRig
from handtrack.session.formats.given_truth import read_given_truth
from tests.capture.calibration_forms.writers import WRITERS, kalibr, rig_of_two
from tests.capture.joints.writers import LIBRARIES, WITH_CONFIDENCE, WITHOUT, hand
from tests.session.test_truth import WRITERS as TRUTHS

_TIMES = 30
_PIECES = [
    b"nan",
    b"1e400",
    b"-",
    b"[",
    b"{",
    b'"',
    b"\n",
    b":",
    b",",
    b"null",
    b"9" * 20,
    b"\0",
    b"<a>",
    b"- ",
]


def damaged(data: bytes, rng: np.random.Generator) -> bytes:
    """Return bytes with some changed, taken out, put in or repeated, or the end cut off."""
    for _ in range(rng.choice([1, 1, 2, 5])):
        at = int(rng.integers(max(len(data), 1)))
        end = at + int(rng.choice([1, 3, 20, 200]))
        piece = [
            bytes([rng.integers(256)]),
            _PIECES[rng.integers(len(_PIECES))],
            data[at:end] * 2,
            b"",
        ][rng.integers(4)]
        data = (
            data[:at] + piece + data[[at, at + 1, end][rng.integers(3)] :]
            if rng.random() < 0.9
            else data[:at]
        )
    return data


def survives(paths: Sequence[Path], read: Callable[[], object]) -> None:
    rng = np.random.default_rng(7)
    files = [
        file for path in paths for file in ([path] if path.is_file() else sorted(path.rglob("*")))
    ]
    for _ in range(_TIMES):
        file = files[rng.integers(len(files))]
        whole = file.read_bytes()
        file.write_bytes(damaged(whole, rng))
        with suppress(HandtrackError):
            read()
        file.write_bytes(whole)
    read()


def settled(paths: list[Path]) -> CameraRig:
    given = sized(
        named(read_calibration(paths), ["cam0", "cam1"], "it")[0], {"cam0": (640, 480)}, "it"
    )
    return given.rig(unit_of(given).unit_m or 1.0)


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("form", [*WRITERS, "kalibr"])
def test_a_damaged_calibration(form, tmp_path):
    rig = CameraRig(
        tuple(replace(c, distortions=c.distortions * [1, 1, 1, 1, 0]) for c in rig_of_two())
    )
    paths = (WRITERS | {"kalibr": kalibr})[form](tmp_path, rig)
    every = paths if isinstance(paths, list) else [paths]
    survives(every, lambda: settled(every))


@pytest.mark.parametrize("form", [*WITH_CONFIDENCE, *WITHOUT])
def test_damaged_joints(form, tmp_path):
    for library in LIBRARIES.get(form, ()):
        pytest.importorskip(library)
    points = np.where(np.isnan(hand()), 50.0, hand())
    path = (WITH_CONFIDENCE | WITHOUT)[form](tmp_path, points)
    survives([path], lambda: read_joints(str(path), "it").hand("right", "it"))


@pytest.mark.parametrize("form", TRUTHS)
def test_damaged_truth(form, tmp_path):
    path = TRUTHS[form](tmp_path / f"t.{form}")
    survives([path], lambda: read_given_truth(path, "right"))
