"""Results written and read, what they say of their model, versions, tracks as takes, and what a take is made from."""

import os
import subprocess
import sys
import time
import zipfile
from dataclasses import MISSING, fields, replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from handtrack import (
    FrameResult,
    HandtrackError,
    Session,
    Status,
    TrackingRun,
    TrackResult,
    read_npz,
    write_npz,
)
from handtrack.capture.calibration.rig_file import rig_from_json
from handtrack.files.atomic import keep_version, versions
from handtrack.session.takes import about_take, import_track
from handtrack.store.log import Record
from handtrack.store.store import Span, Store, WritableStore
from handtrack.store.take import read_result, result_content
from handtrack.tracking.frame.reason import Reason
from handtrack.tracking.frame.result import PARTS, Alternative, model_of
from tests.conftest import REPOSITORY
from tests.export.sequences import KINDS, sample_rig, sample_sequence
from tests.sample_track import HAND, sample_frame, sample_track, stacked
from tests.session.small_session import edit


def assert_same(one, other):
    for field in fields(TrackResult):
        assert_array_equal(getattr(one, field.name), getattr(other, field.name))


def test_a_result_comes_back_as_it_was(rng, tmp_path):
    track = sample_track(rng, range(4, 9))
    track.parameter_std[1] = np.inf
    track.energy[1] = np.nan
    track.joint_covariance[2] = np.nan
    write_npz(tmp_path / "poses.npz", track)
    with zipfile.ZipFile(tmp_path / "poses.npz") as archive:
        times = {entry.date_time for entry in archive.infolist()}
    assert times == {(1980, 1, 1, 0, 0, 0)}, "the same result gives the same bytes at any time"
    back = read_npz(tmp_path / "poses.npz")
    assert_same(track, back)
    assert isinstance(back.session, str)
    assert np.isnan(back[2].joint_covariance).all()
    assert isinstance(back.joint_names, tuple)


