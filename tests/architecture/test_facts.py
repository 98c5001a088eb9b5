"""The sentences of docs/architecture.md about what a room knows, asserted on the imports."""

from __future__ import annotations

import re
from itertools import pairwise
from pathlib import Path

from tests.architecture.test_rooms import ARROWS, CORE, imported
from tests.conftest import REPOSITORY

PAGE = (REPOSITORY / "docs" / "architecture.md").read_text(encoding="utf-8")


def importers(room: str, *modules: str) -> set[str]:
    """Return the files below a room (posix paths without .py) that import one of the modules, or anything within it."""
    return {
        path.relative_to(CORE / room).with_suffix("").as_posix()
        for path in (CORE / room).rglob("*.py")
        for _, name in imported(path)
        if any(name == module or name.startswith(f"{module}.") for module in modules)
    }


def test_terms_know_no_coupling_limit_or_solver():
    hidden = [f"handtrack.model.{name}" for name in ("transform", "limits", "moving_limits")]
    assert not importers("terms", *hidden, "handtrack.solver")


def test_solver_knows_no_camera_and_no_observation():
    assert not importers(
        "solver", "handtrack.geometry", "handtrack.observation", "handtrack.capture"
    )


def test_four_files_of_the_solver_know_the_model():
    rest = {"levenberg_marquardt", "limited_step_kernels"}
    assert importers("solver", "handtrack.model.articulated") == {
        "problem",
        "assembly",
        "compiled_problem",
        "covariance",
    }
    assert not importers("solver", "handtrack.model.kinematics") & rest


def test_kinematics_alone_differentiates_joints():
    assert importers("model", "handtrack.model.kinematics_kernels") == {"kinematics", "articulated"}
    for room in ("terms", "tracking"):
        assert not importers(room, "handtrack.model.kinematics_kernels")
    assert importers("solver", "handtrack.model.kinematics_kernels") == {
        "compiled_problem",
        "descent_kernels",
    }


def test_one_file_outside_the_model_asks_for_couplings():
    holders = {name for name in importers("", "handtrack.model.transform") if "/" in name}
    rooms = {name for name in holders if name.split("/")[0] not in ("model", "bench")}
    assert rooms == {"sampling/interpretation_tree"}


def test_sampling_knows_one_camera_and_keypoints_but_no_images():
    cameras = importers("sampling", "handtrack.geometry.camera")
    assert cameras == {"interpretation_tree"}
    seen = {
        name
        for path in (CORE / "sampling").glob("*.py")
        for _, name in imported(path)
        if name.startswith("handtrack.observation.observation.")
    }
    assert {name.rpartition(".")[2] for name in seen} == {"Keypoints", "ImageKeypoints"}


def test_tracking_reads_models_alone():
    """The simpler ones that stand in for a hand, and that which a saved track is of."""
    assert not importers("tracking", "handtrack.files", "handtrack.session")
    readers = importers("tracking", "handtrack.model.model_file")
    assert readers == {"search/poor_cloud", "frame/tables/track_model"}


def test_randomness_has_a_seed():
    """No file uses NumPy's global generator or Python's."""
    paths = [*CORE.rglob("*.py"), *(REPOSITORY / "app").rglob("*.py")]
    for path in paths:
        used = set(re.findall(r"np\.random\.(\w+)", path.read_text(encoding="utf-8")))
        assert used <= {"Generator", "default_rng"}, path
        assert not re.search(
            r"default_rng\(\)|^import random", path.read_text(encoding="utf-8"), re.M
        ), path


def test_what_takes_long_to_import_waits_until_it_is_used():
    """No file that opening or tracking loads imports these at its beginning; boards and simulated scenes may."""
    slow = re.compile(r"^(?:import|from) (scipy|skimage|trimesh|networkx|rerun)\b", re.MULTILINE)
    free = ("bench", "calibration", "scenes")
    paths = [*CORE.rglob("*.py"), *(REPOSITORY / "app").rglob("*.py")]
    early = [p for p in paths if slow.search(p.read_text(encoding="utf-8"))]
    assert {p for p in early if not set(p.parts) & set(free)} == set()


def test_the_picture_of_the_rooms_shows_arrows_that_exist():
    """`a --> b`: b imports a, itself or in one of its inner rooms."""
    (chart,) = re.findall(r"```mermaid\nflowchart LR\n(.*?)```", PAGE, re.DOTALL)
    drawn = []
    for line in chart.replace("[handtrack_app]", "").splitlines():
        steps = [[name.strip() for name in part.split("&")] for part in line.split("-->")]
        drawn += [(a, b) for left, right in pairwise(steps) for a in left for b in right]
    assert len(drawn) > 10
    inner = {room: {a.partition(".")[0] for name, known in ARROWS.items() if name.partition(".")[0] == room for a in known}
             for room in {name.partition(".")[0] for name in ARROWS}}  # fmt: skip
    wrong = [(a, b) for a, b in drawn if b in inner and a not in inner[b]]
    assert wrong == []
    rooms = {name for arrow in drawn for name in arrow} - {"app", "bench"}
    assert rooms | {"files"} == set(inner)


def test_every_room_has_its_row():
    rows = "\n".join(line for line in PAGE.splitlines() if line.startswith("| `"))
    folders = {p.name for p in CORE.iterdir() if p.is_dir() and (p / "__init__.py").exists()}
    assert {name for name in folders if f"`{name}`" not in rows} == set()


def test_importers_finds_whole_modules_only(tmp_path, monkeypatch):
    room = tmp_path / "handtrack" / "room"
    room.mkdir(parents=True)
    (room / "one.py").write_text("from handtrack.model.limits import Limits\n")
    (room / "two.py").write_text("import handtrack.model.limits_of_it\n")
    monkeypatch.setattr("tests.architecture.test_facts.CORE", Path(tmp_path / "handtrack"))
    monkeypatch.setattr("tests.architecture.test_rooms.REPOSITORY", tmp_path)
    assert importers("room", "handtrack.model.limits") == {"one"}


def test_the_hand_detector_is_imported_where_it_is_used_only():
    outside = {
        n
        for n in importers("", "handtrack.detector")
        if n.split("/")[0] not in ("detector", "bench")
    }
    assert outside == {"session/detection"}
    asked = {n for n in importers("", "handtrack.session.detection") if n.split("/")[0] != "bench"}
    assert asked <= {"session/first_pose/first_pose_search"}
