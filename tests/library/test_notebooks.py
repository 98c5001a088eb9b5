"""The notebooks run, each task in at most 15 lines and with public names alone."""

import json
import shutil

import pytest

import handtrack
from tests.conftest import REPOSITORY
from tests.sample_track import hand_track

NOTEBOOKS = sorted((REPOSITORY / "docs" / "notebooks").glob("*.ipynb"))


def cells(path):
    """Return the code of a notebook, cell by cell."""
    content = json.loads(path.read_text(encoding="utf-8"))
    return ["".join(c["source"]) for c in content["cells"] if c["cell_type"] == "code"]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_it_runs(path, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "Agg")
    shutil.copyfile(path.with_name("gripper.urdf"), tmp_path / "gripper.urdf")
    handtrack.write_npz(tmp_path / "poses.npz", hand_track())
    names = {}
    for code in cells(path):
        exec(compile(code, path.name, "exec"), names)
    printed = capsys.readouterr().out
    if path.stem == "masks_to_pose":
        assert printed.startswith("[0 0 0]")
    if path.stem == "own_term":
        free, touching = (float(line.split()[0]) for line in printed.splitlines())
        assert touching < 5.0 < 20.0 < free
    if path.stem == "plot":
        assert (tmp_path / "angles.png").stat().st_size > 1000
    if path.stem == "pandas":
        assert "index_pip_flex_deg" in (tmp_path / "angles.csv").read_text()
    if path.stem == "robot_hand":
        assert "left_curl 0.90" in printed or "left_curl 0.89" in printed
        assert "thumb_curl 0.56" in printed