def test_nothing_of_a_frame_is_lost_on_the_way(rng, tmp_path):
    """Each field that may be left out is given, whatever there will be."""
    pose = rng.normal(size=len(HAND.rest))
    whole = sample_frame(
        rng,
        7,
        status=Status.DOUBTFUL,
        energies={"cloud": 1.5},
        reason=Reason("overlap", "", "cam0", 0.5, 0.25),
        p_off_25mm=0.4,
        p_off_10mm=rng.uniform(size=len(PARTS)),
        views=3,
        alternatives=(Alternative(pose, 3.0, 1.0, -1, "start"),),
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
                assert_array_equal(read, value)


WITH_A_FIELD_MORE = """
import csv, importlib.util, sys
from dataclasses import replace
from pathlib import Path

import numpy as np

name, folder = "handtrack.tracking.frame.result", Path(sys.argv[1])
found = importlib.util.find_spec(name)
source, end = Path(found.origin).read_text(encoding="utf-8"), "\\n\\n\\n@array_dataclass\\nclass Step:"
assert source.count(end) == 1
added = '''
    grip_n: float = field(default=float("nan"), metadata=column(gaps="missing", unit="N", meaning="force"))
    push: Floats[D3] | None = field(default=None, metadata=column(finite=True, gaps="missing", turned=vector))
'''
sys.modules[name] = module = importlib.util.module_from_spec(found)
exec(compile(source.replace(end, added + end), found.origin, "exec"), module.__dict__)

from handtrack.errors import HandtrackError
from handtrack.export.table import ResultsTable, turn_between, upright
from handtrack.export.tables_and_arrays import write_wide
from handtrack.session.tables import read_npz, write_npz
from handtrack.store.log import Record
from handtrack.store.take import read_result, result_content
from tests.sample_track import hand_track

before = hand_track()
assert before.push is None
pushes = np.random.default_rng(1).normal(size=(4, 3))
known = zip((f for f in before.frames() if f.frame != 3), pushes)
frames = [replace(f, grip_n=float(f.frame), push=push) for f, push in known]
stored = read_result(Record(1, "frame", *result_content(frames[2])))
assert (stored.grip_n, stored.push.tolist()) == (2.0, pushes[2].tolist())
write_npz(folder / "poses.npz", before.labels.track(frames))
track = read_npz(folder / "poses.npz")
assert [f.grip_n for f in track.frames()] == [0, 1, 2, 4]
assert (np.array([f.push for f in track.frames()]) == pushes).all()
assert track.between(range(2, 9)).grip_n.tolist() == [2, 4]
for wrong, said in ((track.push[:, :2], "shape"), (track.push * np.nan, "not finite")):
    write_npz(folder / "wrong.npz", replace(track, push=wrong))
    try:
        read_npz(folder / "wrong.npz")
    except HandtrackError as error:
        assert said in str(error)
    else:
        raise AssertionError(said)
whole = ResultsTable(track).without_gaps.track
assert np.isnan(whole.grip_n).tolist() == np.isnan(whole.push).any(axis=1).tolist() == [False] * 3 + [True, False]
assert (upright(track, "y", "z").push == track.push @ turn_between("y", "z").T).all()
table = folder / "poses.csv"
write_wide(table, ResultsTable(track))
assert [row["grip_n"] for row in csv.DictReader(table.open())] == ["0", "1", "2", "4"]
assert '"grip_n": "force"' in table.with_suffix(".json").read_text()
assert track.to_xarray().grip_n.units == "N"
assert track.to_dataframe().grip_n[4] == 4.0
"""


def test_a_field_declared_once_more_goes_through_everything(tmp_path):
    """Of a frame's result: a number and a vector, each one line in the source and nowhere else."""
    pytest.importorskip("pandas")
    pytest.importorskip("xarray")
    words = [sys.executable, "-c", WITH_A_FIELD_MORE, tmp_path]
    run = subprocess.run(words, cwd=REPOSITORY, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"format": np.array(3)}, "format 3; this version of handtrack reads formats 1 and 2"),
        ({"format": None}, "no array `format`, so this is no tracked sequence"),
        ({"energy": None, "status": None}, "arrays are missing: status, energy. Found: "),
        ({"energy": np.zeros(3)}, r"energy has the shape (3,); expected (5,)"),
        ({"T_world_bone": np.zeros((5, 4, 4))}, "expected (5, 25, 4, 4)"),
        ({"status": np.zeros(5)}, "status holds float64; expected whole numbers"),
        ({"status": np.full(5, 9)}, "status has values other than 0 to 3"),
        ({"frame": np.array([0, 1, 1, 2, 3])}, "frame numbers do not ascend"),
        ({"model": np.array(3)}, "model holds int64; expected text"),
        ({"frame": np.array([-1, 1, 2, 3, 4])}, "frame -1; expected numbers from 0"),
        ({"time_s": np.array([0, 1, np.nan, 3, 4])}, "time_s of frame "),
    ],
)
def test_what_is_wrong_with_a_file_is_said(rng, tmp_path, changes, message):
    path = tmp_path / "poses.npz"
    write_npz(path, sample_track(rng))
    with np.load(path) as data:
        arrays = {**data, **changes}
    np.savez(path, **{name: array for name, array in arrays.items() if array is not None})
    with pytest.raises(HandtrackError) as error:
        read_npz(path)
    assert str(error.value).startswith(f"{path}: ")
    assert message in str(error.value)


@pytest.mark.skipif(not hasattr(time, "tzset"), reason="this system's time zone cannot be changed")
def test_c59_versions_stay_in_order_when_clocks_are_put_back(tmp_path, monkeypatch):
    """That a result is kept before it is written over (C64): tests/app/commands/test_cli.py."""
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


