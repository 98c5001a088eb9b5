"""The energy's parts on the timeline."""

from dataclasses import replace

import numpy as np

from handtrack_app.engine.document_snapshots import timeline_snapshot
from tests.app.fake_run import fake_document
from tests.app.opened import show_results


def test_parts_with_the_same_words_are_summed(tmp_path):
    document = fake_document(tmp_path)
    (result,) = document.run.track(range(4, 5), 4, document.model.rest_params())
    costs = {"cloud_rays": 3.0, "rest": 1.0, "motion": 0.5}
    show_results(document, [replace(result, energies=costs)])
    parts = timeline_snapshot(document).terms
    assert set(parts) == {"lines of sight", "priors"}
    np.testing.assert_array_equal(parts["lines of sight"][3:6], [np.nan, 3.0, np.nan])
    np.testing.assert_array_equal(parts["priors"][3:6], [np.nan, 1.5, np.nan])
