"""Results written and read; versions of what is written over."""

from __future__ import annotations

import os
import time
import zipfile
from dataclasses import MISSING, fields, replace

import numpy as np
import pytest

from handtrack.errors import HandtrackError
from handtrack.files.atomic import replacing
from handtrack.files.versions import keep_version, versions
from handtrack.session.formats.tables import read_npz, write_npz, write_result
from handtrack.store.record import Record
from handtrack.store.step_record import read_result, result_content
from handtrack.tracking.frame.reason import Reason
from handtrack.tracking.frame.result import PARTS, Alternative, FrameResult, Status, TrackResult
from handtrack.tracking.whole.refinement import CameraError, Refinement
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


def test_what_all_frames_share_comes_back(rng, tmp_path):
    camera = CameraError("left", (0.5, 0.0, 0.0), (0.0, 0.0, 1.5), 0.2, 2.0, (0.1,) * 8)
    found = Refinement("converged", 5, (camera,))
    path = tmp_path / "poses.npz"
    write_result(path, replace(sample_track(rng), refinement=found.text))
    text = read_npz(path).refinement
    assert text is not None
    assert Refinement.read(text) == found


def test_a_result_without_keypoints_comes_back(rng, tmp_path):
    track = replace(sample_track(rng), keypoints21=None)
    write_npz(tmp_path / "poses.npz", track)
    assert read_npz(tmp_path / "poses.npz").keypoints21 is None


def test_the_energys_parts_come_back(rng, tmp_path):
    first, second = sample_track(rng).frames()[:2]
    track = stacked(
        [replace(first, energies={"rest": 1.5}), replace(second, energies={"cloud": 2})]
    )
    write_npz(tmp_path / "poses.npz", track)
    back = read_npz(tmp_path / "poses.npz")
    assert back.energy_names == ("rest", "cloud")
    np.testing.assert_array_equal(back.energies, [[1.5, np.nan], [np.nan, 2.0]])
    assert [frame.energies for frame in back.frames()] == [{"rest": 1.5}, {"cloud": 2.0}]
    assert back.between(range(second.frame, second.frame + 1)).energies.shape == (1, 2)


def told_frames(rng):
    """Return a tracked, a doubtful and a lost frame: reasons of three kinds, one or several poses carried along."""
    poses = rng.normal(size=(2, len(PARAMETERS)))
    carried = (
        Alternative(poses[0], 3.0, 0.7, -1, "start"),
        Alternative(poses[1], 4.5, 0.3, 2, "index jumped"),
    )
    doubtful = Reason("part outside", "index distal", "cam1", 0.61)
    poor = Reason("poor cloud", "glove9", number=0.4, other=0.7)
    return [
        sample_frame(rng, 3),
        replace(sample_frame(rng, 4, Status.DOUBTFUL), reason=doubtful, alternatives=carried),
        replace(sample_frame(rng, 5, Status.LOST), reason=poor, alternatives=carried[:1]),
        replace(sample_frame(rng, 6, Status.LOST), reason=Reason("unseen")),
    ]


def test_a_frame_read_back_is_the_frame(rng, tmp_path):
    """All of it: why it is doubtful, and the poses that were carried along."""
    frames = told_frames(rng)
    write_npz(tmp_path / "poses.npz", stacked(frames))
    track = read_npz(tmp_path / "poses.npz")
    assert track.reason.tolist() == [frame.note for frame in frames]
    for frame, back in zip(frames, track.frames(), strict=True):
        assert repr(back.reason) == repr(frame.reason)  # NaN is not equal to itself
        assert (back.note, back.fits, back.poor_cloud) == (frame.note, frame.fits, frame.poor_cloud)
        assert back.is_simplified == (frame.frame == 5)
        for field in fields(FrameResult):
            if field.name not in ("reason", "alternatives"):
                np.testing.assert_array_equal(getattr(back, field.name), getattr(frame, field.name))
        assert len(back.alternatives) == len(frame.alternatives)
        for pose, known in zip(back.alternatives, frame.alternatives, strict=True):
            for field in fields(Alternative):
                np.testing.assert_array_equal(getattr(pose, field.name), getattr(known, field.name))
    part = track.between(range(4, 6))
    assert [frame.note for frame in part.frames()] == [frame.note for frame in frames[1:3]]


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


