"""Tables of numbers: the contract's CSV, tidy ones, what explains them, and joints alone."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from handtrack.errors import HandtrackError
from handtrack.export.registry import export_format
from handtrack.export.table import ResultsTable
from handtrack.model.articulated import keypoint_names
from handtrack.model.model_file import scale_table
from handtrack.session.formats.tables import read_npz, write_npz
from handtrack.session.formats.truth import read_truth
from handtrack.tracking.frame.result import COLUMNS, TrackResult
from handtrack.tracking.frame.tables.labelled import joint_confidence
from tests.export.sequences import KINDS, LOST_ROW, sample_sequence
from tests.sample_track import sample_track


def written(name: str, track: TrackResult, folder: Path) -> list[Path]:
    file = export_format(name)
    return file.write(folder / f"poses{file.ending}", ResultsTable(track))


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_csv_is_the_contracts(rng, tmp_path):
    track = sample_track(rng, range(3, 6))
    path, _ = written("csv", track, tmp_path)
    assert path.name == "poses.csv"
    with path.open(newline="") as file:
        header, *rows = list(csv.reader(file))
    assert header[:11] == [
        *("frame", "time_s", "status", "energy", "root_tx_m", "root_ty_m", "root_tz_m"),
        *("root_rx_deg", "root_ry_deg", "root_rz_deg", "index_mcp_flex_deg"),
    ]
    assert header[11:14] == ["wrist_x_m", "wrist_y_m", "wrist_z_m"]
    assert header[-1] == "little_tip_z_m"
    assert [row[0] for row in rows] == ["3", "4", "5"]
    values = np.array(rows, dtype=float)
    np.testing.assert_allclose(values[:, 4:7], track.parameters[:, :3], rtol=1e-8)
    np.testing.assert_allclose(np.deg2rad(values[:, 7:11]), track.parameters[:, 3:], rtol=1e-8)
    np.testing.assert_allclose(values[:, 11:], track.joint_positions.reshape(3, -1), rtol=1e-8)


@pytest.mark.parametrize("kind", KINDS)
def test_csv_says_how_probably_a_frame_is_off_and_why(kind, tmp_path):
    model, track = sample_sequence(kind)
    path, side = written("csv", track, tmp_path)
    rows = rows_of(path)
    assert rows[LOST_ROW]["reason"] == str(track.reason[LOST_ROW]) != ""
    assert float(rows[4]["p_off_25mm"]) == pytest.approx(track.p_off_25mm[4])
    assert ("p_off_10mm_thumb" in rows[0]) == model.has_keypoints21
    told = json.loads(side.read_text())
    assert set(told["columns"]) == set(rows[0])
    assert (told["fps"], told["side"], told["unit"]) == (50.0, model.side, "m")
    bones = {bone["name"]: bone for bone in told["bones"]}
    assert list(bones) == list(model.skeleton.bone_names)
    assert bones[model.skeleton.bone_names[0]]["parent"] is None
    limits = {p["name"]: p["limits"] for p in told["parameters"]}
    last = model.parameter_names[-1]
    np.testing.assert_allclose(limits[last], np.rad2deg(model.limits.interval[-1]))
    assert [camera["name"] for camera in told["cameras"]] == ["front", "side"]


@pytest.mark.parametrize("kind", KINDS)
def test_tidy_tables_have_a_row_a_joint_an_angle_a_bone(kind, tmp_path):
    model, track = sample_sequence(kind)
    joints, angles, bones, side = written("csv-long", track, tmp_path)
    names = [path.name for path in (joints, angles, bones, side)]
    assert names == [
        "poses_long.csv", "poses_long_angles.csv", "poses_long_bones.csv", "poses_long.json"
    ]  # fmt: skip
    rows = rows_of(joints)
    assert len(rows) == len(track) * len(model.joint_names)
    assert float(rows[-1]["z_m"]) == pytest.approx(track.joint_positions[-1, -1, 2])
    assert float(rows[-1]["std_y_m"]) == pytest.approx(1.5e-3)
    own = [row for row in rows_of(angles) if row["convention"] == "handtrack"]
    assert len(own) == len(track) * (len(model.parameter_names) - 6)
    assert np.deg2rad(float(own[-1]["value_deg"])) == pytest.approx(track.parameters[-1, -1])
    assert np.deg2rad(float(own[-1]["std_deg"])) == pytest.approx(track.parameter_std[-1, -1])
    isb = [row for row in rows_of(angles) if row["convention"] == "isb"]
    assert len(isb) == (len(track) * 45 if model.has_keypoints21 else 0)
    assert all(row["std_deg"] for row in isb)
    turned = rows_of(bones)[-1]
    quaternion = np.array([float(turned[f"q{axis}"]) for axis in "wxyz"])
    assert np.linalg.norm(quaternion) == pytest.approx(1.0)
    assert turned["bone"] == model.skeleton.bone_names[-1]


def test_files_beside_that_were_there_are_kept(tmp_path):
    (tmp_path / "poses.json").write_text("mine")
    written("csv", sample_sequence("right")[1], tmp_path)
    (kept,) = (tmp_path / "versions").iterdir()
    assert kept.read_text() == "mine"


def test_exported_keypoints_can_serve_as_truth(rng, tmp_path):
    track = sample_track(rng, [4, 7])
    (path,) = written("keypoints", track, tmp_path)
    truth = read_truth(path)
    assert truth.frame.tolist() == [4, 7]
    np.testing.assert_array_equal(truth.keypoints21, track.keypoints21)


def test_exported_npz_is_the_result_to_the_byte(tmp_path):
    _, track = sample_sequence("left")
    (path,) = written("npz", track, tmp_path)
    write_npz(tmp_path / "again.npz", read_npz(path))
    assert path.read_bytes() == (tmp_path / "again.npz").read_bytes()


@pytest.mark.parametrize("kind", ["csv", "csv-long", "anipose"])
def test_c54_a_name_that_begins_a_formula_is_text_and_numbers_stay(kind, rng, tmp_path):
    track = sample_track(rng)
    name = '=HYPERLINK("http://x")'
    track = replace(track, joint_names=(name, "@sum", *track.joint_names[2:]))
    path = written(kind, track, tmp_path)[0]
    with path.open(newline="", encoding="utf-8") as file:
        cells = [cell for row in csv.reader(file) for cell in row]
    assert any(cell.startswith("'" + name) for cell in cells)
    assert any(cell.startswith("'@sum") for cell in cells)
    risky = [cell for cell in cells if cell.startswith(("=", "+", "-", "@"))]
    assert risky  # negative coordinates
    assert all(np.isfinite(float(cell)) for cell in risky)


def test_frames_that_were_not_tracked_are_lost_ones_where_a_format_has_a_rate(tmp_path):
    _, track = sample_sequence("right")
    rows = np.array([0, 1, 4])
    there = {name: getattr(track, name) for name in COLUMNS}
    part = replace(track, **{n: a[rows] for n, a in there.items() if a is not None})
    whole = ResultsTable(part).without_gaps
    assert whole.track.frame.tolist() == [3, 4, 5, 6, 7]
    assert whole.is_lost.tolist() == [False, False, True, True, False]
    np.testing.assert_allclose(whole.track.time_s, np.arange(3, 8) / 50)
    np.testing.assert_array_equal(whole.track.parameters[3], track.parameters[1])
    assert np.isinf(whole.track.parameter_std[2]).all()
    assert (joint_confidence(whole.track)[2:4] == 0).all()
    (path,) = written("bvh", part, tmp_path)
    assert "Frames: 5" in path.read_text()


@pytest.mark.parametrize("kind", KINDS)
def test_how_far_one_skeleton_is_from_the_frames_is_known(kind):
    """A track that is put together from takes of hands of two sizes."""
    _, track = sample_sequence(kind)
    assert ResultsTable(track).misfit_m < 1e-9
    larger = json.dumps(json.loads(track.scale) | {"overall": 1.02 * json.loads(track.scale)["overall"]})  # fmt: skip
    span = np.linalg.norm(track.joint_positions - track.joint_positions[:, :1], axis=2).max()
    assert ResultsTable(replace(track, scale=larger)).misfit_m == pytest.approx(
        0.02 * span, rel=0.2
    )


def test_exports_say_whose_points_they_hold_and_hold_those_asked_for(tmp_path):
    """A thumb's knuckle that its detector sees 8 mm further out is there in every format of points; a skeleton has none of them."""
    model, track = sample_sequence("right")
    seen = replace(
        model.scale, offsets_mm={"thumb_mcp": (0.0, 8.0, 0.0)}, landmark_definition="mediapipe21"
    )
    track = replace(track, scale=json.dumps(scale_table(seen)))
    row, factor = keypoint_names().index("thumb_mcp"), model.scale.factor("thumb")
    held: dict[str, np.ndarray] = {}
    for landmarks in ("joints", "mediapipe21"):
        paths = {
            name: tmp_path / f"{landmarks}.{name}" for name in ("keypoints", "openpose", "csv")
        }
        for name, path in paths.items():
            export_format(name).write(path, ResultsTable(track), "", landmarks)
        with np.load(paths["keypoints"]) as file:
            assert str(file["keypoint_definition"]) == landmarks
            held[landmarks] = file["keypoints21"]
        (told := json.loads(paths["openpose"].read_text())).pop("frames")
        assert told["keypoint_definition"] == landmarks
        assert (
            json.loads(paths["csv"].with_suffix(".json").read_text())["keypoint_definition"]
            == landmarks
        )
        place = [float(rows_of(paths["csv"])[0][f"thumb_mcp_{axis}_m"]) for axis in "xyz"]
        np.testing.assert_allclose(place, held[landmarks][0, row], atol=1e-8)
    moved = np.linalg.norm(held["mediapipe21"] - held["joints"], axis=2)
    np.testing.assert_allclose(moved[:, row], 0.008 * factor, atol=1e-9)
    assert np.delete(moved, row, axis=1).max() < 1e-9
    with pytest.raises(HandtrackError, match="openpose21"):
        export_format("csv").write(tmp_path / "no.csv", ResultsTable(track), "", "openpose21")
    with pytest.raises(HandtrackError, match="bvh"):
        export_format("bvh").write(tmp_path / "no.bvh", ResultsTable(track), "", "mediapipe21")
    assert not list(tmp_path.glob("no.*"))


@pytest.mark.parametrize("kind", KINDS)
def test_a_result_of_nobodys_detector_has_joints_alone(kind, tmp_path):
    _, track = sample_sequence(kind)
    write_npz(tmp_path / "poses.npz", track)
    with np.load(tmp_path / "poses.npz") as file:
        assert not {"landmarks", "landmark_definition", "landmark_covariance"} & set(file.files)
    assert (track.landmarks, track.landmark_definition) == (None, None)
