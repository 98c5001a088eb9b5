"""What is said to the user in a real browser: read whole, and there as long as it is needed."""

import pytest

from tests.app.desk import in_threads
from tests.app.fake_run import fake_document
from tests.app.page.test_browser import browsing
from tests.app.waiting import eventually

LONG = " ".join(f"Word{n} of a reason that has to be read to its end." for n in range(12))
CUT = """() => [...document.querySelectorAll('.mantine-Notification-root')].filter((one) => one.innerText.includes('Word11')).map(
  (root) => [root, ...root.querySelectorAll('*')].some((one) => getComputedStyle(one).overflow !== 'visible'
    && (one.scrollHeight > one.clientHeight + 1 || one.scrollWidth > one.clientWidth + 1)))"""


@pytest.mark.browser
def test_what_matters_is_read_whole_and_stays(tmp_path):
    bench = in_threads(tmp_path, opener=fake_document)
    with browsing(bench, size=(1280, 800)) as view:
        page = view.page
        bench.layout.messages.see_pose(False)  # as where there is no first pose
        bench.page.notify("guide", "What to do first", "Press the button that finds the hand.")
        bench.page.notify("warning", "Frame 3 fits, with low confidence", "Frame 4 as well.")
        (client,) = bench.server.get_clients().values()
        tab = page.get_by_role("tab", name="Review", exact=True)

        def hidden():  # again, where what the browser remembers comes after it
            bench.layout.room.fold(client, folded=True)
            return not tab.is_visible()

        eventually(hidden, "the panel is hidden")
        bench.page.notify(
            "error", "A title that is longer than some", LONG.replace("Word", "Cause")
        )
        eventually(tab.is_visible, "an error is read in the panel")
        bench.page.notify("info", "Nothing to undo", "The history ends here.")
        bench.page.notify("done", "Saved", LONG)
        assert eventually(lambda: page.evaluate(CUT), "a notice") == [False]
        for told in ("What to do first", "low confidence", "A title that"):
            notice = page.locator(".mantine-Notification-root", has_text=told)
            assert not notice.count(), "notices tell what is done, and nothing else"
        notices = page.locator(".mantine-Notification-closeButton")
        while notices.count():
            notices.first.click()
            page.wait_for_timeout(500)

        def read(text):
            return page.locator(".handtrack-note:visible", has_text=text).count() == 1

        assert read("Cause11"), "gone from the scene, not from the page"
        view.press("Put away")
        eventually(lambda: read("Frame 4") and not read("Cause11"), "the one before it")
        view.press("Put away")
        eventually(lambda: read("Press the button") and not read("Frame 4"), "the one before it")
        bench.page.edit_pose({"root_tx": 0.01}, "Move")
        eventually(lambda: not read("Press the button"), "it has done its work")
        bench.page.notify("warning", "Frame 7 does not fit well", "Frame 9 does.")
        page.locator("a[data-frame='9']:visible").first.click()
        eventually(lambda: bench.state.frame == 9, "a link leads to its frame")
        view.show_tab("Messages")
        eventually(lambda: read("Press the button") and read("Cause11"), "all can be read again")
