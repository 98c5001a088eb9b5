"""Files of a session that are odd, foreign or made to do harm: each is read as it was meant, or refused in a sentence."""

from pathlib import Path

import numpy as np
import pytest

from handtrack.session.session import Session
from tests.session.small_session import edit, keypoints, make_session
from tests.session.test_bad_sessions import contains, refusal


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return make_session(tmp_path)


def test_c14_a_web_page_saved_as_an_image_and_an_empty_file_are_misses(folder):
    (folder / "masks/cam0/001.png").write_bytes(b"")
    (folder / "masks/cam0/002.png").write_text("<!doctype html><title>404</title>")
    session = Session.open(folder)
    seen = [[s.camera.name for s in session.observation(f).silhouettes] for f in (1, 2)]
    assert seen == [["cam1"], ["cam1"]]
    contains(
        " ".join(session.warnings), "the file is empty", "not a readable image", "counts as missing"
    )


def test_c29_cameras_go_by_their_names_whatever_the_order(folder):
    for file in ("session.toml", "calibration.toml"):
        edit(folder / file, 'name = "cam1"', 'name = "cam_2"')
        edit(folder / file, 'name = "cam0"', 'name = "cam_10"')
    text = (folder / "calibration.toml").read_text()
    first, second = text.split("[cam_1]")
    (folder / "calibration.toml").write_text(f"[cam_1]{second}\n{first}")
    rig = Session.open(folder).rig
    assert rig.names == ("cam_10", "cam_2")
    assert rig["cam_10"].rotation[0, 0] == 1.0
    assert rig["cam_2"].rotation[0, 0] == pytest.approx(np.cos(0.7))


class Canary:
    def __reduce__(self) -> tuple:
        return (Path.touch, (Path("canary"),))


@pytest.mark.parametrize("name", ["keypoints21", "joint_names", "time_s"])
def test_c51_a_pickle_in_an_npz_is_refused_and_not_run(name, folder, monkeypatch):
    monkeypatch.chdir(folder)
    harmful = np.empty(1, object)
    harmful[0] = Canary()
    np.savez(
        folder / "truth.npz", **{"keypoints21": keypoints()[None], name: harmful}, allow_pickle=True
    )
    contains(refusal(folder), "truth.npz", "Object arrays cannot be loaded")
    assert not (folder / "canary").exists()


@pytest.mark.parametrize(
    ("file", "text"),
    [
        ("init.json", '{"frame": ' + 100_000 * "[" + 100_000 * "]" + "}"),
        ("session.toml", "x = " + 100_000 * "[" + 100_000 * "]"),
        ("session.toml", f"x = {5000 * '9'}"),
    ],
    ids=["JSON nested", "TOML nested", "a number of 5000 digits"],
)
def test_c52_texts_made_to_break_their_reader_are_one_sentence(file, text, folder):
    (folder / file).write_text(text)
    told = refusal(folder)
    contains(told, file)
    assert len(told) < 1000


def test_c58_tables_as_spreadsheets_write_them(folder):
    rows = ["camera,frame,time_s", *(f"cam0,{frame},{frame / 10}" for frame in range(4))]
    edit(folder / "session.toml", "fps = 10.0", 'timestamps = "t.csv"')
    (folder / "t.csv").write_bytes(b"\xef\xbb\xbf" + "\r\n".join(rows).encode())
    assert Session.open(folder).time_s(3) == pytest.approx(0.3)
    (folder / "t.csv").write_text("\n".join(rows).replace(",", ";"))
    contains(refusal(folder), "the columns are camera;frame;time_s", "expected camera,frame,time_s")
