"""The workbench on loopback: handles follow the worker, clients' values are checked, and the hand moves at once."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np

from handtrack.geometry.rotation import matrix_from_quaternion
from handtrack_app.engine.document_snapshots import pose_snapshot
from handtrack_app.page.page import Display
from handtrack_app.page.scene.model_view import update_hand
from handtrack_app.protocol import snapshots
from tests.app.desk import shown
from tests.app.fake_run import FRAMES, fake_document
from tests.app.waiting import eventually
from tests.app.wire import WireClient


def test_ellipsoids_bones_and_cameras_are_turned_as_they_are_in_the_world(bench):
    document, stage = bench.worker.document, bench.stage
    bones = document.model.bones(document.model.transform.solver_params(document.start))
    posed = document.model.flesh["fine"].posed(bones)
    turned = matrix_from_quaternion(np.array(stage.hand.flesh.batched_wxyzs, float))
    np.testing.assert_allclose(turned, posed.rotation, atol=1e-6)
    for camera in document.run.session.rig.cameras:
        drawn = stage.cameras.frusta[camera.name]
        turned = matrix_from_quaternion(np.array(drawn.wxyz))
        np.testing.assert_allclose(turned, camera.rotation.T, atol=1e-6)
        np.testing.assert_allclose(drawn.position, camera.centre, atol=1e-6)
    drawn = SimpleNamespace(visible=True)
    view = replace(stage.hand, bones=drawn, joints=drawn)
    update_hand(view, pose_snapshot(document), Display())
    names = document.model.skeleton.bone_names
    ends = drawn.batched_positions[len(names) :]  # of each bone, after where it begins
    knuckle, next_one = names.index("index_proximal"), names.index("index_intermediate")
    np.testing.assert_allclose(ends[knuckle], bones.position[next_one], atol=1e-6)


def test_a_root_pose_beyond_reason_does_nothing_and_a_good_one_moves_the_hand(bench, wire):
    control = bench.stage.root.control
    for x in (1e6, 0.05):
        wire.send({
            "type": "TransformControlsUpdateMessage", "name": "/root",
            "wxyz": [1.0, 0.0, 0.0, 0.0], "position": [x, 0.0, 0.0],
        })  # fmt: skip
        eventually(lambda x=x: control.position[0] == x, "it came")
    eventually(
        lambda: abs(bench.layout.pose.sliders["root_tx"].value - 50.0) < 0.1, "the good one counts"
    )
    assert bench.state.version == 1


def test_the_hand_follows_a_slider_while_tracking(tmp_path):
    opener = lambda f: fake_document(f, stuck=lambda frame: frame == 4)  # noqa: E731
    with shown(tmp_path, opener=opener) as bench:
        bench.engine.track(0, FRAMES, 0)
        tracking = bench.layout.tracking
        eventually(lambda: tracking.progress.state == "tracking", "it is tracked")
        slider = bench.layout.pose.sliders["index_mcp_flex"]
        with WireClient(bench.url) as client:
            for k in range(10):
                sent = client.set_value(slider, 10.0 + 0.5 * k)
                came = client.wait_for(sent, "/hand/flesh", "batched_positions")
                assert came is not None, "the hand did not move"
        assert tracking.progress.state == "tracking"


def test_a_pose_that_comes_late_leads_nobody_back_to_its_frame(bench, monkeypatch):
    late, state, asked = bench.stage.pose, bench.state, list[Any]()
    monkeypatch.setattr(bench.worker, "send", asked.append)
    for frame in (5, 6):
        bench.go_to(frame)
    assert [call.arguments["frame"] for call in asked] == [5, 6]
    for frame, stands in ((late.frame, 6), (5, 6), (6, 6), (7, 7)):  # at last the engine leads on
        bench.page.show(replace(late, frame=frame))
        assert state.frame == stands


def test_a_page_that_comes_late_is_told_what_was_said(bench):
    """Fault C41."""
    bench._snapshots.put(snapshots.Notice("done", "Welcome back", "Restored: 3 poses."))
    eventually(lambda: "Welcome back" in bench.layout.messages.list.content, "said to nobody")
    with WireClient(bench.url) as wire:
        came = lambda: any("Welcome back" in str(message) for _, message in wire.messages)  # noqa: E731
        eventually(came, "told")
