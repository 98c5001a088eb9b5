"""What people import: small, documented, and enough without a session."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from handtrack import (
    HandScale,
    ImageKeypoints,
    JointPositionTerm,
    Keypoints,
    Observation,
    bundled_session,
    evaluate,
    find_pose,
    load_model,
    read_cameras,
    track,
    write_csv,
    write_npz,
)
from handtrack.model.articulated import keypoint_names
from handtrack.terms.priors import GaussianPrior
from tests.cameras import pinhole
from tests.conftest import refused
from tests.derivatives import check_observation_term
from tests.sample_track import hand_track

HAND = load_model("hand26")
TIPS = ("thumb_tip", "index_tip")
CAMERAS = read_cameras(bundled_session() / "calibration.toml")


def posed(bend=0.5):
    params = HAND.rest_params()
    params[HAND.parameter_names.index("index_pip_flex")] = bend
    return params


def points(params, frame=0):
    seen = Keypoints(HAND.joint_names, HAND.joint_positions(HAND.bones(params)), 0.003)
    return Observation(frame, frame / 30, keypoints=(seen,))


def test_calibrations_are_read_in_metres(tmp_path):
    assert CAMERAS.names == ("cam0", "cam1", "cam2")
    text = '{"a": {"K": [[500, 0, 320], [0, 500, 240], [0, 0, 1]], "dist": [0, 0, 0, 0, 0], "R": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "t": [0, 0, 3]}}'
    (tmp_path / "c.json").write_text(text)
    refused("no image size", read_cameras, tmp_path / "c.json")
    camera = read_cameras(tmp_path / "c.json", unit_m=0.1, size=(640, 480))["a"]
    assert_allclose(camera.translation, [0, 0, 0.3])


def test_a_pose_from_points_in_space_or_joints_in_two_images():
    joint = posed(0.9)
    joint[:3] = CAMERAS["cam0"].centre + 0.5 * CAMERAS["cam0"].rotation[2]
    at = HAND.keypoints21(HAND.bones(joint))
    seen = tuple(ImageKeypoints(c, keypoint_names(), c.project(at), 2.0) for c in list(CAMERAS)[:2])
    for given, within in ((points(joint), 2e-3), (Observation(0, 0.0, keypoints=seen), 3e-3)):
        (found, *_) = find_pose(HAND, given)
        assert np.abs(HAND.keypoints21(HAND.bones(found.params)) - at).max() < within


def test_values_that_follow_need_not_be_given_and_may_not_contradict():
    coupled = load_model("hand26", coupling="21")

    def joint(params, name):
        return float(coupled.joint_params(params)[coupled.parameter_names.index(name)])

    bent = coupled.params_from({"index_pip_flex": 0.6})
    assert joint(bent, "index_pip_flex") == pytest.approx(0.6)
    assert joint(bent, "index_dip_flex") == pytest.approx(0.4)
    assert joint(coupled.params_from({"index_dip_flex": 0.4}), "index_pip_flex") == pytest.approx(0.6)  # fmt: skip
    against = {"index_pip_flex": 0.6, "index_dip_flex": 0.0}
    refused(r"'21'.*index_.*nearest=True", coupled.params_from, against)
    nearest = joint(coupled.params_from(against, nearest=True), "index_pip_flex")
    assert nearest == pytest.approx(0.6 / (1 + 4 / 9))


def test_what_does_not_fit_is_refused_in_words():
    """Each was taken in silence, or ended in a line of NumPy's."""
    at = HAND.joint_positions(HAND.bones(posed()))
    listed = Keypoints(list(HAND.joint_names), at.tolist(), 0.003)  # type: ignore[arg-type]
    assert listed.positions.shape == at.shape
    seen = points(posed())
    mm = Keypoints(HAND.joint_names, 1e3 * at, 1.0)
    refused(r"\(1, 3\).*\(21, 3\)", Keypoints, ("wrist",), at, 0.003)
    refused("0.0", Keypoints, HAND.joint_names, at, 0.0)
    refused(r"\(1, 2\)", ImageKeypoints, CAMERAS["cam0"], ("wrist",), at[:1], 2.0)
    refused("camera", ImageKeypoints, "cam0", HAND.joint_names, at[:, :2], 2.0)
    refused("seconds", Observation, 0, np.nan)
    refused("'indx'.*'index'", load_model, scale=HandScale(1.0, {"indx": 1.1}))
    refused("load_model", track, "hand26", seen)
    refused(r"\(26\).*\(5,\)", track, HAND, seen, start=np.zeros(5))
    refused("params_from", track, HAND, seen, "rest")
    refused("ObservationTerm", track, HAND, seen, terms=abs)
    refused("grow", track, HAND, [seen, replace(seen, frame=1)])
    refused("unit", track, HAND, Observation(0, 0.0, keypoints=(mm,)))
    refused("root_tx", track, HAND, seen, posed() * np.nan)


