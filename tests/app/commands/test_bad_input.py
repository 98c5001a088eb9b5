"""Bad input, end to end: one readable paragraph that names what was given, exit code 2, and nothing written; or what is usable of it is used."""

import ctypes
import json
import os
import shutil
from collections.abc import Callable
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np
import pytest

from handtrack import PointCloud, bundled_session, read_npz
from handtrack.capture.clouds.cloud_files import write_cloud
from tests.app.cloudy_session import cloudy_session
from tests.app.command_line import FRAMES, QUICK, SIZE, listing, refused
from tests.capture.sample_files import filmed
from tests.session.small_session import edit
from tests.session.test_hostile_sessions import contains
from tests.session.test_times import cut

VIDEO = bundled_session("open_fist_open") / "cam0.mp4"


def first_pose(folder, **changes):
    data = json.loads((folder / "init.json").read_text())
    (folder / "init.json").write_text(json.dumps(data | changes))


def small_mask(folder, frame=0):
    cv2.imwrite(str(folder / f"masks/cam1/{frame:06d}.png"), np.zeros((120, 160), np.uint8))


SESSIONS: dict[str, tuple[Callable[[Path], object], str]] = {
    "calibrated for another size": (
        lambda f: edit(f / "calibration.toml", "[320, 240]", "[640, 480]"),
        "image_size = [320, 240]",
    ),
    "one camera's masks of another size": (small_mask, "160 x 120"),
    "no calibration": (lambda f: (f / "calibration.toml").unlink(), "calibration.toml"),
    "NaN in the first pose": (lambda f: first_pose(f, xyz=[[float("nan")] * 3] * 21), "null"),
    "first pose in millimetres": (
        lambda f: first_pose(f, xyz=[[0.0, 0.0, 10.0 * k] for k in range(21)]),
        "init.json",
    ),
}


@pytest.mark.parametrize("case", SESSIONS)
def test_a_session_that_cannot_be_used(case, handtrack, session):
    damage, word = SESSIONS[case]
    damage(session)
    refused(handtrack, session.parent, ["track", session], [word])


def test_a_truth_that_says_nothing_is_refused_and_one_in_millimetres_asked_about(
    handtrack, tracked, tmp_path
):
    path = tmp_path / "truth.npz"
    words = ["evaluate", tracked / "tracks/poses.npz", "--truth", path]
    for truth, word in (
        ({"joint_names": np.array(["elbow"]), "joint_positions": np.zeros((5, 1, 3))}, "elbow"),
        ({"keypoints21": np.full((5, 21, 3), np.nan)}, "truth.npz"),
        ({"keypoints21": np.zeros((2, 21, 3)), "frame": np.array([70, 71])}, "70 to 71"),
    ):
        np.savez(path, **truth)
        refused(handtrack, tmp_path, words, [word])
    with np.load(tracked / "truth.npz") as truth:
        np.savez(path, keypoints21=1000 * truth["keypoints21"])
    ended = handtrack.does(*words)
    assert "truth.npz" in ended.err


def test_a_mask_of_another_size_in_the_middle_loses_nothing(handtrack, session):
    """It is an error, since it may be another camera's; but what was tracked before it is saved and named."""
    small_mask(session, 3)
    ended = handtrack("track", session)
    assert ended.code == 2 and "000003.png" in ended.err and "160 x 120" in ended.err
    assert read_npz(session / "tracks/poses.npz").status.tolist() == [0, 0, 0]


def test_a_recording_that_is_shorter_than_its_video_says_is_tracked_to_its_end(
    handtrack, session, monkeypatch
):
    """Tracking does not wait for the frames to be counted; here that is done last, and shows that they end earlier."""
    monkeypatch.setattr("handtrack_app.commands.track.count_beside", lambda *_: None)
    noise = np.random.default_rng(0).integers(0, 255, (FRAMES, *SIZE[::-1], 3), np.uint8)
    filmed(session / "cam0.avi", noise, size=SIZE)
    cut(session / "cam0.avi")
    edit(session / "session.toml", 'name = "cam0"', 'name = "cam0"\nimages = "cam0.avi"')
    for mask in session.glob(f"masks/*/*{FRAMES - 1}.png"):
        mask.unlink()
    ended = handtrack.does("track", session)
    assert f"{FRAMES - 1} of {FRAMES - 1} frames" in ended.out
    assert "cam0.avi: announces 5 frames" in ended.err
    assert read_npz(session / "tracks/poses.npz").frame.tolist() == list(range(FRAMES - 1))


