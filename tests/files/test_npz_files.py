"""Arrays in .npz files: what is read, and what is said of files that are no such thing."""

import io
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from handtrack.errors import HandtrackError
from handtrack.files.npz_files import read_arrays


def saved(path: Path) -> bytes:
    np.savez_compressed(path, points=np.random.default_rng(0).random((500, 3)))
    return path.read_bytes()


def damaged(path: Path) -> None:
    content = bytearray(saved(path))
    content[200:260] = bytes(60)
    path.write_bytes(content)


def of_member(path: Path, content: bytes) -> None:
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("points.npy", content)


def announcing(path: Path, shape: tuple[int, ...]) -> None:
    head = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        head, {"descr": "<f8", "fortran_order": False, "shape": shape}
    )
    of_member(path, head.getvalue())


def single_array() -> bytes:
    content = io.BytesIO()
    np.save(content, np.zeros(3))
    return content.getvalue()


NONE: dict[str, tuple[Callable[[Path], object], str]] = {
    "missing": (lambda p: None, "no such file."),
    "a folder": (lambda p: p.mkdir(), "is a folder; expected an .npz file."),
    "empty": (lambda p: p.write_bytes(b""), "not a readable .npz of plain arrays"),
    "text": (lambda p: p.write_text("hello"), "not a readable .npz of plain arrays"),
    "a single array": (
        lambda p: p.write_bytes(single_array()),
        "not a readable .npz of plain arrays",
    ),
    "cut off": (
        lambda p: p.write_bytes(saved(p)[:2000]),
        "Was it cut off while it was written or copied",
    ),
    "damaged": (damaged, "not a readable .npz of plain arrays"),
    "pickles": (
        lambda p: np.savez(p, points=np.array([{}], object)),
        "Object arrays cannot be loaded",
    ),
    "no array in it": (lambda p: of_member(p, b"hello"), "not a readable .npz of plain arrays"),
    "fewer than announced": (lambda p: announcing(p, (9, 3)), "`points` is cut off"),
    "more than any memory": (
        lambda p: announcing(p, (10**14, 3)),
        "`points` would take 2400000 GB of memory",
    ),
}


@pytest.mark.parametrize("case", NONE)
def test_files_that_are_no_plain_arrays(case, tmp_path):
    make, words = NONE[case]
    path = tmp_path / "x.npz"
    make(path)
    with pytest.raises(HandtrackError) as caught:
        read_arrays(path)
    assert str(caught.value).startswith(str(path))
    assert words in str(caught.value)


def packed(path: Path, *members: bytes) -> None:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for number, content in enumerate(members):
            archive.writestr(f"points{number}.npy", content)


def refused_unread(path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """Return what is said of a file of which not more than headers may be unpacked."""
    unpacked: list[int] = []
    real = zipfile.ZipExtFile.read

    def counted(file: zipfile.ZipExtFile, n: int | None = -1) -> bytes:
        data = real(file, n)
        unpacked.append(len(data))
        return data

    monkeypatch.setattr(zipfile.ZipExtFile, "read", counted)
    with pytest.raises(HandtrackError) as caught:
        read_arrays(path)
    assert sum(unpacked) < 1000
    return str(caught.value)


def test_c50_bytes_behind_an_array_are_not_unpacked(tmp_path, monkeypatch):
    path = tmp_path / "x.npz"
    packed(path, single_array() + bytes(10_000_000))
    assert "`points0` holds more bytes than its shape (3,)" in refused_unread(path, monkeypatch)


def test_c50_a_small_file_that_would_fill_the_memory_is_not_unpacked(tmp_path, monkeypatch):
    monkeypatch.setattr("handtrack.files.npz_files._SMALL_BYTES", 1 << 20)
    head = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        head, {"descr": "<f8", "fortran_order": False, "shape": (100_000,)}
    )
    path = tmp_path / "x.npz"
    packed(path, *[head.getvalue() + bytes(800_000)] * 10)
    assert "GB of memory; expected at most 100 times its size" in refused_unread(path, monkeypatch)
