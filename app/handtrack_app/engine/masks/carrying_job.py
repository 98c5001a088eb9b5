"""Carries a frame's corrected masks on to the frames beside, on a thread of its own."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from handtrack.capture.masks.mask_correction import carried
from handtrack.errors import HandtrackError
from handtrack.session.session_state import Correction
from handtrack.session.sources.corrected_masks import encoded
from handtrack.session.sources.views import View
from handtrack_app.engine.jobs import BackgroundJob, Carried, Report


class CarryingJob(BackgroundJob):
    """Follows what was painted by optical flow, frame by frame, up to frames that were painted themselves."""

    kind = "carrying"

    def __init__(
        self,
        number: int,
        views: Sequence[View],
        frame: int,
        frames: range,
        is_painted: Callable[[str, int], bool],
        post: Callable[[Report], None],
    ) -> None:
        """frames: as far as it is carried, `frame` among them. is_painted: whether a camera's own frame was corrected by hand."""
        super().__init__(number, range(0), post)
        self._views, self._frame, self._reach = views, frame, frames
        self._is_painted = is_painted

    def work(self) -> None:
        found: dict[tuple[str, int], Correction] = {}
        reach, first = self._reach, self._frame
        ways = (range(first + 1, reach.stop), range(first - 1, reach.start - 1, -1))
        total = max(len(self._views) * sum(map(len, ways)), 1)
        done = 0
        for view in self._views:
            for way in ways:
                for at, correction in self._carried(view, way):
                    found[at] = correction
                    done += 1
                    self.show_progress(
                        min(done / total, 0.99), f"carrying the correction of {view.name}"
                    )
                    if self.should_stop():
                        return
        if not found:
            raise HandtrackError(
                "There is nothing to carry: no camera is corrected in this frame and has images of the frames beside, or those "
                "are corrected themselves."
            )
        self.report(Carried(found))

    def _carried(self, view: View, way: range) -> Iterator[tuple[tuple[str, int], Correction]]:
        own = view.own_frame(self._frame)
        layer = None if own is None else view.corrections.layer(own)
        before = view.image(self._frame)
        for frame in way:
            own, image = view.own_frame(frame), view.image(frame)
            if layer is None or before is None or image is None or own is None:
                return
            if self._is_painted(view.name, own):
                return
            layer, before = carried(layer, before, image), image
            content = encoded(layer)
            if content is None:
                return
            yield (view.name, own), Correction(content, carried=True)