def test_bad_clouds_are_lost_frames_and_no_more(handtrack, tmp_path):
    clouds = cloudy_session(tmp_path, FRAMES, QUICK) / "clouds"
    edit(tmp_path / "session.toml", "forearm = false", "forearm = false\nscale = 1.0")
    np.savez(clouds / "001.npz", points=np.zeros((0, 3)))
    np.savez(clouds / "003.npz", points=np.tile([[np.nan], [np.inf], [-np.inf]], (700, 3)))
    path = (clouds / "004.npz").rename(clouds / "004.ply")
    write_cloud(path, PointCloud(np.zeros((1000, 3))))
    path.write_bytes(path.read_bytes()[:5000])
    edit(tmp_path / "session.toml", "clouds/*.npz", "clouds/*")
    ended = handtrack.does("track", tmp_path)
    track = read_npz(tmp_path / "tracks/poses.npz")
    assert track.status.tolist() == [0, 2, 0, 2, 2]
    assert np.isfinite(track.parameters).all()
    contains(ended.err, "2100 of 2100 points", "004.ply")


LINES = {
    "track {t}/none": "none does not exist",
    "doctor {s}/masks": "no session.toml",
    "doctor {s}/init.json": "session folder",
    "track {s} --set solver.iterations=many": "solver.iterations",
    "track {s} --set silhouettes.term=edges": "silhouettes.term",
    "track {s} --set silhouettes.weight=0 --set keypoints.weight=0": "--set",
    "track {s} --frames 0:6": "--frames 0:6",
    "track {s} --frames 3:3": "--frames 3:3",
    "track {s} --frames=-2:3": "expected A:B",
    "track {s} --use silhouettes,edges": "--use silhouettes,edges",
    "track {s} --use intensity": "no intensity",
    "track {s} --use cloud": "--use cloud",
    "track {s} --use ,": ",",
    "track {s} --init {t}/i.json": '"parameters"',
    "track {s} --init auto --set model.name=body34": "workbench",
    "track {s} --out {t}/poses.csv": "poses.csv",
    "track {s} --out {s}/x.npz": "x.npz",
    "track {s} --out {s}/init.json/deep/p.npz": "init.json",
    "track {s} --rerun-frame 2": "--rerun-frame 2",
    "track {s} --frames 0:2 --rerun-frame 3 --rerun-save {t}/r.rrd": "--rerun-frame 3",
    "export {t}/p.npz --to csv": "p.npz: no such file",
    "export {s} --to csv": "is a folder",
    "export {p} --to mp4 --session {t}": "no session.toml",
    "export {p} --to npz --out {p}": "that is the file that is read",
    "export {p} --to csv --out {t}/no/p.csv": "p.csv",
    "evaluate {s}/truth.npz --truth {s}/truth.npz": "truth.npz: no array `format`",
    "evaluate {p} --truth {s}/init.json": "init.json: no points in space that are known here",
    "track {s} --out {s}/truth.npz": "truth.npz",
    "calibrate --out {t}/c.toml --board chessboard:9x6:25mm --most-views 0": "--most-views 0",
    "new --out {t}/x --calibration {s}/calibration.toml --video cam0={v} --video cam1={v}": "--video cam1=",
    "simulate --out {s}": "--out",
    "simulate --out {p}": "new folder",
    "simulate --out {t}/x --cameras 99": "99",
    "simulate --out {t}/x --size 8 8": "(8, 8)",
    "simulate --out {t}/x --size 100000 9": "--size 100000",
    "simulate --out {t}/x --scale 190": "--scale 190",
    "simulate --out {t}/x --fps 0": "0–1000 frames a second",
    "simulate --out {t}/x --init-noise-mm inf": "--init-noise-mm",
    "simulate --out {t}/x --seed -1": "--seed -1",
    "new --out {t}/x --calibration {s}/calibration.toml --video cam0={t}/no.mp4": "--video cam0=",
    "new --out {t}/x --calibration {s}/calibration.toml --video cam0={s}/init.json": "re-encode",
    "new --out {t}/x --calibration {s}/calibration.toml --video {v}": "cam0.mp4: expected CAMERA=FILE",
    "new --out {t}/x --calibration {s}/calibration.toml --video left={v}": "left",
    "new --out {t}/x --calibration {s}/calibration.toml --video cam0={v} --video cam0={v}": "cam0",
    "new --out {t}/x --calibration {t}/c.toml --video cam0={v}": "c.toml: no such file",
    "new --out {t}/x --calibration {s}/session.toml --video cam0={v}": "write JSON",
    "new --out {s} --calibration {s}/calibration.toml --video cam0={v}": "is not empty",
    "new --out {t}/x --calibration {s}/calibration.toml --video cam0={v} --scaled --fps -3": "--fps -3",
    "new --out {t}/x --calibration {s}/calibration.toml --video cam0={v} --scaled --world-unit-m 0": "--world-unit-m 0",
    "open {s} --port 70000 --no-browser": "--port 70000",
    "open {s} --camera cam0=0": "--live",
    "open {s} --live --camera a=0 --camera a=1": "a=1",
    "open {s} --live --tolerance-ms 0": "tolerance-ms 0",
    "open {s} --live --record {s}": "not empty",
    "open --live": "--live",
    "batch {s} --jobs 0": "--jobs 0",
    "batch {s} --most-lost 7": "--most-lost 7",
    "takes {s} --frames 0:2": "--restore",
    "skin {s} --segmented {s}/init.json {t}/m.png": "[clouds]",
}
"""what the paragraph names; {s} is a session, {p} its poses, {t} an empty folder, {v} a video"""


