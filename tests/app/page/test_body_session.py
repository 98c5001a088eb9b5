"""A session of a body in the workbench: its parts are drawn, its sliders stand by limb, its trunk moves the whole."""

import numpy as np

from handtrack.simulation.simulate import Simulation, simulate
from tests.app.desk import shown
from tests.app.waiting import eventually
from tests.app.wire import WireClient


def test_its_parts_stand_on_their_bones_and_a_slider_moves_a_limb(tmp_path):
    what = Simulation(
        cameras=2, frames=2, size=(96, 72), motion="still", model="body34", distance_m=3.5, images=False
    )  # fmt: skip
    with shown(simulate(tmp_path / "new", what)) as bench, WireClient(bench.url) as client:
        hand, document = bench.stage.hand, bench.worker.document
        places = lambda: np.array([part.position for part in hand.parts])  # noqa: E731
        bones = document.model.bones(document.model.transform.solver_params(document.start))
        assert bench.stage.session.stem_bones == ("pelvis", "spine")
        assert len(hand.parts) == len(document.model.superquadrics) == 19
        np.testing.assert_allclose(places(), bones.position[list(hand.part_bone)], atol=1e-6)
        assert all(part.visible for part in hand.parts) and not hand.ellipsoids.visible
        client.set_value(bench.layout.pose.sliders["left_knee_flex"], 90.0)
        foot = hand.part_bone.index(document.model.skeleton.bone("left_foot"))
        away = lambda: np.linalg.norm(places()[foot] - bones.position[hand.part_bone[foot]])  # noqa: E731
        eventually(lambda: away() > 0.3)
