"""One pass over the frames, or two: what is tracked is shown at the terminal, recorded and kept."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from handtrack.errors import HandtrackError
from handtrack.session.run import TrackingRun
from handtrack.tracking.frame.control import Control
from handtrack.tracking.frame.result import FrameResult
from handtrack.tracking.search.engine import SearchReport
from handtrack.tracking.whole.refinement import Refinement
from handtrack_app.commands.terminal.progress import Stop, progress_bar, say, share_bar
from handtrack_app.commands.terminal.tracked_take import TrackedTake
from handtrack_app.rerun.recorder import ResidualRecorder


class TrackingPasses:
    """Each pass is a take of its own, which goes on where an earlier run of the same command left it."""

    def __init__(
        self,
        stop: Stop,
        take: TrackedTake,
        recorder: ResidualRecorder | None = None,
        on_search: Callable[[SearchReport], None] | None = None,
    ) -> None:
        self._stop, self._take, self._recorder = stop, take, recorder
        self.refinement: str | None = None
        """what was found that the frames of the latest pass share; None where they were not refined"""
        control = Control(stop, on_search=on_search, on_step=take.add)
        self._control = control if recorder is None else recorder.watching(control)

    def track(self, run: TrackingRun, frames: range) -> tuple[list[FrameResult], str]:
        """Return the frames that were tracked before the end, before the user stopped it, or before input that cannot be
        used, and what was wrong with that.
        """
        stop, take = self._stop, self._take
        done = take.begin(run, frames)
        start_frame, start = run.initial()
        results = {step.result.frame: step.result for step in done if step.result.frame in frames}
        problem, known = "", run.session.known_frames
        self.refinement = None
        with progress_bar(len(frames), "tracking") as bar, share_bar("refining") as refining:
            bar.update(len(results))

            def shared(text: str) -> None:
                self.refinement, scale = text, Refinement.read(text).scale
                refined_run = run if scale is None else run.with_scale(scale)
                take.refined_with(replace(refined_run.labels, refinement=text))
                if self._recorder is not None and scale is not None:
                    self._recorder.go_on_with(refined_run)

            control = replace(self._control, on_refined=lambda s: refining(s, ""), on_shared=shared)
            try:
                for result in run.track_with(control, frames, start_frame, start, done):
                    before = results.get(result.frame)
                    if before is result:
                        continue  # nothing is better known of it
                    results[result.frame] = result
                    if before is not None:
                        take.replace(result)
                    if self._recorder is not None:
                        self._recorder.show(result)
                    bar.update(before is None)
                    if run.session.known_frames != known:
                        break  # videos are counted by now, and have not as many frames as they announce
            except KeyboardInterrupt:  # a second Ctrl-C, in the middle of a frame
                stop.asked = True
            except HandtrackError as error:
                if not results:
                    raise
                problem = str(error)
            stop.shielded = True  # from here on it is saved
        return list(results.values()), problem

    def track_again(
        self, run: TrackingRun, before: list[FrameResult], frames: range
    ) -> tuple[TrackingRun, list[FrameResult]]:
        """Return the run for the size that explains the tracked frames best, and what tracking again gave; what was there
        before, where that was not finished.
        """
        stop = self._stop
        stop.shielded = False
        what = run.model.kind
        say(f"fitting the {what}'s size to the {len(before)} frames that were tracked …")
        with share_bar("sizing") as tell:
            sized = run.fit_size(stop, tell=tell, tracked=before)
        if stop():
            say(f"note: the {what}'s size is not fitted.")
            return run, before
        if sized is run:
            say(
                f"note: no frame was seen well enough to tell the {what}'s size; it stays as it is."
            )
            return run, before
        old, new = run.scale.overall, sized.scale.overall
        say(
            f"the {what} is {new:.3f} of a mean adult's, not {old:.3f}; tracking again from the first pose …"
        )
        return self._again(run, sized, before, frames, f"the result is of a {what} of {old:.3f}")

    def with_arm_of_all(
        self, run: TrackingRun, before: list[FrameResult], frames: range
    ) -> tuple[TrackingRun, list[FrameResult]]:
        """Return the run with the forearm that all tracked frames show, and what tracking again gave, where that is not the one
        of the first pose; else what was there before.
        """
        scale = Refinement.read(self.refinement).scale if self.refinement else None
        known = run if scale is None else run.with_scale(scale)
        other = known.with_arm_of(before)
        if other is known:
            return run, before
        end = (
            "" if np.isinf(other.arm_m) else f" that ends {100 * other.arm_m:.0f} cm from the wrist"
        )
        shown = f"a forearm{end}" if other.forearm else "no forearm"
        say(
            f"masks of all frames show {shown}, not what those of the first did; tracking again from the first pose …"
        )
        return self._again(run, other, before, frames, "the forearm is as in the first frame")

    def _again(
        self,
        run: TrackingRun,
        other: TrackingRun,
        before: list[FrameResult],
        frames: range,
        stays: str,
    ) -> tuple[TrackingRun, list[FrameResult]]:
        """Return the other run and what tracking by it gave; what was there before, where that was not finished."""
        if self._recorder is not None:
            self._recorder.go_on_with(other)
        found = self.refinement
        results, problem = self.track(other, frames)
        if self._stop() or problem:
            self._take.leave_pass()
            self.refinement = found
            say(f"note: tracking again was not finished; {stays}.")
            return run, before
        return other, results