@pytest.fixture(scope="module")
def places_of(tracked, tmp_path_factory):
    places_of = tmp_path_factory.mktemp("refused")
    shutil.copytree(tracked, places_of / "session")
    (places_of / "session" / "x.npz").mkdir()
    (places_of / "empty").mkdir()
    return places_of


@pytest.mark.parametrize("line", LINES)
def test_words_that_cannot_be_meant(line, handtrack, places_of):
    session = places_of / "session"
    places = {"s": session, "p": session / "tracks/poses.npz", "t": places_of / "empty", "v": VIDEO}
    refused(handtrack, places_of, [word.format(**places) for word in line.split()], [LINES[line]])


_CAP_DAC_OVERRIDE = 1


resource = pytest.importorskip("resource", reason="this system has no such limits")


def test_c61_too_many_open_files_are_told_and_no_misses(handtrack, session):
    before, free = resource.getrlimit(resource.RLIMIT_NOFILE), os.dup(0)
    os.close(free)
    resource.setrlimit(resource.RLIMIT_NOFILE, (free, before[1]))
    try:
        ended = handtrack("track", session)
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, before)
    assert ended.code == 2
    contains(ended.err, "Too many open files", "ulimit -n")


@contextmanager
def obeying():
    """Keep to the rights of files and folders, as who is no administrator must."""
    if os.geteuid():
        yield
        return
    libc, version_3, of_this_thread = ctypes.CDLL(None), 0x20080522, 0
    head, rights = (ctypes.c_uint32 * 2)(version_3, of_this_thread), (ctypes.c_uint32 * 6)()
    libc.capget(head, rights)
    before = rights[0]
    rights[0] &= ~(1 << _CAP_DAC_OVERRIDE)
    libc.capset(head, rights)
    try:
        yield
    finally:
        rights[0] = before
        libc.capset(head, rights)


def test_c55_a_read_only_folder_is_told_in_one_sentence(handtrack, done):
    for path in [done, *done.rglob("*")]:
        path.chmod(0o555 if path.is_dir() else 0o444)
    before = listing(done)
    with obeying():
        if os.access(done, os.W_OK, effective_ids=True):
            pytest.skip("here rights of a folder keep nobody from writing")
        for words in (
            ["track", done],
            ["export", done / "tracks/poses.npz", "--to", "csv"],
            ["takes", done, "--restore", "1"],
        ):
            ended = handtrack(*words)
            assert ended.code == 2
            contains(ended.err, "cannot be written", "Permission denied")
            assert ended.err.count("\n") == 1
        assert handtrack("doctor", done).out.endswith("nothing odd was found.\n")
    assert listing(done) == before
