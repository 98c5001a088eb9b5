"""The visual hull: what all silhouettes agree on."""

import numpy as np

from handtrack import Silhouette, load_model
from handtrack.simulation.scenes.simulated_views import mask_views
from handtrack.simulation.simulate import simulated_rig
from handtrack.tracking.search.evidence.silhouette_evidence import visual_hull

MODEL = load_model()
PARAMS = MODEL.rest_params() + np.array([0.02, -0.09, 0.01, *[0.0] * 23])
SEEN = mask_views(MODEL, PARAMS, simulated_rig(3, (320, 240)).cameras).silhouettes
JOINTS = MODEL.joint_positions(MODEL.bones(PARAMS))


def nearest(points, to):
    return np.linalg.norm(points - to[:, None], axis=2).min(axis=1)


def test_the_hull_holds_the_hand_and_lies_in_every_mask():
    hull = visual_hull(SEEN)
    assert nearest(hull.centres, JOINTS).max() < 0.01, "every joint is in it"
    for silhouette in SEEN:
        row, column = np.nonzero(silhouette.mask)
        mask = np.stack([column, row], axis=1).astype(float)
        pixel = silhouette.camera.project(hull.centres)
        depth = silhouette.camera.to_camera(hull.centres)[:, 2]
        off = np.linalg.norm(pixel[:, None] - mask, axis=2).min(axis=1)
        half_cell = 0.5 * hull.side * silhouette.camera.matrix[0, 0] / depth
        assert (off <= half_cell + 1.0).all(), silhouette.camera.name  # a pixel of rounding
    palm = np.linalg.norm(hull.centres - JOINTS.mean(axis=0), axis=1).argmin()
    assert hull.depth[palm] > 0.008, "the palm is deep inside"


def test_empty_and_contradicting_masks_have_no_hull():
    assert len(visual_hull([]).centres) == 0
    nothing = [Silhouette(s.camera, np.zeros_like(s.mask), s.valid) for s in SEEN]
    assert len(visual_hull(nothing).centres) == 0
    row = np.zeros_like(SEEN[0].mask)
    row[:8, :8] = 1.0  # a corner that sees past everything the others see
    corner = Silhouette(SEEN[0].camera, row, SEEN[0].valid)
    assert len(visual_hull([corner, *SEEN[1:]]).centres) == 0
