"""Clouds in the workbench: shown only where wanted, filtered live with counts, settings kept and saved."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from handtrack.capture.clouds.cloud_filters import FilterReport
from handtrack.errors import HandtrackError
from handtrack.geometry.rotation import quaternion_wxyz, rotation_matrix
from handtrack.model.model_file import load_model
from handtrack.model.surfaces.metaballs import MetaballSurface
from handtrack.session.clouds_settings import CloudSettings
from handtrack.tracking.frame.reason import Reason
from handtrack.tracking.frame.result import Status
from handtrack_app.engine.job_control import JobControl, Outcome, summary
from handtrack_app.engine.opening import open_document
from handtrack_app.engine.pictures.cloud_service import CloudRenderer, CloudService, nothing_left
from handtrack_app.engine.pictures.render_thread import RenderThread
from handtrack_app.engine.store import edits
from handtrack_app.engine.store.persistence import Persistence
from handtrack_app.engine.worker import Worker
from handtrack_app.page.panels.cloud_filters import CROP, STEREO, THIN
from handtrack_app.page.scene.camera_view import pixel_box
from handtrack_app.protocol import snapshots
from handtrack_app.protocol.palette import residual_colours
from handtrack_app.protocol.snapshots import FilterCount
from handtrack_app.workbench import Workbench
from tests.app.cloudy_session import BOX, HAND, SETTINGS, SKIN, WALL, cloudy_session, start
from tests.app.engine.test_worker import Listener
from tests.app.opened import show_results
from tests.app.page.test_workbench import follows_the_slider
from tests.app.waiting import eventually
from tests.app.wire import WireClient

Desk = tuple[Worker, Listener, Path]


@pytest.fixture
def desk(tmp_path: Path) -> Iterator[Desk]:
    """A worker with the recording open; its clouds are wanted."""
    listener = Listener()
    worker = Worker(cloudy_session(tmp_path), listener.publish, open_document)
    worker.start()
    listener.wait(snapshots.ProgressSnapshot, lambda p: p.state in ("idle", "failed"))
    yield worker, listener, tmp_path
    worker.stop()


def count(cloud: snapshots.CloudSnapshot, name: str) -> FilterCount:
    return next(c for c in cloud.counts if c.name == name)


def test_nothing_is_made_that_nobody_wants(desk: Desk) -> None:
    worker, listener, _ = desk
    worker.engine.show_frame(1)
    listener.wait(snapshots.PoseSnapshot, lambda p: p.frame == 1)
    worker.engine.want_surface(True)
    listener.wait(snapshots.SurfaceSnapshot)
    kinds = {type(s) for s in listener.seen}
    assert not kinds & {snapshots.CloudSnapshot, snapshots.CloudPicture}


def test_a_cloud_is_what_the_tracker_gets_with_its_distance_to_the_hand(desk: Desk) -> None:
    worker, listener, _ = desk
    worker.engine.want_cloud(snapshots.CloudSelection(points=True, dropped=True))
    cloud = listener.wait(snapshots.CloudSnapshot)
    document = worker.document
    assert document is not None
    bones = document.model.bones(document.model.transform.solver_params(document.shown))
    seen = document.run.observation(0, bones)
    assert seen.cloud is not None
    np.testing.assert_allclose(cloud.points, seen.cloud.points, atol=1e-6)
    assert np.abs(cloud.residual_mm).max() < 0.1  # the cloud was taken from this very surface
    assert cloud.measured == HAND + WALL
    dropped = {c.name: c.before - c.after for c in cloud.counts}
    assert dropped["crop"] == WALL
    assert len(cloud.dropped) == WALL + dropped["outliers"]
    assert (cloud.colors == np.uint8(SKIN)).all()


def test_the_distance_follows_the_pose(desk: Desk) -> None:
    worker, listener, _ = desk
    worker.engine.want_cloud(snapshots.CloudSelection(points=True))
    listener.wait(snapshots.CloudSnapshot)
    pose = listener.wait(snapshots.PoseSnapshot)
    values = pose.values.copy()
    values[2] += 0.004
    worker.engine.set_pose(0, tuple(values.tolist()), 1)
    moved = listener.wait(snapshots.CloudSnapshot, lambda c: np.abs(c.residual_mm).max() > 3.0)
    assert 3.5 < np.quantile(np.abs(moved.residual_mm), 0.95) < 4.5


def test_filters_are_live_with_counts(desk: Desk) -> None:
    worker, listener, _ = desk
    worker.engine.want_cloud(snapshots.CloudSelection(points=True))
    first = listener.wait(snapshots.CloudSnapshot)
    worker.engine.set_clouds(
        {
            "crop_m": False,
            "voxel_m": 0.008,
        }
    )
    second = listener.wait(
        snapshots.CloudSnapshot, lambda c: count(c, "voxel").text.endswith("8 mm")
    )
    assert all(c.name != "crop" for c in second.counts)
    assert count(second, "voxel").before == HAND + WALL
    assert second.left < first.left
    card = listener.wait(snapshots.CloudCard, lambda c: c.values["crop_m"] is None)
    assert set(card.unsaved) == {"crop_m", "voxel_m"}


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"crop": 0.1}, "no setting 'crop' in [clouds]"),
        ({"voxel_m": float("nan")}, "[clouds]: voxel_m = nan; expected a value of kind float."),
        (
            {"per_voxel": False},
            "[clouds]: per_voxel = false; expected a whole number of at least 1.",
        ),
        ({"near_m": 2.0, "far_m": 1.0}, "far_m = 1.0; expected more than near_m = 2."),
        ({"component": "hand"}, 'component = "hand"; expected one of all, nearest, largest'),
        ({"stereo_method": "guess"}, 'stereo_method = "guess"; expected one of sgbm, correlation'),
    ],
)
def test_a_setting_that_cannot_be_changes_nothing(values: dict[str, Any], words: str) -> None:
    with pytest.raises(HandtrackError) as error:
        CloudSettings(files="c/*.ply").with_values(values)
    assert words in str(error.value)


def test_settings_come_back_and_are_saved_with_the_file_kept(desk: Desk) -> None:
    worker, listener, folder = desk
    worker.engine.set_clouds(
        {
            "crop_m": 0.05,
            "outlier_neighbours": False,
        }
    )
    listener.wait(snapshots.CloudCard, lambda c: c.unsaved)
    worker.stop()
    assert (folder / "session.toml").read_text() == SETTINGS

    again = Listener()
    worker = Worker(folder, again.publish, open_document)
    worker.start()
    card = again.wait(snapshots.CloudCard)
    assert (card.values["crop_m"], card.values["outlier_neighbours"]) == (0.05, None)
    worker.engine.save_clouds()
    said = again.wait(snapshots.Notice, lambda n: n.title == "Clouds' settings saved")
    assert "crop_m, outlier_neighbours" in said.text
    text = (folder / "session.toml").read_text()
    assert text == SETTINGS + "crop_m = 0.05\noutlier_neighbours = false\n"
    assert tomllib.loads(text)["clouds"]["voxel_m"] == 0.003
    (kept,) = (folder / "versions").iterdir()
    assert kept.read_text() == SETTINGS
    worker.engine.set_clouds(
        {
            "crop_m": 0.2,
        }
    )
    again.wait(snapshots.CloudCard, lambda c: c.unsaved == ("crop_m",))
    worker.engine.restore_clouds()
    again.wait(snapshots.CloudCard, lambda c: not c.unsaved and c.values["crop_m"] == 0.05)
    worker.stop()
    assert not open_document(folder, {}).unsaved_clouds


def test_the_skins_colour_is_taken_from_a_box(desk: Desk) -> None:
    worker, listener, _ = desk
    worker.engine.set_clouds(
        {
            "crop_m": False,
        }
    )
    worker.engine.want_cloud(snapshots.CloudSelection(points=True))
    worker.engine.sample_skin(0, "cam0", BOX, 3.0)
    cloud = listener.wait(
        snapshots.CloudSnapshot, lambda c: any(f.name == "skin" for f in c.counts)
    )
    assert count(cloud, "skin").after == HAND  # the wall is of another colour
    worker.engine.sample_skin(0, "cam0", (0, 0, 2, 2), 3.0)
    notice = listener.wait(snapshots.Notice, lambda n: n.level == "error")
    assert "at least 20 sampled pixels" in notice.text


def test_pictures_of_cameras_and_of_a_pair(desk: Desk) -> None:
    worker, listener, _ = desk
    worker.engine.want_cloud(snapshots.CloudSelection(picture="images"))
    plain = listener.wait(snapshots.CloudPicture)
    assert plain.image.shape[1:] == (620, 3)
    assert (plain.image == np.uint8([240, 228, 66])).all(axis=2).sum() > 300  # points that stay
    worker.engine.want_cloud(snapshots.CloudSelection(picture="stereo", wide=True))
    large = listener.wait(snapshots.CloudPicture, lambda p: p.wide)
    assert large.image.shape[1:] == (1240, 3)
    assert "pixels matched" in large.words
    assert not [s for s in listener.seen if isinstance(s, snapshots.CloudSnapshot)]


def test_the_surface_is_the_solvers(desk: Desk) -> None:
    worker, listener, _ = desk
    worker.engine.want_surface(True)
    mesh = listener.wait(snapshots.SurfaceSnapshot)
    model = load_model("hand26")
    off = MetaballSurface.of(model).distance(model.bones(start()), mesh.vertices.astype(float))
    assert np.quantile(np.abs(off), 0.99) < 2e-5
    assert mesh.faces.max() == len(mesh.vertices) - 1


def test_the_energys_parts_are_on_the_timeline_and_come_back(desk: Desk) -> None:
    worker, listener, folder = desk
    worker.engine.track(0, 2, 0)
    listener.wait(snapshots.Notice, lambda n: n.title == "Tracking finished", 60.0)
    strip = [s for s in listener.seen if isinstance(s, snapshots.TimelineSnapshot)][-1]
    assert {"cloud→model", "model→cloud", "priors"} <= set(strip.terms)
    total = np.sum([np.nan_to_num(part) for part in strip.terms.values()], axis=0)
    np.testing.assert_allclose(total[:2], strip.energy[:2], rtol=1e-6)
    worker.stop()
    again = Listener()
    second = Worker(folder, again.publish, open_document)
    second.start()
    back = again.wait(snapshots.TimelineSnapshot, lambda s: bool(s.terms))
    np.testing.assert_allclose(back.terms["cloud→model"], strip.terms["cloud→model"])
    second.stop()


def test_a_simpler_hand_is_said(desk: Desk) -> None:
    worker, listener, _ = desk
    worker.engine.track(0, 2, 0)
    listener.wait(snapshots.Notice, lambda n: n.title == "Tracking finished", 60.0)
    document = worker.document
    assert document is not None
    whole = document.results[1]
    reason = Reason("poor cloud", part="glove9", number=0.4, other=0.7)
    held = replace(whole, status=Status.DOUBTFUL, reason=reason)
    show_results(document, [held])
    worker.engine.show_frame(1)
    pose = listener.wait(snapshots.PoseSnapshot, lambda p: p.frame == 1 and p.note)
    assert pose.note.startswith("Fingers held. Poor cloud: 40 % of the hand in view was measured")
    assert "1 with the fingers fixed" in summary(
        [Outcome.of(r) for r in document.results.values()], 2, 0, 1.0
    )


@pytest.mark.parametrize("slider", [*CROP, *THIN, *STEREO], ids=lambda slider: slider.name)
def test_a_slider_says_what_the_file_says(slider: Any) -> None:
    low, high, step = slider.span
    for share in (0.2, 0.5, 0.9):
        shown = low + step * round(share * (high - low) / step)
        assert slider.on_page(slider.in_file(shown)) == pytest.approx(shown, abs=1e-6)
    if low == 0:
        assert slider.in_file(0.0) is False
    changed = CloudSettings(files="c/*").with_values({slider.name: slider.in_file(high)})
    assert math.isfinite(changed.given[slider.name])


def test_the_page_shows_the_cloud_and_a_slider_filters_it(page: Workbench) -> None:
    view, panel = page.stage.cloud, page.layout.cloud
    before = len(view.points.points)
    assert len(view.points.colors) == before
    with WireClient(page.url) as client:
        client.set_value(panel.filters.sliders.known["voxel_m"][1], 8.0)
        eventually(lambda: len(view.points.points) < before, "fewer points")
        eventually(lambda: "cells" in panel.counts.content, "counted")
        eventually(lambda: "voxel_m" in panel.saved.content, "told as not saved")
        client.set_value(panel.filters.sliders.known["voxel_m"][1], math.nan)
        client.set_value(panel.widgets["colour"], "plain")
        eventually(lambda: len(np.unique(view.points.colors, axis=0)) == 1, "plain")
        client.set_value(panel.widgets["on"], False)
        eventually(lambda: not view.points.visible, "hidden")


def test_a_cloud_that_is_no_more_is_gone(page: Workbench) -> None:
    document, view = page.worker.document, page.stage.cloud
    assert document is not None
    document.saved_clouds = None
    page.engine.restore_clouds()
    scene = page.layout.cloud.scene
    eventually(lambda: not view.points.visible and not scene.visible, "hidden")
    page.engine.set_clouds(
        {
            "stereo": (("cam0", "cam1"),),
        }
    )
    eventually(lambda: bool(scene.visible), "clouds of the pair")
    assert page.layout.cloud.card is not None
    assert page.layout.cloud.card.source == "stereo"


def test_the_surface_stands_where_the_ellipsoids_did(page: Workbench) -> None:
    stage = page.stage
    assert stage.hand is not None
    with WireClient(page.url) as client:
        client.set_value(page.layout.session.mode, "surface")
        eventually(lambda: stage.surface.visible and not stage.hand.flesh.visible, "the surface")
        page.page.play(True)
        eventually(lambda: stage.hand.flesh.visible and not stage.surface.visible, "in motion")
        page.page.play(False)
        eventually(lambda: stage.surface.visible, "the surface again")


def test_the_hand_follows_a_slider_with_cloud_and_surface(page: Workbench) -> None:
    page.state.display.mode = "Surface"
    page.redraw()
    follows_the_slider(page, 10)


def test_another_model_takes_the_hands_place(page: Workbench) -> None:
    with WireClient(page.url) as client:
        for place, (name, bones) in enumerate((("glove9", 3), ("ball6", 1), ("hand26", 25))):
            page.engine.set_setting("model.name", name)
            eventually(
                lambda bones=bones: (
                    page.stage.hand is not None and len(page.stage.hand.bone_length) == bones
                ),
                f"{name} has its bones",
            )
            eventually(
                lambda: set(page.layout.pose.sliders) == set(page.state.names), "and its sliders"
            )
            eventually(lambda: len(page.state.values) == len(page.state.names), "and its pose")
            version = page.state.version
            client.set_value(page.layout.pose.sliders["root_tx"], 5.0 + place)
            eventually(lambda version=version: page.state.version > version, "it can be posed")


def test_a_dragged_box_is_found_in_the_image() -> None:
    size, matrix = (96, 72), np.array([[150.0, 0, 47.5], [0, 150.0, 35.5], [0, 0, 1.0]])
    turn = rotation_matrix(np.array([0.3, -0.2, 0.1]))
    card = snapshots.CameraCard("cam0", size, matrix, turn, np.zeros(3))
    up = 0.5 * size[1] / 150.0 * 1.25  # the window sees more than the image, and looks the same way

    class View:
        fov, aspect = 2 * math.atan(up), 1.6
        wxyz = quaternion_wxyz(turn)

    def share(x: float, y: float) -> tuple[float, float]:
        return (
            0.5 + 0.5 * (x - 47.5) / 150.0 / (1.6 * up),
            0.5 + 0.5 * (y - 35.5) / 150.0 / up,
        )

    assert pixel_box(View, card, (share(40, 20), share(56, 40))) == (40, 20, 16, 20)
    assert pixel_box(View, card, ((0.0, 0.0), (1.0, 1.0))) == (0, 0, 96, 72)
    assert pixel_box(View, card, ((0.5, 0.5), (0.5, 0.5))) is None


def test_distances_are_told_by_colour() -> None:
    inside, on, outside, unknown = residual_colours(np.array([-20.0, 0.0, 20.0, np.nan])).tolist()
    assert inside[2] > inside[0]
    assert outside[0] > outside[2]
    assert max(on) - min(on) < 8
    assert unknown == on


def test_without_a_first_pose_the_hand_stands_in_the_cloud_and_crops_nothing(
    tmp_path: Path,
) -> None:
    folder = cloudy_session(tmp_path)
    (folder / "init.json").unlink()
    document = open_document(folder, {})
    cloud = document.run.session.cloud(0)[0]
    middle = np.median(cloud.points, axis=0)
    assert np.linalg.norm(document.start[:3] + [0.0, 0.09, 0.0] - middle) < 0.01
    store = Persistence(document, None)
    jobs = JobControl(document, store, lambda _: None, lambda _: None)
    desk = CloudService(
        document, store, jobs, RenderThread(lambda _: None), lambda _: None, lambda change: change()
    )
    assert desk._moment().previous is None
    unposed = CloudRenderer().cloud(desk._moment())
    assert all(c.name != "crop" for c in unposed.counts)
    assert unposed.words == "The hand has no place yet: nothing is cropped to it."
    document.apply(edits.pose(document, 0, document.shown.tolist()))
    assert count(CloudRenderer().cloud(desk._moment()), "crop").before == HAND + WALL


def test_the_filter_that_left_nothing_is_named() -> None:
    reports = (
        FilterReport("range", 50, 50, "0.1 to 1.5 m from a camera"),
        FilterReport("crop", 50, 0, "within 100 mm of the hand"),
        FilterReport("voxel", 0, 0, "1 in 3 mm"),
    )
    words = nothing_left(reports)
    assert words.startswith("No point is left: the filter 'within 100 mm of the hand' dropped")
    assert nothing_left(reports[2:]) == "Nothing was measured in this frame."
