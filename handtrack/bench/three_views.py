"""The scene of the silhouette benchmarks: a relaxed hand before three cameras, and a start that is off."""

from __future__ import annotations

import numpy as np

from handtrack.arrays import Floats, P, array_dataclass
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.model_file import load_model
from handtrack.observation.observation import Silhouette
from handtrack.simulation.scenes.simulated_views import mask_views
from handtrack.simulation.simulate import simulated_rig
from handtrack.solver.problem import Problem
from handtrack.terms.silhouettes.outline_overlap import outline_overlap
from handtrack.terms.silhouettes.prepared_silhouette import PreparedSilhouette, prepare
from handtrack.terms.silhouettes.silhouette_terms import CoverageTerm, rows_apart

WIDE_PX = 6.0
"""the widest band of the schedule is the slowest: spans are longest and overlap most"""


@array_dataclass
class ThreeViews:
    """Silhouettes of the true pose, and a start about 5 mm and 5° an angle beside it."""

    model: ArticulatedModel
    silhouettes: tuple[Silhouette, ...]
    start: Floats[P]

    @classmethod
    def of(cls, size: tuple[int, int] = (640, 480), cameras: int = 3) -> ThreeViews:
        """Return the scene with images of that width and height; growth is measured with more cameras, too."""
        model = load_model()
        truth = model.rest_params()
        truth[1] -= 0.09  # the hand's middle to the world's origin, where the cameras look
        rig = simulated_rig(cameras, size, 0.4).cameras
        off = np.random.default_rng(1).normal(size=len(truth))
        off *= np.where(np.arange(len(off)) < 3, 0.005, np.deg2rad(5.0))  # [m], [rad]
        seen = tuple(mask_views(model, truth, rig).silhouettes)
        return cls(model, seen, model.clipped(truth + off))

    def prepared(self) -> list[PreparedSilhouette]:
        """Return the silhouettes made ready for a term."""
        return [prepare(silhouette) for silhouette in self.silhouettes]

    def problem(
        self, seen: list[PreparedSilhouette], band_px: float = WIDE_PX, all_rows: bool = False
    ) -> Problem:
        """Return the problem at the start: coverage, no priors, rows as far apart as in tracking unless all are asked for."""
        ellipsoids, bones = self.model.ellipsoids["fine"], self.model.bones(self.start)
        steps = () if all_rows else rows_apart([band_px] * len(seen))
        return Problem(
            self.model, [CoverageTerm(seen, ellipsoids, band_px, bones, row_steps=steps)]
        )

    def rows(self) -> int:
        """Return how many pixels the model covers: the rows of the Jacobian that BLAS is given."""
        ellipsoids, bones = self.model.ellipsoids["fine"], self.model.bones(self.start)
        return int(outline_overlap(self.prepared(), ellipsoids, bones).model.sum())
