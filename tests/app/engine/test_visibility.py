"""A session of images alone: it is said what is missing, before anything is tried."""

from __future__ import annotations

import re
from pathlib import Path

from handtrack_app.engine.opening import nothing_seen, open_document
from handtrack_app.engine.worker import Worker
from handtrack_app.protocol import snapshots
from tests.app.calls import call
from tests.app.cloudy_session import cloudy_session
from tests.app.engine.test_worker import Listener


def _images_only(folder: Path) -> Path:
    folder.mkdir(exist_ok=True)
    cloudy_session(folder)
    text = (folder / "session.toml").read_text()
    (folder / "session.toml").write_text(re.sub(r"\[clouds\](.|\n)*", "", text))
    return folder


def test_images_alone_are_told_and_neither_searched_nor_tracked(tmp_path: Path) -> None:
    listener = Listener()
    worker = Worker(_images_only(tmp_path), listener.publish, open_document)
    worker.start()
    told = listener.wait(snapshots.Notice, lambda n: n.title == "Nothing to track by yet", 30.0)
    assert "neither masks nor clouds" in told.text
    for command in (call("find_hand", 0), call("track", 0, 2, 0)):
        listener.seen.clear()
        worker.send(command)
        refused = listener.wait(snapshots.Notice, lambda n: n.level == "error")
        assert refused.text == told.text
    worker.stop()


def test_clouds_masks_or_edges_are_something(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    clouds = open_document(cloudy_session(tmp_path / "a"), {}).run
    assert nothing_seen(clouds) == ""
    images = open_document(_images_only(tmp_path / "b"), {}).run
    assert nothing_seen(images)
    assert nothing_seen(images.with_values({"edges.weight": 1.0})) == ""
    text = (tmp_path / "b" / "session.toml").read_text()
    masked = text.replace('images = "cam0/*.png"', 'images = "cam0/*.png"\nmasks = "cam0/*.png"')
    (tmp_path / "b" / "session.toml").write_text(masked)
    assert nothing_seen(open_document(tmp_path / "b", {}).run) == ""
