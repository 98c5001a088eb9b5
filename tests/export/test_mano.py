"""MANO exchange, with a stand-in of MANO's form made of our own hand: its licence keeps the real one out of tests."""

import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse
from numpy.testing import assert_allclose, assert_array_equal

from handtrack import HandtrackError
from handtrack.export.mano import ManoModel, fit_mano, write_init
from handtrack.export.registry import export_format
from handtrack.export.table import ResultsTable
from handtrack.model.articulated import keypoint_names
from handtrack.model.surfaces.metaballs import MetaballSurface
from handtrack.model.surfaces.surface_mesh import sample_surface
from handtrack.session.first_pose.first_pose import read_first_pose
from tests.export.sequences import sample_model, sample_sequence

FINGERS = ("index", "middle", "little", "ring", "thumb")
TIPS = {"thumb": 744, "index": 320, "middle": 443, "ring": 554, "little": 671}


def stand_in() -> dict[str, np.ndarray]:
    """Return arrays by MANO's names: skin and joints of our mean right hand, shapes of length and of thickness."""
    rng = np.random.default_rng(2)
    model = sample_model("right")
    bones = model.bones(model.params_from({}))
    keypoints = dict(zip(keypoint_names(), model.keypoints21(bones), strict=True))
    names = ["wrist"]
    for finger in FINGERS:
        parts = ("cmc", "mcp", "ip") if finger == "thumb" else ("mcp", "pip", "dip")
        names += [f"{finger}_{part}" for part in parts]
    joints = np.array([keypoints[name] for name in names])
    skin, normals = sample_surface(MetaballSurface.of(model), bones, 778, rng)
    for finger, vertex in TIPS.items():
        skin[vertex] = keypoints[f"{finger}_tip"]
    skin[:16] = joints  # which the regressor takes
    parent = [-1 if j == 0 else 0 if j % 3 == 1 else j - 1 for j in range(16)]
    ends = np.array(
        [
            keypoints[f"{n.split('_')[0]}_tip"]
            if n[-3:] in ("dip", "_ip")
            else joints[min(j + 1, 15)]
            for j, n in enumerate(names)
        ]
    )
    ends[0] = joints[4]
    middle = 0.5 * (joints + ends)
    near = np.linalg.norm(skin[:, None] - middle, axis=2)
    weights = np.exp(-((near / 0.012) ** 2)) + 1e-12
    weights /= weights.sum(axis=1, keepdims=True)
    for finger, vertex in TIPS.items():
        weights[vertex] = np.eye(16)[3 * FINGERS.index(finger) + 3]
    normals[:16] = 0
    for vertex in TIPS.values():
        normals[vertex] = 0
    shapes = np.stack([0.04 * (skin - joints[0]), 0.001 * normals], axis=2)
    return {
        "v_template": skin, "shapedirs": shapes, "posedirs": 1e-4 * rng.normal(size=(778, 3, 135)), "weights": weights,
        "J_regressor": np.eye(16, 778), "kintree_table": np.array([np.r_[2**32 - 1, parent[1:]], np.arange(16)]),
        "f": rng.integers(0, 778, (100, 3)),
    }  # fmt: skip


@pytest.fixture
def model_file(tmp_path: Path) -> Path:
    np.savez(tmp_path / "MANO_RIGHT.npz", **stand_in())
    return tmp_path / "MANO_RIGHT.npz"


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
    pose = np.concatenate([fit["global_orient"], fit["hand_pose"]], axis=1).reshape(24, 16, 3)
    found = model.keypoints21(fit["betas"], pose, fit["transl"])
    assert np.linalg.norm(found - keypoints, axis=2).mean() < 1e-3
    assert 0.6 < fit["betas"][0] < 1.4  # of 1.2, which its population holds back


def test_a_tracked_hand_is_exported_as_mano_near_its_keypoints(model_file, tmp_path):
    _, track = sample_sequence("right", 8)
    table = ResultsTable(track, mano=model_file)
    (path,) = export_format("mano").write(tmp_path / "out.npz", table)
    with np.load(path) as found:
        assert found["hand_pose"].shape == (8, 45)
        assert found["keypoint_error_m"].max() < 0.004
        pose = np.concatenate([found["global_orient"], found["hand_pose"]], 1).reshape(8, 16, 3)
        points = ManoModel.read(model_file).keypoints21(found["betas"], pose, found["transl"])
        far = np.linalg.norm(points - track.keypoints21, axis=2).mean(axis=1)
        assert_allclose(far, found["keypoint_error_m"], atol=1e-9)
    write_init(tmp_path / "init.json", points[0], 3)
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
    with pytest.raises(HandtrackError, match="system"):
        ManoModel.read(path)


def test_a_model_of_the_other_hand_or_none_is_refused(model_file, tmp_path):
    _, track = sample_sequence("left", 8)
    with pytest.raises(HandtrackError, match="right hand's model"):
        export_format("mano").write(tmp_path / "x.npz", ResultsTable(track, mano=model_file))
    with pytest.raises(HandtrackError, match="--mano"):
        export_format("mano").write(tmp_path / "x.npz", ResultsTable(track))
