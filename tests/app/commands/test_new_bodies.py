"""`handtrack new` with 2D joints of bodies."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from handtrack.capture.calibration.rig_file import write_rig
from handtrack.session.session import Session
from tests.app.command_line import CommandLine, refused
from tests.capture.joints.people import FORMS, FRAMES, in_order, openpose, pixels, rig
from tests.capture.joints.writers import openpose as openpose_hand


@pytest.fixture
def words(tmp_path: Path) -> list[object]:
    """Two cameras, each with a person's joints and a smaller one's behind."""
    write_rig(tmp_path / "rig.toml", rig())
    said: list[object] = [
        "new",
        "--out",
        tmp_path / "made",
        "--calibration",
        tmp_path / "rig.toml",
        "--fps",
        25,
    ]
    for i, camera in enumerate(rig()):
        seen = {f: in_order("body_25b", p) for f, p in enumerate(pixels(i))}
        people = {f: [p * (0.4, 0.4, 1.0), p] for f, p in seen.items() if f != 3 or i}
        said += ["--keypoints", f"{camera.name}={openpose(tmp_path / camera.name, people)}"]
    return said


def test_a_body_by_joints_alone(
    handtrack: CommandLine, words: list[object], tmp_path: Path
) -> None:
    ended = handtrack(*words)
    assert ended.code == 0, ended.err
    assert "a body (body_25b), the tallest who stays in 11 frames." in ended.err
    assert "2 people; others are in 11 frames (--person chooses one)." in ended.err
    assert "for bodies that is metres" in ended.err
    session = Session.open(tmp_path / "made")
    file = session.file
    assert (file.hand.model, file.hand.scale, session.frame_count) == ("body34", "fit", FRAMES)
    assert [(c.keypoint_layout, c.masks) for c in file.cameras] == [("body_25b", None)] * 2
    assert file.tracking["silhouettes"]["bands_mm"] == [60.0, 30.0, 10.0]
    focal_px, distance_m = 608.0, 3.5
    expected = 0.025 * focal_px / distance_m
    assert file.tracking["keypoints"]["sigma_px"] == pytest.approx(expected, rel=0.1)
    seen = session.view("cam0").keypoints(5, 1.0)[0]
    nose = pixels()[5][4]
    assert seen.pixels[seen.names.index("nose")] == pytest.approx(nose, abs=0.01)
    assert not session.view("cam0").keypoints(3, 1.0)


def test_another_person_and_an_own_model(
    handtrack: CommandLine, words: list[object], tmp_path: Path
) -> None:
    own = Path(__file__).parents[3] / "handtrack/model/definitions/body34.toml"
    (tmp_path / "own.toml").write_bytes(own.read_bytes())
    ended = handtrack(
        *words, "--person", 2, "--model", tmp_path / "own.toml", "--layout", "body_25b"
    )
    assert ended.code == 0, ended.err
    session = Session.open(tmp_path / "made")
    assert session.file.hand.model == "own.toml"
    seen = session.view("cam0").keypoints(5, 1.0)[0]
    assert seen.pixels[seen.names.index("nose")] == pytest.approx(0.4 * pixels()[5][4], abs=0.01)


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (["--person", 3], ["--person 3", "has 2 people; expected at most 2"]),
        (
            ["--layout", "halpe26"],
            ["people of 25 points, expected 26; layouts of 25: body_25, body_25b"],
        ),
        (["--layout", "body25"], ["no layout of joints 'body25'", "Did you mean 'body_25'?"]),
        (["--model", "hand26"], ["no hand in any frame"]),
        (["--model", "hand26", "--person", 1], ["--person 1 is about bodies"]),
        (["--model", "body43"], ["no model 'body43'"]),
        (["--model", "no/such.toml"], ["no such file; expected a definition, or hand26 or body34"]),
    ],
)
def test_words_that_do_not_fit_are_refused(
    more: list[object], said: list[str], handtrack: CommandLine, words: list[object], tmp_path: Path
) -> None:
    refused(handtrack, tmp_path, [*words, *more], said)


def test_hands_and_bodies_are_asked_about(
    handtrack: CommandLine, words: list[object], tmp_path: Path
) -> None:
    points = np.random.default_rng(0).uniform(100, 400, (3, 21, 3)) * (1, 1, 0.002)
    words[-1] = f"cam1={openpose_hand(tmp_path, points)}"
    refused(
        handtrack,
        tmp_path,
        words,
        ["has bodies", "hands; say what is to be tracked: --model body34"],
    )
    refused(handtrack, tmp_path, [*words, "--model", "body34"], ["no body in any frame"])


def test_a_codec_s_padding_is_no_other_size(
    handtrack: CommandLine, words: list[object], tmp_path: Path
) -> None:
    """Calibrated for 640 × 480, recorded as 632 × 480: eight columns are filling. 624 columns are another image."""
    for width, code in ((632, 0), (624, 2)):
        folder = tmp_path / str(width)
        folder.mkdir()
        cv2.imwrite(str(folder / "0.png"), np.zeros((480, width, 3), np.uint8))
        said = [*words, "--images", f"cam0={folder}"]
        said[2] = tmp_path / f"made{width}"
        ended = handtrack(*said)
        assert ended.code == code, ended.err
    session = Session.open(tmp_path / "made632")
    assert session.rig["cam0"].size == (632, 480)
    np.testing.assert_array_equal(session.rig["cam0"].matrix, rig()["cam0"].matrix)


def test_metres_and_millimetres_are_told_apart(
    handtrack: CommandLine, words: list[object], tmp_path: Path
) -> None:
    text = (tmp_path / "rig.toml").read_text()
    lines = []
    for line in text.splitlines():
        if line.startswith("translation"):
            numbers = [float(x) * 1e3 for x in line.split("[")[1].rstrip("]").split(",")]
            line = f"translation = {numbers}"
        lines.append(line)
    (tmp_path / "rig.toml").write_text("\n".join(lines) + "\n")
    ended = handtrack(*words)
    assert ended.code == 0, ended.err
    assert "for bodies that is millimetres" in ended.err
    found = Session.open(tmp_path / "made").rig["cam1"].translation
    np.testing.assert_allclose(found, rig()["cam1"].translation, atol=1e-6)


def test_joints_by_name_and_by_shares(handtrack: CommandLine, tmp_path: Path) -> None:
    write_rig(tmp_path / "rig.toml", rig())
    pairs = [
        f"cam{i}={FORMS[form][1](tmp_path)}"
        for i, form in enumerate(("deeplabcut csv", "mediapipe"))
    ]
    ended = handtrack(
        "new", "--out", tmp_path / "made", "--calibration", tmp_path / "rig.toml", "--fps", 25, "--world-unit-m", 1,
        "--keypoints", pairs[0], "--keypoints", pairs[1],
    )  # fmt: skip
    assert ended.code == 0, ended.err
    assert "not a body's, so left out: tail." in ended.err
    session = Session.open(tmp_path / "made")
    assert [c.keypoint_layout for c in session.file.cameras] == ["body22", "mediapipe33"]
    for name in ("cam0", "cam1"):
        seen = session.view(name).keypoints(5, 1.0)[0]
        assert seen.pixels[seen.names.index("nose")] == pytest.approx(pixels()[5][4], abs=0.01)
