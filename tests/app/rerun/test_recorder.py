"""What the recorder writes for rerun, read back."""

import threading
import urllib.request
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from handtrack import Session, TrackingRun
from handtrack.geometry.rotation import matrix_from_quaternion, rotation_matrix
from handtrack.tracking.frame.control import Control
from handtrack.tracking.frame.terms.cloud_terms import fitted_surface
from handtrack_app import rerun_recorder as residual_recorder
from handtrack_app.rerun_recorder import LiveRecorder, ResidualRecorder, log_cameras, log_space
from tests.app.cloudy_session import cloudy_session
from tests.app.command_line import small_recording
from tests.app.desk import a_desk
from tests.app.rerun.test_stream import chunks, picture, scalars
from tests.app.waiting import eventually

FRAMES = range(3)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = small_recording(tmp_path_factory.mktemp("recorder") / "small", frames=3)
    return TrackingRun.open(Session.open(folder), {"tracker.estimate": "forward"})


@pytest.fixture(scope="module")
def results(run):
    return list(run.track(FRAMES, *run.initial()))


def recorded(run, folder, *results):
    """Return a recorder that has written results to a file, and is closed."""
    recorder = ResidualRecorder(run, path=folder / "run.rrd")
    for result in results:
        recorder.show(result)
    recorder.close()
    return recorder


def test_frames_and_the_iterations_of_one(run, results, tmp_path):
    path = tmp_path / "run.rrd"
    recorder = ResidualRecorder(run, path=path, closely=2)
    again = run.track(FRAMES, *run.initial(), recorder.watching(Control()))
    for result, expected in zip(again, results, strict=True):
        recorder.show(result)
        assert_array_equal(result.parameters, expected.parameters)
    recorder.close()
    assert recorder.problem == ""
    energies = {r.frame: r.energy for r in results}
    assert scalars(path, "/energy/total") == pytest.approx(energies)
    assert scalars(path, "/solver/iterations") == {r.frame: r.iterations for r in results}
    overlap = scalars(path, "/overlap/cam0")
    assert set(overlap) == set(energies) and min(overlap.values()) > 0.8
    errors = scalars(path, "/error/mm")
    assert set(errors) == set(energies) and max(errors.values()) < 10
    terms = {name for r in results for name in r.energies}
    assert scalars(path, f"/energy/{min(terms)}").keys() == energies.keys()
    for entity in ("/world/skeleton", "/world/flesh"):
        assert sum(batch.num_rows for batch in chunks(path, entity)) == len(results), entity
    tabs = residual_recorder.layout(recorder._pictures).root_container.contents[0].contents[1]  # type: ignore[index]
    assert all(picture(path, view.origin).size for tab in tabs.contents for view in tab.contents)  # type: ignore[union-attr]
    at = run.model.parameter_names.index("index_mcp_flex")
    bends = {r.frame: r.parameters[at] for r in results}
    assert scalars(path, "/parameters/index_mcp_flex") == pytest.approx(bends)

    root = "/closely/frame_2"
    costs = scalars(path, f"{root}/energy/total", "iteration")
    assert sorted(costs) == list(range(1, len(costs) + 1))
    assert costs[len(costs)] == pytest.approx(energies[2])
    last = scalars(path, f"{root}/parameters/index_mcp_flex", "iteration")[len(costs)]
    assert last == pytest.approx(bends[2])

    for entity in ("/cameras/cam0", f"{root}/cameras/cam0"):
        observed = picture(path, f"{entity}/observed").astype(float)
        predicted = picture(path, f"{entity}/predicted").astype(float)
        assert np.abs(observed - predicted).mean() < 10  # they overlap
        residual = picture(path, f"{entity}/residual")
        assert np.median(residual) > 250  # white where nothing is left


