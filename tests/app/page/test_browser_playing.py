"""While a recording plays, all that the page shows is of one frame, however slow the browser; and no more frames come than it draws."""

import time
from typing import Any

import numpy as np
import pytest

from tests.app.desk import in_threads
from tests.app.fake_run import FRAMES, fake_document
from tests.app.page.test_browser import browsing
from tests.app.waiting import eventually
from tests.app.wire import WireClient

SAMPLE = """() => {
  const card = [...document.querySelectorAll('b')].find((one) => /^Frame \\\\d+$/.test(one.textContent));
  const lanes = document.querySelector('.handtrack-timeline').closest('.mantine-Paper-root');
  const grey = (image) => {
    const canvas = document.createElement('canvas'), ink = canvas.getContext('2d');
    [canvas.width, canvas.height] = [image.naturalWidth || image.width, image.naturalHeight || image.height];
    ink.drawImage(image, 0, 0);
    return Math.round(ink.getImageData(12, 12, 1, 1).data[0] / 10);
  };
  const sheet = [...document.querySelectorAll('img')].find((one) => one.naturalWidth === 620);
  return {card: card ? Number(card.textContent.slice(6)): null, word: card ? card.nextElementSibling.textContent : null,
          cursor: Number(lanes.querySelector('.mantine-Slider-thumb').getAttribute('aria-valuenow')),
          lanes: lanes.innerText, sheet: sheet ? grey(sheet): null};
}""".replace("\\\\", "\\")


@pytest.mark.browser
def test_a_slow_page_shows_all_of_one_frame(tmp_path):
    bench = in_threads(tmp_path, opener=lambda f: fake_document(f, step_s=0.0))
    with browsing(bench, size=(1280, 800)) as view:
        bench.engine.track(0, FRAMES, 3)
        eventually(lambda: np.all(bench.layout.timeline.strip.status >= 0), "tracked")
        bench.page.go_to(5)
        eventually(lambda: bench.stage.pose.frame == 5, "another frame")
        bench.page.edit_pose({"root_tx": 0.02}, "Move")
        eventually(lambda: 5 in bench.layout.timeline.strip.by_hand, "set by hand")
        slow = view.page.context.new_cdp_session(view.page)
        slow.send("Emulation.setCPUThrottlingRate", {"rate": 2})
        bench.page.play(True)
        rng, samples = np.random.default_rng(0), list[dict[str, Any]]()
        for tab in ("Pose", "View"):
            view.show_tab(tab)
            for _ in range(5):
                view.page.wait_for_timeout(float(rng.uniform(100, 500)))
                samples.append(view.page.evaluate(SAMPLE))
        bench.page.play(False)
        for one in samples:
            frame = one["cursor"]
            word = {5: "set by hand", 7: "low confidence"}.get(frame, "tracked")
            assert one["card"] in (None, frame) and one["sheet"] in (None, frame), one
            assert one["word"] in (None, word)
            assert word in one["lanes"].splitlines()
        for part in ("card", "sheet"):
            assert sum(one[part] is not None for one in samples) >= 4, f"the {part} is shown"
        assert len({one["cursor"] for one in samples}) >= 3, "it plays"


def test_no_more_than_two_frames_are_on_their_way(bench):
    with WireClient(bench.url, draws=False) as wire:
        eventually(bench.server.get_clients, "it is there")
        asked, send = list[int](), bench.worker.send

        def sent(call):
            if call.name == "show_frame":
                asked.append(call.arguments["frame"])
            send(call)

        bench.worker.send = sent
        bench.page.play(True)
        eventually(lambda: len(asked) == 2, "it draws none of them")
        time.sleep(0.3)
        answered = 0  # a frame that is told again is asked about again
        while len(asked) == 2:
            eventually(lambda: len(asked) > 2 or len(_questions(wire)) > answered, "a question")  # noqa: B023
            for question in _questions(wire)[answered:]:
                wire.answer(question, None)
                answered += 1
            time.sleep(0.3)
        assert len(asked) == 3 and answered >= 2, "it takes the frame, and has drawn it"


def test_nothing_is_played_while_no_page_is_open(bench):
    """The demo plays by itself, and its page may be closed, or never be opened: the program rests then."""
    asked, send = list[int](), bench.worker.send

    def sent(call):
        asked.extend([1] if call.name == "show_frame" else [])
        send(call)

    bench.worker.send = sent
    bench.page.play(True)
    time.sleep(0.5)
    assert not asked, "nobody sees it"
    with WireClient(bench.url):
        eventually(lambda: len(asked) > 2, "it plays to who comes")
    eventually(lambda: not bench.server.get_clients(), "the page was closed")

    def rests():  # what was asked for before may still be under way
        asked.clear()
        time.sleep(0.5)
        return not asked

    eventually(rests, "nobody sees it any more")


def _questions(wire):
    return [message for _, message in wire.messages if message.get("key") == "handtrack.drawn"]
