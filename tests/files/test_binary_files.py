"""Files of arrays: only what they say they hold, and no more memory than that."""

import io
import zipfile
from contextlib import suppress

import numpy as np
import pytest
import scipy.io
from numpy.testing import assert_array_equal

from handtrack import HandtrackError
from handtrack.files.mat_files import read_mat
from handtrack.files.npz_files import read_arrays
from tests.conftest import refused


@pytest.mark.parametrize("packed", [False, True])
def test_numbers_texts_structs_and_cells(packed, tmp_path):
    values = {
        "m": np.arange(6.0).reshape(2, 3), "whole": np.array([[1, -2]], dtype=np.int16), "yes": np.array([[True]]),
        "s": {"text": "mm", "inner": {"k": np.eye(2)}}, "cells": np.array([np.ones((1, 2)), "x"], dtype=object),
        "many": np.array([(1.0,), (2.0,)], dtype=[("a", object)]),
    }  # fmt: skip
    scipy.io.savemat(tmp_path / "a.mat", values, do_compression=packed)
    read = read_mat(tmp_path / "a.mat")
    assert_array_equal(read["m"], values["m"])
    assert_array_equal(read["whole"], values["whole"])
    assert read["yes"] == [[1]]
    assert read["s"]["text"] == "mm"
    assert_array_equal(read["s"]["inner"]["k"], np.eye(2))
    assert read["cells"][1] == "x"
    assert [float(part["a"][0, 0]) for part in read["many"]] == [1, 2]


def test_a_file_cut_off_anywhere_is_refused_or_shorter(tmp_path):
    scipy.io.savemat(tmp_path / "a.mat", {"m": np.eye(3), "s": {"t": "mm"}})
    whole = (tmp_path / "a.mat").read_bytes()
    for end in range(0, len(whole) - 1, 7):
        (tmp_path / "b.mat").write_bytes(whole[:end])
        read = dict[str, object]()
        with suppress(HandtrackError):
            read = read_mat(tmp_path / "b.mat")
        assert len(read) < 2


def test_what_unpacks_without_end_is_refused(tmp_path):
    scipy.io.savemat(tmp_path / "a.mat", {"m": np.zeros((5000, 2000))}, do_compression=True)
    assert (tmp_path / "a.mat").stat().st_size < 1e6
    refused("takes more than 67 MB", read_mat, tmp_path / "a.mat")


def saved(path):
    np.savez_compressed(path, points=np.random.default_rng(0).random((500, 3)))
    return path.read_bytes()


def damaged(path):
    content = bytearray(saved(path))
    content[200:260] = bytes(60)
    path.write_bytes(content)


def zipped(path, *members):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for number, content in enumerate(members):
            archive.writestr(f"points{number}.npy", content)


def announced(*shape):
    """Return what stands before the numbers of an array."""
    head, told = io.BytesIO(), {"descr": "<f8", "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(head, told)
    return head.getvalue()


NONE = {
    "missing": (lambda p: None, "no such file."),
    "a folder": (lambda p: p.mkdir(), "is a folder; expected an .npz file."),
    "text": (lambda p: p.write_text("hello"), "not a readable .npz of plain arrays"),
    "cut off": (
        lambda p: p.write_bytes(saved(p)[:2000]),
        "Was it cut off while it was written or copied",
    ),
    "damaged": (damaged, "not a readable .npz of plain arrays"),
    "pickles": (
        lambda p: np.savez(p, points=np.array([{}], object)),
        "Object arrays cannot be loaded",
    ),
    "fewer than announced": (lambda p: zipped(p, announced(9, 3)), "`points0` is cut off"),
    "more than any memory": (
        lambda p: zipped(p, announced(10**14, 3)),
        "`points0` would take 2400000 GB of memory",
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


def refused_unread(path, monkeypatch):
    """Return what is said of a file of which not more than headers may be unpacked."""
    unpacked = []
    real = zipfile.ZipExtFile.read

    def counted(file, n=-1):
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
    zipped(path, announced(3) + bytes(10_000_000))
    assert "`points0`" in refused_unread(path, monkeypatch)


def test_c50_a_small_file_that_would_fill_the_memory_is_not_unpacked(tmp_path, monkeypatch):
    monkeypatch.setattr("handtrack.files.npz_files._SMALL_BYTES", 1 << 20)
    path = tmp_path / "x.npz"
    zipped(path, *[announced(100_000) + bytes(800_000)] * 10)
    assert " GB " in refused_unread(path, monkeypatch)