def test_reasons_are_whole_and_known(rng, tmp_path):
    path = tmp_path / "poses.npz"
    write_npz(path, stacked(told_frames(rng)))
    altered(path, reason_where=None)
    with pytest.raises(HandtrackError, match="arrays are missing: reason_where; expected all of"):
        read_npz(path)
    write_npz(path, stacked(told_frames(rng)))
    altered(path, reason_kind=np.array(["", "a mood", "unseen", ""]))
    with pytest.raises(HandtrackError, match="reason_kind has the unknown value 'a mood'"):
        read_npz(path)
    write_npz(path, stacked(told_frames(rng)))
    names = ("reason", "reason_kind", "reason_where", "reason_numbers")
    altered(path, **dict.fromkeys(names))  # as an earlier version wrote it
    assert all(frame.reason is None for frame in read_npz(path).frames())


def test_the_file_holds_exactly_the_contracts_keys(rng, tmp_path):
    write_npz(tmp_path / "poses.npz", sample_track(rng))
    with np.load(tmp_path / "poses.npz", allow_pickle=False) as data:
        assert set(data.files) == {
            *("format", "frame", "time_s", "parameter_names", "parameters", "bone_names"),
            *("T_world_bone", "joint_names", "joint_positions", "keypoints21", "status", "energy"),
            *("iterations", "parameter_std", "joint_covariance"),
            *("model", "side", "scale", "session", "settings", "version"),
        }
        assert data["format"] == 1
        assert data["parameter_names"].dtype.kind == "U"


def test_the_same_result_gives_the_same_bytes(rng, tmp_path):
    track = sample_track(rng)
    write_npz(tmp_path / "a.npz", track)
    write_npz(tmp_path / "b.npz", track)
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    with zipfile.ZipFile(tmp_path / "a.npz") as archive:
        assert {entry.date_time for entry in archive.infolist()} == {(1980, 1, 1, 0, 0, 0)}


def test_a_failed_write_leaves_the_old_file_and_no_rubbish(tmp_path):
    """Fault C38."""
    path = tmp_path / "poses.npz"
    path.write_text("old")
    with pytest.raises(RuntimeError), replacing(path) as part:
        part.write_text("half")
        raise RuntimeError("power cut")
    assert path.read_text() == "old"
    assert [file.name for file in tmp_path.iterdir()] == ["poses.npz"]


@pytest.mark.skipif(os.name == "nt", reason="modes are those of POSIX")
def test_written_files_have_the_usual_mode(rng, tmp_path):
    write_npz(tmp_path / "poses.npz", sample_track(rng))
    (tmp_path / "plain").touch()
    assert (tmp_path / "poses.npz").stat().st_mode == (tmp_path / "plain").stat().st_mode


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


def test_files_that_are_no_results(tmp_path):
    with pytest.raises(HandtrackError, match="no such file"):
        read_npz(tmp_path / "none.npz")
    with pytest.raises(HandtrackError, match="is a folder; expected a poses.npz"):
        read_npz(tmp_path)
    (tmp_path / "poses.npz").write_bytes(b"PK torn")
    with pytest.raises(HandtrackError, match="not a readable .npz"):
        read_npz(tmp_path / "poses.npz")


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


def test_only_the_latest_twenty_versions_stay(rng, tmp_path):
    path, tracks = tmp_path / "poses.npz", [sample_track(rng) for _ in range(24)]
    for i, track in enumerate(tracks):
        write_result(path, track)
        os.utime(path, (1_700_000_000 + i // 2,) * 2)  # two results in the same second
    kept = versions(path)
    assert len(kept) == 20
    for file, track in zip(kept, tracks[3:23], strict=True):
        assert_same(read_npz(file), track)


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
