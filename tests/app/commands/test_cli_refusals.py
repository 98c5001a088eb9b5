"""Command lines that cannot be meant: one readable paragraph that names what was given, exit code 2, and nothing written."""

import shutil

import pytest

from handtrack import bundled_session
from tests.app.command_line import refused

VIDEO = bundled_session("open_fist_open") / "cam0.mp4"
LINES = {
    "track {t}/none": "none does not exist",
    "doctor {s}/masks": "no session.toml",
    "doctor {s}/init.json": "session folder",
    "open {t}/none --no-browser": "none does not exist",
    "track {s} --set solver.speed=3": "solver.speed",
    "track {s} --set solver": "--set solver",
    "track {s} --set solver.iterations=many": "solver.iterations",
    "track {s} --set silhouettes.term=edges": "silhouettes.term",
    "track {s} --set model.coupling=17": "model.coupling",
    "track {s} --set silhouettes.weight=0 --set keypoints.weight=0": "--set",
    "track {s} --frames 0:6": "--frames 0:6",
    "track {s} --frames 3:3": "--frames 3:3",
    "track {s} --frames all": "--frames all",
    "track {s} --frames=-2:3": "expected A:B",
    "track {s} --use silhouettes,edges": "--use silhouettes,edges",
    "track {s} --use intensity": "no intensity",
    "track {s} --use shadows": "--use shadows",
    "track {s} --use cloud": "--use cloud",
    "track {s} --use ,": ",",
    "track {s} --init {t}/i.json": '"parameters"',
    "track {s} --init {s}/session.toml": "session.toml: not valid JSON",
    "track {s} --init auto --set model.name=body34": "workbench",
    "track {s} --out {t}/poses.csv": "poses.csv",
    "track {s} --out {s}/x.npz": "x.npz",
    "track {s} --out {s}/init.json/deep/p.npz": "init.json",
    "track {s} --rerun-save {s}/init.json/r.rrd": "init.json/r.rrd",
    "track {s} --rerun-frame 2": "--rerun-frame 2",
    "track {s} --frames 0:2 --rerun-frame 3 --rerun-save {t}/r.rrd": "--rerun-frame 3",
    "export {t}/p.npz --to csv": "p.npz: no such file",
    "export {s} --to csv": "is a folder",
    "export {p} --to xlsx": "xlsx",
    "export {p} --to mp4 --session {t}": "no session.toml",
    "export {p} --to npz --out {p}": "that is the file that is read",
    "export {p} --to csv --out {t}/no/p.csv": "p.csv",
    "evaluate {s}/truth.npz --truth {s}/truth.npz": "truth.npz: no array `format`",
    "evaluate {p} --truth {s}/init.json": "init.json: no points in space that are known here",
    "evaluate {p} --truth {t}/none.npz": "none.npz: no such file",
    "export {p} --to csv --out {s}/session.toml": "session.toml",
    "export {p} --to npz --out {s}/x.npz": "x.npz",
    "track {s} --out {s}/truth.npz": "truth.npz",
    "track {s} --use clouds": "--use clouds",
    "track {s} --set solver.iteration=3": "Did you mean 'solver.iterations'?",
    "calibrate --out {t}/c.toml --board chessboard:9x6:25mm --most-views 0": "--most-views 0",
    "calibrate --out {s}/init.json --board chessboard:9x6:25mm": "init.json",
    "new --out {t}/x --calibration {s}/calibration.toml --video cam0={v} --video cam1={v}": "--video cam1=",
    "simulate --out {s}": "--out",
    "simulate --out {p}": "new folder",
    "simulate --out {s}/init.json/x --frames 1 --size 64 48": "init.json",
    "simulate --out {t}/x --frames 0": "0",
    "simulate --out {t}/x --cameras 99": "99",
    "simulate --out {t}/x --size 8 8": "(8, 8)",
    "simulate --out {t}/x --size 100000 9": "--size 100000 9",
    "simulate --out {t}/x --distance nan": "nan",
    "simulate --out {t}/x --scale 190": "--scale 190",
    "simulate --out {t}/x --fps 0": "0–1000 frames a second",
    "simulate --out {t}/x --init-noise-mm inf": "--init-noise-mm",
    "simulate --out {t}/x --seed -1": "--seed -1",
    "simulate --out {t}/x --motion wave": "wave",
    "new --out {t}/x --calibration {s}/calibration.toml --video cam0={t}/no.mp4": "--video cam0=",
    "new --out {t}/x --calibration {s}/calibration.toml --video cam0={s}/init.json": "re-encode",
    "new --out {t}/x --calibration {s}/calibration.toml --video {v}": "cam0.mp4: expected CAMERA=FILE",
    "new --out {t}/x --calibration {s}/calibration.toml --video left={v}": "left",
    "new --out {t}/x --calibration {s}/calibration.toml --video cam0={v} --video cam0={v}": "cam0",
    "new --out {t}/x --calibration {t}/c.toml --video cam0={v}": "c.toml: no such file",
    "new --out {t}/x --calibration {s}/session.toml --video cam0={v}": "write JSON",
    "new --out {s} --calibration {s}/calibration.toml --video cam0={v}": "is not empty",
    "new --out {t}/x --calibration {s}/calibration.toml --video cam0={v} --fps -3": "--fps -3",
    "new --out {t}/x --calibration {s}/calibration.toml --video cam0={v} --world-unit-m 0": "--world-unit-m 0",
    "bench speed": "speed",
    "open {s} --port 70000 --no-browser": "--port 70000",
    "open {s} --camera cam0=0": "--live",
    "open {s} --record new": "--live",
    "open {s} --live --camera cam0": "cam0",
    "open {s} --live --camera a=0 --camera a=1": "a=1",
    "open {s} --live --tolerance-ms 0": "tolerance-ms 0",
    "open {s} --live --record {s}": "not empty",
    "open --live": "--live",
    "batch {t}/nothing": "nothing",
    "batch {s} --jobs 0": "--jobs 0",
    "batch {s} --most-lost 7": "--most-lost 7",
    "takes {s} --frames 0:2": "--restore",
    "track {s} --seed -1": "-1",
    "skin {s} --segmented {s}/init.json {t}/m.png": "[clouds]",
}
"""what the paragraph names; {s} is a session, {p} its poses, {t} an empty folder, {v} a video"""


@pytest.fixture(scope="module")
def folder(tracked, tmp_path_factory):
    folder = tmp_path_factory.mktemp("refused")
    shutil.copytree(tracked, folder / "session")
    (folder / "session" / "x.npz").mkdir()
    (folder / "empty").mkdir()
    return folder


@pytest.mark.parametrize("line", LINES)
def test_words_that_cannot_be_meant(line, handtrack, folder):
    session = folder / "session"
    places = {"s": session, "p": session / "tracks/poses.npz", "t": folder / "empty", "v": VIDEO}
    refused(handtrack, folder, [word.format(**places) for word in line.split()], [LINES[line]])
