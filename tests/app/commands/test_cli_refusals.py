"""Command lines that cannot be meant: one readable paragraph, exit code 2, and nothing written."""

from __future__ import annotations

import shutil
import socket
from pathlib import Path
from typing import NamedTuple

import pytest

from handtrack.session.bundled import bundled_session
from tests.app.command_line import refused
from tests.session.small_session import edit

VIDEO = bundled_session("open_fist_open") / "cam0.mp4"
BENCH = "silhouette_iteration_vs_blas"


@pytest.fixture
def session(tracked: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(tracked, tmp_path / "session"))


class Words(NamedTuple):
    """A command line; {s} is a session, {p} its poses, {t} an empty folder's path, {v} a video."""

    line: str
    expected: list[str]


LINES: dict[str, Words] = {
    "no such session": Words("track {t}/none", ["none does not exist", "expected a session folder"]),
    "no session": Words("doctor {s}/masks", ["no session.toml", "`handtrack new` makes one"]),
    "a file for a session": Words("doctor {s}/init.json", ["init.json is a file", "session folder"]),
    "opening no session": Words("open {t}/none --no-browser", ["none does not exist"]),
    "setting": Words("track {s} --set solver.speed=3", ["no setting 'solver.speed'", "known:"]),
    "setting without value": Words("track {s} --set solver", ["--set solver", "section.key=value"]),
    "setting's value": Words(
        "track {s} --set solver.iterations=many", ["solver.iterations", "expected", "'many'"]
    ),
    "setting's choice": Words(
        "track {s} --set silhouettes.term=edges", ["silhouettes.term", "coverage, conic_field", "'edges'"]
    ),
    "coupling": Words("track {s} --set model.coupling=17", ["model.coupling", "26, 21, 18", "'17'"]),
    "nothing to track by": Words(
        "track {s} --set silhouettes.weight=0 --set keypoints.weight=0", ["nothing is left to track by", "--set"]
    ),
    "frames after the end": Words("track {s} --frames 0:6", ["--frames 0:6", "0 to 4", "≤ 5"]),
    "no frames": Words("track {s} --frames 3:3", ["--frames 3:3", "expected A < B"]),
    "frames as text": Words("track {s} --frames all", ["--frames all", "expected A:B"]),
    "negative frames": Words("track {s} --frames=-2:3", ["--frames -2:3", "expected A:B"]),
    "edges without images": Words(
        "track {s} --use silhouettes,edges", ["--use silhouettes,edges", "session.toml", "no camera has images"]
    ),
    "intensity without images": Words("track {s} --use intensity", ["no intensity", "no camera has images"]),
    "use": Words("track {s} --use shadows", ["--use shadows", "known: silhouettes, cloud"]),
    "use what is not there": Words("track {s} --use cloud", ["--use cloud", "session.toml", "no table [clouds]"]),
    "use nothing": Words("track {s} --use ,", ["--use ','", "expected names"]),
    "no init file": Words("track {s} --init {t}/i.json", ["i.json: no such file", '"parameters"']),
    "init is no JSON": Words("track {s} --init {s}/session.toml", ["session.toml: not valid JSON"]),
    "init auto of a body": Words(
        "track {s} --init auto --set model.name=body34", ["by 2D joints only", "keypoint_layout", "workbench", "--init FILE"]
    ),
    "out is no npz": Words("track {s} --out {t}/poses.csv", ["poses.csv", ".npz"]),
    "out is a folder": Words("track {s} --out {s}/x.npz", ["x.npz", "that is a folder"]),
    "out below a file": Words(
        "track {s} --out {s}/init.json/deep/p.npz",
        ["cannot be written", "init.json", "Not a directory", "--out"],
    ),
    "a recording below a file": Words(
        "track {s} --rerun-save {s}/init.json/r.rrd", ["init.json/r.rrd", "cannot be written there"]
    ),
    "a frame looked at, nowhere": Words("track {s} --rerun-frame 2", ["--rerun-frame 2", "--rerun-save"]),
    "a frame looked at, not tracked": Words(
        "track {s} --frames 0:2 --rerun-frame 3 --rerun-save {t}/r.rrd", ["--rerun-frame 3", "0 to 1"]
    ),
    "no poses": Words("export {t}/p.npz --to csv", ["p.npz: no such file"]),
    "a folder for poses": Words("export {s} --to csv", ["is a folder", "tracks/poses.npz"]),
    "format": Words("export {p} --to xlsx", ["no format 'xlsx' in --to", "csv, csv-long, npz"]),
    "film of another folder": Words("export {p} --to mp4 --session {t}", ["no session.toml"]),
    "export on itself": Words("export {p} --to npz --out {p}", ["that is the file that is read"]),
    "export to nowhere": Words("export {p} --to csv --out {t}/no/p.csv", ["p.csv", "cannot be written"]),
    "truth as poses": Words("evaluate {s}/truth.npz --truth {s}/truth.npz", ["truth.npz: no array `format`"]),
    "poses as truth": Words("evaluate {p} --truth {s}/init.json", ["init.json: no points in space that are known here"]),
    "no truth": Words("evaluate {p} --truth {t}/none.npz", ["none.npz: no such file"]),
    "export over something else": Words("export {p} --to csv --out {s}/session.toml", ["session.toml", ".csv files"]),
    "export onto a folder": Words("export {p} --to npz --out {s}/x.npz", ["x.npz", "that is a folder"]),
    "result over the truth": Words(
        "track {s} --out {s}/truth.npz", ["truth.npz", "no tracked sequence", "nothing was tracked"]
    ),
    "use nearly right": Words("track {s} --use clouds", ["--use clouds", "Did you mean 'cloud'?"]),
    "setting nearly right": Words("track {s} --set solver.iteration=3", ["Did you mean 'solver.iterations'?"]),
    "calibrate without views": Words(
        "calibrate --out {t}/c.toml --board chessboard:9x6:25mm --most-views 0", ["--most-views 0", "at least 3"]
    ),
    "calibrate onto a session": Words(
        "calibrate --out {s}/init.json --board chessboard:9x6:25mm", ["init.json", ".toml files"]
    ),
    "new with one video for two": Words(
        "new --out {t}/x --calibration {s}/calibration.toml --video cam0={v} --video cam1={v}",
        ["--video cam1=", "the video of the camera 'cam0' already"],
    ),
    "simulate on a session": Words("simulate --out {s}", ["is not empty", "nothing was written", "--out"]),
    "simulate on a file": Words("simulate --out {p}", ["poses.npz is a file", "new folder"]),
    "simulate below a file": Words(
        "simulate --out {s}/init.json/x --frames 1 --size 64 48", ["writing there failed", "init.json"]
    ),
    "simulate no frames": Words("simulate --out {t}/x --frames 0", ["1–100000 frames", "0"]),
    "simulate cameras": Words("simulate --out {t}/x --cameras 99", ["1–32 cameras", "99"]),
    "simulate tiny": Words("simulate --out {t}/x --size 8 8", ["at least 32 pixels", "(8, 8)"]),
    "simulate huge": Words("simulate --out {t}/x --size 100000 9", ["--size 100000 9", "8192"]),
    "simulate nearness": Words("simulate --out {t}/x --distance nan", ["0.15–5 m", "nan"]),
    "simulate scale": Words("simulate --out {t}/x --scale 190", ["--scale 190", "a factor"]),
    "simulate rate": Words("simulate --out {t}/x --fps 0", ["0–1000 frames a second"]),
    "simulate noise": Words("simulate --out {t}/x --init-noise-mm inf", ["--init-noise-mm", "100"]),
    "simulate seed": Words("simulate --out {t}/x --seed -1", ["--seed -1", "whole number from 0"]),
    "simulate motion": Words("simulate --out {t}/x --motion wave", ["'wave'", "open_fist_open"]),
    "new without its video": Words(
        "new --out {t}/x --calibration {s}/calibration.toml --video cam0={t}/no.mp4",
        ["--video cam0=", "no.mp4: no such file", "expected a video"],
    ),
    "new with no video": Words(
        "new --out {t}/x --calibration {s}/calibration.toml --video cam0={s}/init.json",
        ["init.json: cannot be opened as a video", "re-encode"],
    ),
    "new without the camera's name": Words(
        "new --out {t}/x --calibration {s}/calibration.toml --video {v}",
        ["cam0.mp4: expected CAMERA=FILE"],
    ),
    "new with another camera": Words(
        "new --out {t}/x --calibration {s}/calibration.toml --video left={v}",
        ["calibration.toml has no camera 'left'", "cam0, cam1, cam2"],
    ),
    "new with a camera twice": Words(
        "new --out {t}/x --calibration {s}/calibration.toml --video cam0={v} --video cam0={v}",
        ["a second video of the camera 'cam0'"],
    ),
    "new without calibration": Words(
        "new --out {t}/x --calibration {t}/c.toml --video cam0={v}", ["c.toml: no such file"]
    ),
    "new with something else": Words(
        "new --out {t}/x --calibration {s}/session.toml --video cam0={v}", ["neither a camera matrix nor a pose", "its keys: session", "write JSON"]
    ),
    "new on a session": Words(
        "new --out {s} --calibration {s}/calibration.toml --video cam0={v}", ["is not empty"]
    ),
    "new with a wrong rate": Words(
        "new --out {t}/x --calibration {s}/calibration.toml --video cam0={v} --fps -3", ["--fps -3", "above 0"]
    ),
    "new with a wrong unit": Words(
        "new --out {t}/x --calibration {s}/calibration.toml --video cam0={v} --world-unit-m 0",
        ["--world-unit-m 0", "above 0"],
    ),
    "benchmark": Words("bench speed", ["no benchmark 'speed'", BENCH]),
    "port": Words("open {s} --port 70000 --no-browser", ["--port 70000", "1 to 65535"]),
}  # fmt: skip