@pytest.mark.parametrize("kind", KINDS)
def test_the_file_alone_tells_where_every_joint_is(kind, tmp_path):
    """A stranger's forward kinematics, from the arrays of the file and SciPy's rotations."""
    _, track = sample_sequence(kind)
    write_npz(tmp_path / "poses.npz", track)
    with np.load(tmp_path / "poses.npz") as file:
        data = dict(file)
    assert (int(data["format"]), str(data["unit"]), float(data["fps"])) == (2, "m", 50.0)
    rest, parents = data["rest_T_bone"], data["parents"]
    for row, values in enumerate(data["parameters"]):
        poses = np.tile(np.eye(4), (len(parents), 1, 1))
        poses[0, :3, :3] = Rotation.from_rotvec(values[3:6]).as_matrix()
        poses[0, :3, 3] = values[:3]
        for bone in range(1, len(parents)):
            local = np.linalg.inv(rest[parents[bone]]) @ rest[bone]
            for hinge in np.flatnonzero(data["hinge_bone"] == bone):
                turn = np.eye(4)
                axis = data["hinge_axis"][hinge] * values[6 + hinge]
                turn[:3, :3] = Rotation.from_rotvec(axis).as_matrix()
                local = local @ turn
            poses[bone] = poses[parents[bone]] @ local
        assert_allclose(poses, data["T_world_bone"][row], atol=1e-9)
        carried = poses[data["joint_bone"]]
        joints = (
            np.einsum("jab,jb->ja", carried[:, :3, :3], data["joint_point"]) + carried[:, :3, 3]
        )
        assert_allclose(joints, data["joint_positions"][row], atol=1e-9)
    low, high = data["parameter_limits"].T
    assert ((data["parameters"] >= low) & (data["parameters"] <= high)).all()


@pytest.mark.parametrize("kind", KINDS)
def test_the_model_is_built_again_from_the_file(kind, tmp_path):
    model, track = sample_sequence(kind)
    write_npz(tmp_path / "poses.npz", replace(track, take=7, pins='{"pins": []}'))
    back = read_npz(tmp_path / "poses.npz")
    assert (back.take, back.pins, back.fps) == (7, '{"pins": []}', 50.0)
    again = model_of(back)
    assert (again.side, again.kind, again.scale) == (model.side, model.kind, model.scale)
    bones = again.bones(again.transform.solver_params(back.parameters[-1]))
    assert_allclose(bones.T_world_bone, back.T_world_bone[-1], atol=1e-12)
    assert_array_equal(again.ellipsoids["fine"].radii, model.ellipsoids["fine"].radii)
    rig = rig_from_json(back.cameras, "cameras")
    assert rig.names == ("front", "side")
    assert_allclose(rig["side"].rotation, sample_rig()["side"].rotation, atol=1e-12)


def test_a12_whatever_track_file_is_put_there_is_kept_as_a_take(rng, tmp_path):
    poses = tmp_path / "tracks/poses.npz"
    poses.parent.mkdir()

    def imported():
        with WritableStore(poses.parent, "a test") as store:
            return import_track(store, tmp_path)

    write_npz(poses, sample_track(rng, range(3, 9)))
    assert imported() == f"{poses} is kept as take 1."
    assert not imported()
    store = Store(poses.parent)
    track = store.track_of(store.current())
    assert_same(track, read_npz(poses))
    write_npz(tmp_path / "again.npz", track)
    assert (tmp_path / "again.npz").read_bytes() == poses.read_bytes()
    write_npz(poses, sample_track(rng))
    assert imported()
    takes = Store(poses.parent).takes()
    assert [take.about.by for take in takes] == ["tracks/poses.npz", "tracks/poses.npz"]
    assert store.current() == (Span(1, 3, 9),), "what is current is the user's choice"


def made_from(folder, frames=range(4), iterations=30):
    values = {"model.fit_size": False, "solver.iterations": iterations}
    run = TrackingRun.open(Session.open(folder), values)
    return dict(about_take(run, "a test", frames, *run.initial()).inputs)


def changed(before, after):
    return {name for name in before.keys() | after.keys() if before.get(name) != after.get(name)}


def test_whatever_may_change_poses_is_another_beginning(folder):
    before = made_from(folder)
    assert changed(before, made_from(folder, range(3))) == {"frames"}
    assert changed(before, made_from(folder, iterations=7)) == {"settings"}
    edit(folder / "session.toml", "fps = 10.0", "fps = 20.0")
    edit(folder / "calibration.toml", "80.0", "81.0")
    assert changed(before, made_from(folder)) == {"session.toml", "calibration.toml"}
    os.utime(folder / "masks/cam0/002.png")
    (folder / "cam0/003.png").unlink()
    now = changed(before, made_from(folder))
    assert now == {"session.toml", "calibration.toml", "masks of cam0", "images of cam0"}
