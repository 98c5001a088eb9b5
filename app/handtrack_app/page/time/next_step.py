"""The one next step of the work, as a sentence and a button over the timeline: detect, track, go on, review, export."""

from __future__ import annotations

import html
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import viser

from handtrack_app.page.page import Page, UserEvent, put
from handtrack_app.page.panels.guesses import GuessesPanel
from handtrack_app.page.panels.tracking import Order, TrackingPanel
from handtrack_app.page.time.review import ReviewPanel
from handtrack_app.protocol.timeline import TakeSpan, TimelineSnapshot


@dataclass(frozen=True)
class Step:
    """What is to be done next."""

    words: str
    """plain; empty where the button says it all"""
    label: str
    act: Callable[[viser.ClientHandle | None], None]


@dataclass
class NextStep:
    """Its widgets, built where the page builds now."""

    page: Page
    tracking: TrackingPanel
    guesses: GuessesPanel
    review: ReviewPanel
    step: Step | None = None

    def __post_init__(self) -> None:
        gui = self.page.gui
        self.words = gui.add_html("", visible=False)
        self.button = gui.add_button("Next", visible=False)
        self.page.on(self.button, self._press)

    def _press(self, event: UserEvent) -> None:
        if self.step is not None:
            self.step.act(event.client)

    def show(self) -> None:
        """Offer the step that the recording's state calls for; none while something runs."""
        strip, idle = self.tracking.strip, self.tracking.progress.state == "idle"
        session = self.tracking.session
        self.step = step = None
        if strip is not None and session is not None and idle and not session.live:
            self.step = step = self._of(strip, bool(session.seen))
        if step is not None:
            kind = "" if step.words else "handtrack-aside"
            put(
                self.words,
                content=f"<div class='handtrack-next {kind}'>{html.escape(step.words)}</div>",
            )
            put(self.button, label=step.label)
        put(self.words, visible=step is not None)
        put(self.button, visible=step is not None)

    def _of(self, strip: TimelineSnapshot, has_views: bool) -> Step | None:
        say, tracked = self.page.words.of, np.flatnonzero(strip.status >= 0)
        if strip.hidden:
            take = max(span.take for span in strip.hidden)
            return Step(
                hidden_words(strip.hidden), "Show them", lambda _: self.page.engine.show_take(take)
            )
        if not has_views:
            return None
        if not strip.is_posed:
            if not self.guesses.possible:
                return Step(
                    say("No pose yet. Drag the {kind} onto its picture."),
                    "Look through a camera",
                    self._look,
                )
            words = say("No pose yet. Detect the {kind}, or drag it onto its picture.")
            return Step(words, say("Detect {kind}"), lambda _: self.guesses.search(anywhere=True))
        if len(tracked) < 2:
            words = say("The {kind} has a pose. Tracking carries it through all frames.")
            return Step(words, "Track all", lambda _: self.tracking.start("all"))
        last, stop = strip.start + int(tracked[-1]), strip.start + len(strip.status)
        if last + 1 < stop:
            return Step(
                "",
                f"Continue from frame {last + 1}",
                lambda _: self.tracking.begin(Order(last, stop, last)),
            )
        count = len(self.review.stretches)
        if count and self.review.at is None:
            return Step("", f"Review {count} interval{'' if count == 1 else 's'}", self._review)
        return (
            None
            if count
            else Step("", "Export …", lambda client: self.page.open_tab(client, "More", "Export"))
        )

    def _review(self, client: viser.ClientHandle | None) -> None:
        self.page.open_tab(client, "Review", "Queue")
        self.review.visit(0)

    def _look(self, client: viser.ClientHandle | None) -> None:
        self.page.open_tab(client, "View")


def hidden_words(hidden: tuple[TakeSpan, ...]) -> str:
    """Return which tracked frames do not show, and why."""
    count = sum(span.last - span.first + 1 for span in hidden)
    takes = sorted({span.take for span in hidden})
    named = f"take{'' if len(takes) == 1 else 's'} {', '.join(map(str, takes))}"
    does = "frame does" if count == 1 else "frames do"
    return f"{count} tracked {does} not show ({named}): tracked with another model, such as one with a forearm."