@pytest.mark.parametrize("case", LINES)
def test_words_that_cannot_be_meant(case: str, handtrack, session: Path, tmp_path: Path) -> None:
    """Fault C64."""
    (session / "x.npz").mkdir()
    places = {"s": session, "p": session / "tracks/poses.npz", "t": tmp_path / "empty", "v": VIDEO}
    places["t"].mkdir()
    words: list[object] = [word.format(**places) for word in LINES[case].line.split(" ")]
    refused(handtrack, tmp_path, words, LINES[case].expected)


def test_a_port_that_is_taken(handtrack, session: Path) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen(1)
        port = taken.getsockname()[1]
        words = ["open", session, "--port", port, "--no-browser"]
        expected = [f"--port {port}", "cannot be used", "another workbench", "leave --port away"]
        refused(handtrack, session.parent, words, expected)


def test_new_with_videos_of_another_size(handtrack, session: Path, tmp_path: Path) -> None:
    edit(session / "calibration.toml", "[640, 480]", "[320, 240]")
    out = tmp_path / "made"
    words = [
        "new",
        "--out",
        out,
        "--calibration",
        session / "calibration.toml",
        "--video",
        f"cam0={VIDEO}",
    ]
    refused(handtrack, tmp_path, words, ["--video cam0=", "640 x 480", "calibrated for 320 x 240"])
