"""A tracking at the terminal: bars of what goes on, and a recording for rerun."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack

import numpy as np

from handtrack.session.run import TrackingRun
from handtrack.session.takes.take_recorder import TakeRecorder
from handtrack.session.track_session import (
    Ended,
    Event,
    FramesRefined,
    FrameTracked,
    PassBegan,
    Progress,
    ProvisionalFrame,
    SizeFitted,
    Warned,
)
from handtrack.tracking.search.engine import SearchReport
from handtrack_app.commands.terminal.progress import Stop, progress_bar, say, share_bar
from handtrack_app.rerun.recorder import ResidualRecorder

_STAGES = {"size": "sizing", "refine": "refining"}


class Progressing:
    """A context in which the events of one tracking are shown."""

    def __init__(
        self, take: TakeRecorder, recorder: ResidualRecorder | None, reports: list[SearchReport]
    ) -> None:
        """reports: of searches, of which those of the last pass count."""
        self._take, self._recorder, self._reports = take, recorder, reports
        self._bars = ExitStack()
        self._stage = ""
        self._run: TrackingRun | None = None

    def __enter__(self) -> Progressing:
        return self

    def __exit__(self, *_: object) -> None:
        self._bars.close()

    def show(self, progress: Progress | ProvisionalFrame) -> None:
        """Show how far a stage without frames is."""
        if isinstance(progress, ProvisionalFrame):
            return
        if progress.stage != self._stage:
            self._bars.close()
            self._stage = progress.stage
            if progress.message:
                say(progress.message)
            self._tell = self._bars.enter_context(share_bar(_STAGES[progress.stage]))
        if progress.share > 0:
            self._tell(progress.share, progress.message)

    def follow(self, events: Iterator[Event], stop: Stop) -> tuple[Ended, list[str]]:
        """Follow a tracking to its end; return how it ended, and its warnings."""
        warnings = list[str]()
        for event in events:
            if isinstance(event, Warned):
                warnings.append(event.message)
            elif isinstance(event, Ended):
                return event, warnings
            try:
                self._show(event)
            except KeyboardInterrupt:  # a second Ctrl-C
                stop.asked = True
        raise AssertionError("the last event is Ended")

    def _show(self, event: Event) -> None:
        recorder = self._recorder
        match event:
            case PassBegan():
                self._run = event.run
                self._reports.clear()
                self._stage = ""
                self._bars.close()
                if event.resumed:
                    words = f"resuming at frame {len(event.resumed)} of {len(event.frames)}"
                    say(f"{words} (take {self._take.number}; --restart begins anew)")
                if recorder is not None:
                    recorder.go_on_with(event.run)
                self._bar = self._bars.enter_context(progress_bar(len(event.frames), "tracking"))
                self._bar.update(len(event.resumed))
            case FrameTracked():
                if recorder is not None:
                    recorder.show(event.result)
                self._bar.update(1)
            case FramesRefined() if recorder is not None:
                recorder.go_on_with(event.run)
                for result in event.results:
                    recorder.show(result)
            case SizeFitted():
                self._bars.close()
                say(_size_words(event, self._run))
            case _:
                pass


def _size_words(event: SizeFitted, before: TrackingRun | None) -> str:
    """Return what was found of the hand, and what follows."""
    run = event.run
    if before is None or not event.after_tracking:
        return f"the {run.model.kind} is {run.scale.overall:.3f} times a mean adult's."
    if run is before:
        return f"note: no frame measures the {run.model.kind}'s size well enough; it is unchanged."
    if run.arm != before.arm:
        end = "" if np.isinf(run.arm_m) else f" that ends {100 * run.arm_m:.0f} cm from the wrist"
        shown = f"a forearm{end}" if run.forearm else "no forearm"
        return f"masks of all frames show {shown}, not what those of the first did; tracking again from the first pose …"
    old, new = before.scale.overall, run.scale.overall
    return f"the {run.model.kind} is {new:.3f} of a mean adult's, not {old:.3f}; tracking again from the first pose …"
