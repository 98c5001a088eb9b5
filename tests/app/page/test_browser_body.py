"""A body in a real browser, by mouse and keys alone: tracked, a limb pulled in a camera's picture, accepted, exported."""

import numpy as np
import pytest

from handtrack.export.registry import export_format
from handtrack.simulation.simulate import Simulation, simulate
from handtrack_app.page.panels.export import card_words
from tests.app.desk import in_threads
from tests.app.page.test_browser import browsing, stands
from tests.app.waiting import eventually
from tests.experiments.workbench.chromium import PROJECT

pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
_FRAMES = 3


@pytest.mark.browser
def test_a_body_is_tracked_corrected_accepted_and_exported_by_mouse(tmp_path):
    what = Simulation(
        cameras=2, frames=_FRAMES, size=(160, 120), motion="greet", model="body34", distance_m=3.5, images=False
    )  # fmt: skip
    bench = in_threads(simulate(tmp_path / "greet", what))
    with browsing(bench) as view:
        page, stage, review = view.page, bench.stage, bench.layout.review
        progress = bench.layout.tracking
        view.show_tab("Track")
        view.press("Track all frames")
        strip = bench.layout.timeline
        eventually(
            lambda: strip.strip is not None and (strip.strip.status >= 0).all(), "all are tracked"
        )
        eventually(lambda: progress.progress.state == "idle", "it is done")

        page.mouse.click(640, 560)  # of the scene: keys go there
        page.keyboard.press("1")
        eventually(lambda: stands(bench), "it looks through the first camera")
        pose, session = stage.pose, stage.session
        ends = [session.joint_names.index(f"{side}_{end}") for side in ("left", "right") for end in ("wrist", "ankle")]  # fmt: skip
        page.wait_for_timeout(1000)  # the picture comes to rest

        def at(place):
            return np.array(page.evaluate(PROJECT, ["/hand", place.tolist()]))

        # nothing stands before the end that is farthest from the trunk
        held = max(ends, key=lambda end: np.linalg.norm(at(pose.joints[end]) - at(pose.middle)))
        before = pose.joints[held].copy()
        for _ in range(3):  # a loaded machine may turn the camera too late for the pointer
            x, y = (float(v) for v in at(pose.joints[held]))
            view.drag((x, y), (x, y - 25.0))
            page.wait_for_timeout(500)
            if stage.pose is not None and stage.pose.origin == "pinned":
                break
        eventually(lambda: stage.pose is not None and stage.pose.origin == "pinned", "it is pinned")
        pin = stage.pose.pins[0]
        assert session.joint_names[held].split("_")[0] in pin.words
        assert pin.camera == "cam0"
        eventually(
            lambda: np.linalg.norm(stage.pose.joints[held] - before) > 0.02,  # type: ignore[union-attr]
            "it follows",
        )

        frame = bench.state.frame
        page.keyboard.press("Shift+Y")
        eventually(
            lambda: review.strip is not None and frame in review.strip.accepted, "it is accepted"
        )
        view.show_tab("Export")
        with page.expect_download() as download:
            view.press(card_words(export_format("csv")))
        target = tmp_path / "angles.csv"
        download.value.save_as(target)
        lines = target.read_text(encoding="utf-8").splitlines()
        rows = [line for line in lines if line[:1].isdigit()]
        assert len(rows) == _FRAMES
        assert any("left_elbow_flex" in line for line in lines)
