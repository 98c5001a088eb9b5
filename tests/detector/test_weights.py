"""Weights: none, somebody else's, damaged, made to fill the memory; only known networks are installed; they are fetched."""

import hashlib
import tempfile
import zipfile

import pytest

from handtrack import HandtrackError
from handtrack.detector import weights as module
from handtrack.detector.weights import (
    fetch_weights,
    find_weights,
    has_weights,
    install_weights,
    installed_weights,
    read_weights,
)
from tests.conftest import refused

NETWORK = b"\x1c\0\0\0TFL3" + bytes(40)
NAMES = ("hand_detector.tflite", "hand_landmarks_detector.tflite")


@pytest.fixture(autouse=True)
def own_home(tmp_path, monkeypatch):
    monkeypatch.setenv("HANDTRACK_HOME", str(tmp_path / "home"))
    monkeypatch.delenv("HANDTRACK_DETECTOR", raising=False)


def task(path, names=NAMES, content=NETWORK):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in names:
            archive.writestr(name, content)
    return path


def test_what_is_no_such_file_is_refused(tmp_path):
    cut = task(tmp_path / "cut.task")
    cut.write_bytes(cut.read_bytes()[:-30])
    damaged = task(tmp_path / "damaged.task")
    data = bytearray(damaged.read_bytes())
    data[60:70] = bytes(10)
    damaged.write_bytes(bytes(data))
    other = task(tmp_path / "other.task", content=b"something else")
    for path, expected in (
        (cut, "not a zip file"),
        (damaged, "it cannot be unpacked"),
        (other, "no network in TFLite's form"),
        (task(tmp_path / "half.task", NAMES[:1]), f"there is no {NAMES[1]} in it"),
        (tmp_path, "is a folder"),
    ):
        refused(expected, read_weights, path)
    refused("no such file", read_weights, tmp_path / "nothing.task")


def test_networks_that_would_fill_the_memory_are_not_unpacked(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "_MOST_BYTES", 4000)
    path = task(tmp_path / "bomb.task", content=NETWORK + bytes(100_000))
    assert path.stat().st_size < 4000
    refused("would take", read_weights, path)
    monkeypatch.setattr(module, "_MOST_BYTES", 100)
    refused("has 0 MB", read_weights, path)


def trusted(monkeypatch):
    """The tests' network counts as one that was tested."""
    monkeypatch.setattr(module, "_TESTED", {hashlib.sha256(NETWORK).hexdigest()})


def test_only_known_networks_are_installed(tmp_path, monkeypatch):
    path = task(tmp_path / "a.task")
    with pytest.raises(HandtrackError):
        install_weights(path)
    assert not has_weights()
    trusted(monkeypatch)
    assert install_weights(path) == installed_weights() == find_weights()
    assert has_weights()
    assert read_weights(installed_weights()).is_known


def wheel(folder):
    """A package as pip would download it, with networks where MediaPipe has them."""
    folder.mkdir()
    path = folder / "mediapipe-0.10.21-cp311-cp311-manylinux_2_28_x86_64.whl"
    task(path, (module._PALM[1], module._LANDMARKS[1]))
    about = "mediapipe-0.10.21.dist-info"
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr(
            f"{about}/METADATA", "Metadata-Version: 2.1\nName: mediapipe\nVersion: 0.10.21\n"
        )
        archive.writestr(f"{about}/WHEEL", "Wheel-Version: 1.0\nRoot-Is-Purelib: false\n")
        archive.writestr(f"{about}/RECORD", "")
    return path


def test_networks_are_fetched_by_pip_and_nothing_else_stays(tmp_path, monkeypatch):
    package = wheel(tmp_path / "offered")
    monkeypatch.setenv("PIP_FIND_LINKS", str(package.parent))
    monkeypatch.setenv("TMPDIR", str(tmp_path / "work"))
    monkeypatch.setattr(tempfile, "tempdir", None)
    (tmp_path / "work").mkdir()
    trusted(monkeypatch)
    monkeypatch.setattr(module, "_WHEEL_SHA256", module.digest_of(package))
    assert fetch_weights() == find_weights()
    assert read_weights(find_weights()).landmarks == NETWORK
    assert not any((tmp_path / "work").iterdir())