def test_a_live_viewer_and_a_file_at_once(run, results, tmp_path):
    path, told = tmp_path / "run.rrd", []
    recorder = ResidualRecorder(run, True, path, report=told.append)
    recorder.show(results[0])
    eventually(lambda: told)  # and it answers
    page = urllib.request.urlopen(told[0].partition("?")[0]).read()
    assert b"<html" in page[:500].lower()
    recorder.close()
    with pytest.raises(OSError, match="refused"):
        urllib.request.urlopen(told[0].partition("?")[0])
    assert scalars(path, "/energy/total") == {0: results[0].energy}


def test_what_stands_in_space_is_where_the_model_and_the_cameras_are(run):
    pytest.importorskip("rerun")
    bones = run.model.bones(run.initial()[1])
    told = {}
    recording = SimpleNamespace(log=lambda name, what, static=False: told.setdefault(name, what))
    log_space(recording, run.model, bones, None, {})
    posed = run.model.ellipsoids["fine"].posed(bones)
    turns = np.array(told["world/flesh"].quaternions.as_arrow_array().to_pylist())
    assert_allclose(matrix_from_quaternion(turns[:, [3, 0, 1, 2]]), posed.rotation, atol=1e-6)
    rotation = rotation_matrix(np.array([0.3, -0.2, 0.5]))
    camera = replace(run.session.rig.cameras[0], rotation=rotation)
    log_cameras(recording, [camera])
    place = told[f"world/cameras/{camera.name}"]
    columns = np.array(place.mat3x3.as_arrow_array().to_pylist()).reshape(3, 3)
    assert_allclose(columns, rotation, atol=1e-6)


def test_the_residual_is_red_where_the_hand_is_missed(run, results, tmp_path):
    away = results[0].parameters.copy()
    away[0] += 0.3
    assert not recorded(run, tmp_path, replace(results[0], parameters=away)).problem
    seen = run.session.observation(0).silhouettes[0].mask > 0.99
    residual = picture(tmp_path / "run.rrd", "/cameras/cam0/residual")[seen]
    assert np.median(residual, axis=0) == pytest.approx([255, 0, 0], abs=30)


def test_a_silhouette_that_is_not_fitted_to_leaves_the_others_their_cameras(
    run, results, tmp_path, monkeypatch
):
    seen = run.session.observation(0)
    first, odd, last = seen.silhouettes
    odd = replace(odd, mask=np.roll(odd.mask, 200))
    other = replace(seen, silhouettes=(first, odd, last))
    monkeypatch.setattr(run.session, "observation", lambda *_, **__: other)
    assert not recorded(run, tmp_path, results[0]).problem
    path = tmp_path / "run.rrd"
    assert not scalars(path, "/overlap/cam1")
    assert np.median(picture(path, "/cameras/cam2/residual")[last.mask > 0.99]) > 200, "white"


@pytest.mark.parametrize("live", [True, False])
def test_pictures_are_dropped_before_a_viewer_alone_and_numbers_are_not(
    run, results, tmp_path, monkeypatch, live
):
    gate = threading.Event()
    pictures = residual_recorder._Painter.pictures

    def slow(painter, params):
        gate.wait()
        return pictures(painter, params)

    monkeypatch.setattr(residual_recorder._Painter, "pictures", slow)
    seen = run.session.observation(0)
    monkeypatch.setattr(run.session, "observation", lambda *_, **__: seen)
    path = tmp_path / "run.rrd"
    recorder = ResidualRecorder(run, path=path)
    recorder._live = live
    for frame in range(40):  # all of them come while the first one is painted
        recorder.show(replace(results[0], frame=frame))
    gate.set()
    recorder.close()
    assert recorder.problem == ""
    assert sorted(scalars(path, "/energy/total")) == list(range(40))
    painted = sum(batch.num_rows for batch in chunks(path, "/cameras/cam0/residual"))
    assert (recorder.without_pictures > 20) if live else (recorder.without_pictures == 0)
    assert painted == 40 - recorder.without_pictures


