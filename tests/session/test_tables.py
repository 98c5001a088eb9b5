"""Results written and read; versions of what is written over."""

import os
import time
import zipfile
from dataclasses import MISSING, fields, replace

import numpy as np
import pytest

from handtrack.errors import HandtrackError
from handtrack.files.versions import keep_version, versions
from handtrack.session.formats.tables import read_npz, write_npz, write_result
from handtrack.store.record import Record
from handtrack.store.step_record import read_result, result_content
from handtrack.tracking.frame.reason import Reason
from handtrack.tracking.frame.result import PARTS, Alternative, FrameResult, Status, TrackResult
from tests.sample_track import PARAMETERS, sample_frame, sample_track, stacked


def assert_same(one: TrackResult, other: TrackResult) -> None:
    for field in fields(TrackResult):
        np.testing.assert_array_equal(getattr(one, field.name), getattr(other, field.name))


def altered(path, **changes):
    """Write poses.npz again with some arrays changed; None leaves one out."""
    with np.load(path) as data:
        arrays = {name: data[name] for name in data.files} | changes
    np.savez(path, **{name: array for name, array in arrays.items() if array is not None})


def test_a_result_comes_back_as_it_was(rng, tmp_path):
    track = sample_track(rng, range(4, 9))
    track.parameter_std[1] = np.inf
    track.energy[1] = np.nan
    track.joint_covariance[2] = np.nan
    write_npz(tmp_path / "poses.npz", track)
    back = read_npz(tmp_path / "poses.npz")
    assert_same(track, back)
    assert isinstance(back.session, str)
    assert np.isnan(back[2].joint_covariance).all()
    assert isinstance(back.joint_names, tuple)


def test_nothing_of_a_frame_is_lost_on_the_way(rng, tmp_path):
    """Each field that may be left out is given, whatever there will be."""
    poses = rng.normal(size=(1, len(PARAMETERS)))
    whole = replace(
        sample_frame(rng, 7, Status.DOUBTFUL),
        energies={"cloud": 1.5},
        reason=Reason("overlap", "", "cam0", 0.5, 0.25),
        p_off_25mm=0.4,
        p_off_10mm=rng.uniform(size=len(PARTS)),
        views=3,
        alternatives=(Alternative(poses[0], 3.0, 1.0, -1, "start"),),
    )
    write_npz(tmp_path / "poses.npz", stacked([sample_frame(rng, 6), whole]))
    record = Record(1, "frame", *result_content(whole))
    for back in (read_npz(tmp_path / "poses.npz").at(7), read_result(record)):
        for field in fields(FrameResult):
            value, read = getattr(whole, field.name), getattr(back, field.name)
            assert field.default is MISSING or repr(value) != repr(field.default), field.name
            if field.name == "alternatives":
                assert list(map(repr, read)) == list(map(repr, value))
            else:
                np.testing.assert_array_equal(read, value)


def test_the_same_result_gives_the_same_bytes(rng, tmp_path):
    track = sample_track(rng)
    write_npz(tmp_path / "a.npz", track)
    write_npz(tmp_path / "b.npz", track)
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    with zipfile.ZipFile(tmp_path / "a.npz") as archive:
        assert {entry.date_time for entry in archive.infolist()} == {(1980, 1, 1, 0, 0, 0)}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"format": np.array(3)}, "format 3; this version of handtrack reads formats 1 and 2"),
        ({"format": None}, "no array `format`, so this is no tracked sequence"),
        ({"energy": None, "status": None}, "arrays are missing: status, energy. Found: "),
        ({"energy": np.zeros(3)}, r"energy has the shape (3,); expected (5,)"),
        ({"T_world_bone": np.zeros((5, 4, 4))}, "expected (5, 2, 4, 4)"),
        ({"status": np.zeros(5)}, "status holds float64; expected whole numbers"),
        ({"status": np.full(5, 9)}, "status has values other than 0 to 3"),
        ({"frame": np.array([0, 1, 1, 2, 3])}, "frame numbers do not ascend"),
        ({"model": np.array(3)}, "model holds int64; expected text"),
        ({"frame": np.array([-1, 1, 2, 3, 4])}, "frame -1; expected numbers from 0"),
        ({"time_s": np.array([0, 1, np.nan, 3, 4])}, "time_s of frame "),
        ({"settings": np.array({"a": 1}, dtype=object)}, "not a readable .npz of plain arrays"),
    ],
)
def test_what_is_wrong_with_a_file_is_said(rng, tmp_path, changes, message):
    path = tmp_path / "poses.npz"
    write_npz(path, sample_track(rng))
    altered(path, **changes)
    with pytest.raises(HandtrackError) as error:
        read_npz(path)
    assert str(error.value).startswith(f"{path}: ")
    assert message in str(error.value)


def test_what_is_written_over_is_kept(rng, tmp_path):
    """Fault C64."""
    path = tmp_path / "poses.npz"
    first, second = sample_track(rng), sample_track(rng)
    assert write_result(path, first) is None
    os.utime(path, (1_700_000_000, 1_700_000_000))
    kept = write_result(path, second)
    assert kept is not None
    assert kept.parent == tmp_path / "versions"
    assert kept.name.startswith("poses_2023111")
    assert_same(read_npz(kept), first)
    assert_same(read_npz(path), second)


@pytest.mark.skipif(not hasattr(time, "tzset"), reason="this system's time zone cannot be changed")
def test_c59_versions_stay_in_order_when_clocks_are_put_back(tmp_path, monkeypatch):
    monkeypatch.setenv("TZ", "Europe/Berlin")
    time.tzset()
    path = tmp_path / "poses.npz"
    before_s = 1_792_889_340  # 2026-10-25, 02:49 there; a quarter of an hour later it is 02:04
    try:
        for number, written_s in enumerate((before_s, before_s + 900)):
            path.write_text(str(number))
            os.utime(path, (written_s, written_s))
            keep_version(path)
    finally:
        monkeypatch.undo()
        time.tzset()
    assert [version.read_text() for version in versions(path)] == ["0", "1"]
