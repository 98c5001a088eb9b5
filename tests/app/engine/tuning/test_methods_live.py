"""The method as one change of the session's state: what it sets, undo, the way back, opening again; distance and β of the surface."""

import pytest

from handtrack import TrackerSettings
from handtrack.session.session_state import decide
from handtrack.tracking.frame.methods import METHODS
from handtrack_app.engine.store import edits
from handtrack_app.engine.store.persistence import Persistence
from handtrack_app.page.panels.settings import to_be_said
from tests.app.fake_run import fake_document
from tests.app.opened import did, opened
from tests.app.waiting import eventually

PAPERS = [name for name in METHODS if name != "default"]


@pytest.fixture
def store(tmp_path):
    """A user had changed two settings, of which the papers' methods set one to what it is then."""
    store = opened(tmp_path)
    did(store, decide(setting={"keypoints.weight": 0.0}))
    did(store, decide(setting={"edges.sigma_px": 3.0}))
    return store


@pytest.mark.parametrize("name", PAPERS)
def test_a_method_sets_all_that_it_has_and_undo_takes_all_back(store, name):
    document = store.document
    before = document.run.settings
    did(store, edits.method(document, name))
    now = document.run.settings
    assert (now.method, now.traits) == (name, METHODS[name].traits)
    assert METHODS[name].values.items() <= now.flat().items()
    assert now.edges.sigma_px == 3.0  # no method says it
    store.undo()
    assert document.run.settings == before


def test_what_is_changed_beside_a_method_holds_when_the_session_opens_again(
    store,
):
    did(store, edits.method(store.document, "paper2004"))
    did(store, decide(setting={"cloud.crop_mm": 40.0}))
    again = Persistence.open(fake_document(store.folder))
    again.restore()
    assert again.document.run.settings == store.document.run.settings
    assert again.document.run.settings.cloud.crop_mm == 40.0


def test_the_command_line_is_told_no_more_than_it_needs(store):
    document = store.document
    own = document.own_settings
    did(store, edits.method(document, "paper2004"))
    did(store, decide(setting={"solver.iterations": 20}))
    said = to_be_said(document.run.settings.flat(), own)
    assert said == {"method": "paper2004", "edges.sigma_px": 3.0, "solver.iterations": 20}
    assert TrackerSettings().with_values(said) == document.run.settings


def test_experts_choose_method_distance_and_sharpness_on_the_page(bench, wire):
    panel, run = bench.layout.settings, lambda: bench.worker.document.run.settings
    method, distance, sharpness = (
        panel.controls[name].widget
        for name in ("method", "cloud.distance", "cloud.sharpness_per_mm")
    )
    wire.set_value(distance, "d1, by the level")
    wire.set_value(sharpness, 0.5)
    eventually(lambda: run().cloud.sharpness_per_mm == 0.5, "β is in force")
    assert run().cloud.distance == "d1"
    eventually(lambda: "least radius" in panel.told["cloud.distance"].content, "it is told")
    wire.set_value(method, "2007, conic fields")
    eventually(lambda: run().silhouettes.term == "conic_field", "the method is in force")
    eventually(lambda: METHODS["paper2007"].words in panel.told["method"].content, "told")
    eventually(lambda: panel.controls["solver.iterations"].widget.value == 10, "what it set shows")
    assert run().cloud.distance == "d1"  # no method says it