def test_numbers_by_name():
    result = hand_track()
    name = "index_pip_flex"
    row = result.parameter_names.index(name)
    assert_allclose(result.angle(name), np.rad2deg(result.parameters[:, row]))
    assert_allclose(result.angle(name, degrees=False), result.parameters[:, row])
    assert_allclose(result.joint("wrist"), result.joint_positions[:, 0])
    refused("no angle 'index_pip'", result.angle, "index_pip")
    refused("no joint 'thumb'", result.joint, "thumb")


def test_a_result_says_of_what_size_its_model_is():
    assert '"overall": 1.2' in track(load_model(scale=1.2), points(posed())).scale


def test_tables_for_pandas_and_xarray():
    pytest.importorskip("pandas")
    pytest.importorskip("xarray")
    result = hand_track()
    table, data = result.to_dataframe(), result.to_xarray()
    assert table.index.name == "frame"
    assert_allclose(table["index_pip_flex_deg"], result.angle("index_pip_flex"))
    assert_allclose(table["index_tip_x_m"], result.joint("index_tip")[:, 0])
    assert {"root_tx_m", "root_rx_deg", "root_tx_std_m", "status"} <= set(table.columns)
    wrist = data.position.sel(keypoints="wrist", individuals="right")
    assert_allclose(wrist, result.joint("wrist"))
    assert {"time", "space", "keypoints", "individuals"} == set(
        data.position.dims
    )  # as movement asks
    assert (data.attrs["ds_type"], data.attrs["fps"]) == ("poses", 25.0)


def test_what_cannot_be_compared_or_written_is_refused(tmp_path):
    refused(r"\(2, 21, 3\).*Truth", evaluate, hand_track(), np.zeros((2, 21, 3)))
    for write in (write_csv, write_npz):
        refused("no folder", write, tmp_path / "none/a", hand_track())


def test_gradient_and_hessian(rng):
    bones = HAND.bones(HAND.clipped(rng.normal(scale=0.3, size=26)))
    term = JointPositionTerm(HAND, TIPS, lambda at: [(at[0] - at[1]) @ (at[0] - at[1]) / 0.01, at[1, 2] / 0.01])  # fmt: skip
    check_observation_term(term, bones, HAND.skeleton.bone_names)


def test_terms_and_priors_of_ones_own_count():
    start = posed()
    gap = JointPositionTerm(HAND, TIPS, lambda at: (at[0] - at[1]) / 0.0005, name="touch")
    bend = HAND.parameter_names.index("ring_pip_flex")
    wanted, sigma = HAND.rest.copy(), np.full(26, np.inf)
    wanted[bend], sigma[bend] = 1.2, 0.01
    prior = GaussianPrior(wanted, sigma, "bent")
    result = track(HAND, [points(start)], start, terms=[gap], priors=[prior])
    assert np.linalg.norm(result.joint("thumb_tip") - result.joint("index_tip")) < 0.006
    assert result.angle("ring_pip_flex", degrees=False)[0] == pytest.approx(1.2, abs=0.05)
    assert {"touch", "bent"} <= set(result.energy_names or ())


def test_a_recording_of_masks_becomes_observations_in_one_call():
    names = ("left", "right")
    cameras = [pinhole(name, (20, 16), 50) for name in names]
    masks = {name: np.zeros((3, 16, 20), np.uint8) for name in names}
    masks["left"][1, 4:9, 5:11] = 255
    sequence = Observation.sequence(cameras, masks, fps=10.0)
    assert [(o.frame, o.time_s) for o in sequence] == [(0, 0.0), (1, 0.1), (2, 0.2)]
    assert sequence[1].silhouettes[0].mask.sum() == 30
    for wrong, fps, words in (
        ({**masks, "right": masks["right"][:2]}, 1, "left 3, right 2"),
        ({"middle": masks["left"]}, 1, "middle"),
        (masks, 0, "fps"),
    ):
        refused(words, Observation.sequence, cameras, wrong, fps)
