"""A session of images alone: it is said what is missing, before anything is tried."""

import re

from handtrack_app.engine import opening
from handtrack_app.engine.opening import nothing_seen
from tests.app.cloudy_session import cloudy_session


def _images_only(folder):
    folder.mkdir(exist_ok=True)
    cloudy_session(folder)
    text = (folder / "session.toml").read_text()
    (folder / "session.toml").write_text(re.sub(r"\[clouds\](.|\n)*", "", text))
    return folder


def test_clouds_masks_or_edges_are_something(tmp_path):
    (tmp_path / "a").mkdir()
    clouds = opening.document(opening.opened(cloudy_session(tmp_path / "a"))).run
    assert nothing_seen(clouds) == ""
    images = opening.document(opening.opened(_images_only(tmp_path / "b"))).run
    assert nothing_seen(images)
    assert nothing_seen(images.with_values({"edges.weight": 1.0})) == ""
    text = (tmp_path / "b" / "session.toml").read_text()
    masked = text.replace('images = "cam0/*.png"', 'images = "cam0/*.png"\nmasks = "cam0/*.png"')
    (tmp_path / "b" / "session.toml").write_text(masked)
    assert nothing_seen(opening.document(opening.opened(tmp_path / "b")).run) == ""
