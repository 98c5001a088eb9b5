"""MATLAB's files, as SciPy writes them."""

from contextlib import suppress

import numpy as np
import pytest
import scipy.io

from handtrack.errors import HandtrackError
from handtrack.files.mat_files import read_mat


@pytest.mark.parametrize("packed", [False, True])
def test_numbers_texts_structs_and_cells(packed, tmp_path):
    values = {
        "m": np.arange(6.0).reshape(2, 3), "whole": np.array([[1, -2]], dtype=np.int16), "yes": np.array([[True]]),
        "s": {"text": "mm", "inner": {"k": np.eye(2)}}, "cells": np.array([np.ones((1, 2)), "x"], dtype=object),
        "many": np.array([(1.0,), (2.0,)], dtype=[("a", object)]),
    }  # fmt: skip
    scipy.io.savemat(tmp_path / "a.mat", values, do_compression=packed)
    read = read_mat(tmp_path / "a.mat")
    np.testing.assert_array_equal(read["m"], values["m"])
    np.testing.assert_array_equal(read["whole"], values["whole"])
    assert read["yes"] == [[1]]
    assert read["s"]["text"] == "mm"
    np.testing.assert_array_equal(read["s"]["inner"]["k"], np.eye(2))
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
    with pytest.raises(HandtrackError, match="takes more than 67 MB"):
        read_mat(tmp_path / "a.mat")