def test_the_command_records_and_says_where(run, tmp_path, handtrack):
    path = tmp_path / "residuals" / "run.rrd"
    out = tmp_path / "poses.npz"
    words = ["track", run.session.folder, "--out", out, "--rerun-save", path, "--rerun-frame", 1]
    ended = handtrack.does(*words)
    assert str(path) in ended.err
    assert sorted(scalars(path, "/energy/total")) == list(FRAMES)
    assert scalars(path, "/closely/frame_1/energy/total", "iteration")


def test_a_failure_while_painting_is_told(run, results, tmp_path, monkeypatch):
    def fail(*_):
        raise ValueError("no paint")

    monkeypatch.setattr(residual_recorder._Painter, "pictures", fail)
    told = recorded(run, tmp_path, *results).problem
    assert told == "recording residuals stopped: no paint"


def drawn(path, entity):
    """Return the places and packed colours of points."""
    (batch,) = chunks(path, entity)
    return (np.array(batch.column(f"Points3D:{of}")[0].as_py()) for of in ("positions", "colors"))


def signed(colours):
    """Return the values that colours of a residual stand for; NaN where nothing was measured."""
    red, fade, blue = np.moveaxis(colours.astype(float), -1, 0)
    value = np.where(red >= blue, 1.0, -1.0) * (1.0 - fade / 255.0)
    return np.where((red == fade) & (fade == blue) & (red < 255), np.nan, value)


def test_what_is_left_of_a_cloud_is_in_the_images_and_in_space(tmp_path):
    """Signed distances at the points' pixels; and the model where the cloud is empty."""
    run = TrackingRun.open(Session.open(cloudy_session(tmp_path)), {"model.fit_size": False})
    model, camera = run.model, run.session.rig.cameras[0]
    result = next(iter(run.track(range(1), *run.initial())))
    moved = result.parameters.copy()
    moved[model.parameter_names.index("index_mcp_flex")] -= 0.5  # away from its points
    assert not recorded(run, tmp_path, replace(result, parameters=moved)).problem
    bones = model.bones(model.transform.solver_params(moved))
    points, packed = drawn(tmp_path / "run.rrd", "/world/residual_cloud")
    found = signed(np.stack([packed >> 24, packed >> 16 & 255, packed >> 8 & 255], axis=1))
    distance = fitted_surface(model, run.settings.cloud).distance(bones, points)
    full = 3e-3 * run.settings.cloud.sigma_mm
    assert_allclose(found, np.clip(distance / full, -1, 1), atol=0.01)
    assert found.max() == 1.0 and np.median(np.abs(found)) < 0.3

    shown = signed(picture(tmp_path / "run.rrd", f"/cameras/{camera.name}/residual_cloud"))
    u, v = np.rint(camera.project(points)).astype(int).T
    inside = (u >= 0) & (v >= 0) & (u < camera.size[0]) & (v < camera.size[1])
    at = np.abs(shown[v[inside], u[inside]])
    assert (at >= np.abs(found[inside]) - 0.01).all()  # of several in one place the largest
    assert np.isnan(shown).mean() > 0.2

    places, packed = drawn(tmp_path / "run.rrd", "/world/residual_empty")
    empty = (packed >> 24) < 10  # as blue as can be
    tip = model.joint_positions(bones)[model.joint_names.index("index_tip")]
    near = np.linalg.norm(places - tip, axis=1) < 0.015
    assert empty[near].mean() > 0.9 > 0.2 > empty.mean()


def test_refined_frames_reach_rerun_too(tmp_path, monkeypatch):
    shown = []
    monkeypatch.setattr(
        LiveRecorder, "show", lambda _, __, one: shown.append((one.frame, one.parameters.tolist()))
    )
    monkeypatch.setattr(LiveRecorder, "open", lambda recorder: setattr(recorder, "is_on", True))
    for worker, listener in a_desk(tmp_path, step_s=0.0, refined_by=0.3):
        worker.engine.open_rerun()
        worker.engine.track(0, 12, 3, anew=True)
        listener.told("Tracking finished")
        results = worker.document.results
        refined = [(frame, one.parameters.tolist()) for frame, one in results.items()]
        eventually(lambda wanted=refined: shown[-12:] == wanted)
