"""The score of the pose that is shown, while somebody poses: found once there is time, and said with the pose that it is of."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

from handtrack.arrays import Floats, P
from handtrack.diagnostics.score import Score, score
from handtrack.session.posed_frames import solver_params_of
from handtrack.session.run import TrackingRun
from handtrack.tracking.frame.result import FrameResult
from handtrack_app.engine.document import Document
from handtrack_app.engine.document_snapshots import energy_parts
from handtrack_app.protocol.score import ScoreSnapshot
from handtrack_app.protocol.snapshots import Snapshot

_RESTS_S = 0.2  # a frame's masks are made for the score once it is looked at for so long
_FIRST_S = (
    2.0  # and what it is computed by is loaded, which takes seconds, once nobody is in a hurry
)


@dataclass
class LiveScore:
    """Lives on the worker's thread."""

    document: Document
    publish: Callable[[Snapshot], None]
    _since: float | None = None
    """when a pose was shown that has no score yet"""
    _frame: int | None = None
    """scored last: what was seen of it is at hand"""
    _fitted: tuple[FrameResult, TrackingRun, Score] | None = None
    """judged by the settings in force, as what is compared with it"""

    def shown(self) -> None:
        """Another pose is shown."""
        self._since = time.monotonic()

    @property
    def is_due(self) -> bool:
        """Whether there is a pose to score, and it may be done now."""
        if self._since is None or self.document.run.session.live is not None:
            return False
        at_hand = self._frame == self.document.frame
        rests_s = _FIRST_S if self._frame is None else _RESTS_S
        return at_hand or time.monotonic() - self._since > rests_s

    def tell(self) -> None:
        """Score the pose shown, and the one that was fitted to its frame last."""
        document, self._since = self.document, None
        self._frame = frame = document.frame
        params = solver_params_of(document.model, document.seen)
        now, result = self._score(frame, params), document.results.get(frame)
        if result is None or len(result.parameters) != len(document.shown):
            self._fitted = None
        elif self._fitted is None or self._fitted[:2] != (result, document.run):
            then = self._score(frame, solver_params_of(document.model, result.parameters))
            self._fitted = result, document.run, then
        fitted = None if self._fitted is None else self._fitted[2]
        self.publish(
            ScoreSnapshot(
                frame, tuple(document.seen.tolist()), now.overlap, dict(energy_parts(now.energy)),
                None if fitted is None else fitted.overlap,
                None if fitted is None else sum(fitted.energy.values()),
            )
        )  # fmt: skip

    def _score(self, frame: int, params: Floats[P]) -> Score:
        model, run = self.document.model, self.document.run
        seen = run.observation(frame, model.bones(params))
        return score(model, run.settings, seen, params)
