"""MANO exchange, with a stand-in of MANO's form made of our own hand: its licence keeps the real one out of tests."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse
from numpy.testing import assert_allclose, assert_array_equal

from handtrack import HandtrackError
from handtrack.export.mano import ManoModel, fit_mano
from handtrack.export.registry import export_format
from handtrack.export.table import ResultsTable
from handtrack.model.articulated import keypoint_names
from handtrack.session.first_pose import FirstPose, read_first_pose, write_first_pose
from tests.conftest import refused
from tests.export.sequences import sample_model, sample_sequence

FINGERS = ("index", "middle", "little", "ring", "thumb")
TIPS = {"thumb": 744, "index": 320, "middle": 443, "ring": 554, "little": 671}


def stand_in():
    """Return arrays by MANO's names: joints and tips of our mean right hand among vertices anywhere, shapes of length and of nothing."""
    rng = np.random.default_rng(2)
    model = sample_model("right")
    keypoints = dict(zip(keypoint_names(), model.keypoints21(model.bones(model.params_from({}))), strict=True))  # fmt: skip
    names = ["wrist"]
    for finger in FINGERS:
        parts = ("cmc", "mcp", "ip") if finger == "thumb" else ("mcp", "pip", "dip")
        names += [f"{finger}_{part}" for part in parts]
    joints = np.array([keypoints[name] for name in names])
    skin, carried_by = rng.normal(scale=0.05, size=(778, 3)), np.zeros(778, int)
    skin[:16] = joints  # which the regressor takes
    for number, finger in enumerate(FINGERS):
        skin[TIPS[finger]], carried_by[TIPS[finger]] = keypoints[f"{finger}_tip"], 3 * number + 3
    longer = 0.04 * (skin - joints[0])
    parent = [0 if j % 3 == 1 else j - 1 for j in range(1, 16)]
    return {
        "v_template": skin, "shapedirs": np.stack([longer, np.zeros_like(skin)], axis=2),
        "posedirs": 1e-4 * rng.normal(size=(778, 3, 135)), "weights": np.eye(16)[carried_by], "J_regressor": np.eye(16, 778),
        "kintree_table": np.array([[2**32 - 1, *parent], np.arange(16)]), "f": rng.integers(0, 778, (100, 3)),
    }  # fmt: skip


@pytest.fixture
def model_file(tmp_path):
    np.savez(tmp_path / "MANO_RIGHT.npz", **stand_in())
    return tmp_path / "MANO_RIGHT.npz"


def keypoints_of(model, found):
    """Return the keypoints (F, 21, 3) of shape and poses that were found."""
    pose = np.concatenate([found["global_orient"], found["hand_pose"]], axis=1)
    return model.keypoints21(found["betas"], pose.reshape(-1, 16, 3), found["transl"])


def test_known_shape_and_poses_come_back(model_file):
    model = ManoModel.read(model_file)
    rng = np.random.default_rng(0)
    betas = np.array([1.2, 0.0])
    pose = np.cumsum(0.05 * rng.normal(size=(24, 16, 3)), axis=0) + 0.1 * rng.normal(size=(16, 3))
    place = np.array([0.1, -0.2, 0.5]) + 0.002 * np.arange(24)[:, None]
    keypoints = model.keypoints21(betas, pose, place)
    _, track = sample_sequence("right")
    table = ResultsTable(replace(track, keypoints21=keypoints))
    fit = fit_mano(model, table)
    off = np.linalg.norm(keypoints_of(model, fit) - keypoints, axis=2)
    assert off.mean() < 1e-3
    assert 0.6 < fit["betas"][0] < 1.4  # of 1.2, which its population holds back


def test_a_tracked_hand_is_exported_as_mano_near_its_keypoints(model_file, tmp_path):
    _, track = sample_sequence("right", 8)
    table = ResultsTable(track, mano=model_file)
    (path,) = export_format("mano").write(tmp_path / "out.npz", table)
    with np.load(path) as found:
        assert found["hand_pose"].shape == (8, 45)
        assert found["keypoint_error_m"].max() < 0.004
        points = keypoints_of(ManoModel.read(model_file), found)
        far = np.linalg.norm(points - track.keypoints21, axis=2).mean(axis=1)
        assert_allclose(far, found["keypoint_error_m"], atol=1e-9)
    write_first_pose(tmp_path / "init.json", FirstPose(3, xyz=points[0]))
    start = read_first_pose(tmp_path / "init.json", track.parameter_names)
    assert_allclose(start.xyz, points[0], atol=1e-9)


def test_the_original_pickle_is_read_and_one_that_would_run_is_not(
    model_file, tmp_path, monkeypatch
):
    import sys
    import types

    arrays = stand_in()
    for name in ("chumpy", "chumpy.ch"):
        monkeypatch.setitem(sys.modules, name, types.ModuleType(name))
    sys.modules["chumpy.ch"].Ch = type("Ch", (), {"__module__": "chumpy.ch"})  # type: ignore[attr-defined]
    shapes = sys.modules["chumpy.ch"].Ch()
    shapes.x = arrays["shapedirs"]
    tree = {
        **arrays,
        "shapedirs": shapes,
        "J_regressor": scipy.sparse.csc_matrix(arrays["J_regressor"]),
    }
    path = tmp_path / "MANO_RIGHT.pkl"
    path.write_bytes(pickle.dumps(tree, protocol=2))
    plain, packed = ManoModel.read(model_file), ManoModel.read(path)
    assert_array_equal(packed.shape_directions, plain.shape_directions)
    assert_array_equal(packed.regressor, plain.regressor)
    path.write_bytes(b"cposix\nsystem\n(S'true'\ntR.")
    refused("system", ManoModel.read, path)


def test_a_model_of_the_other_hand_or_none_is_refused(model_file, tmp_path):
    _, track = sample_sequence("left", 8)
    with pytest.raises(HandtrackError, match="right hand's model"):
        export_format("mano").write(tmp_path / "x.npz", ResultsTable(track, mano=model_file))
    with pytest.raises(HandtrackError, match="--mano"):
        export_format("mano").write(tmp_path / "x.npz", ResultsTable(track))
