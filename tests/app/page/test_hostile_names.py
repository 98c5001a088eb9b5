"""Names from a session's files are shown as text: what they hold of HTML is no part of the page (fault C53)."""

import json
import shutil
from pathlib import Path

import viser

from tests.app.desk import shown
from tests.app.waiting import eventually
from tests.session.small_session import edit

TAG = "<img src=x onerror=alert(1)>"


def written_in(server):
    """Yield all that the page takes as HTML or Markdown."""
    for container in list(server.gui._container_handle_from_uuid.values()):
        for handle in list(container._children.values()):
            if isinstance(handle, viser.GuiHtmlHandle | viser.GuiMarkdownHandle):
                yield handle.content


def test_c53_names_in_a_sessions_files_are_text(recorded, tmp_path):
    folder = Path(shutil.copytree(recorded, tmp_path / "session"))
    old = next(x for x in (folder / "session.toml").read_text().splitlines() if "name = " in x)
    edit(folder / "session.toml", old, f"name = {json.dumps(TAG)}")
    for file in ("session.toml", "calibration.toml"):
        edit(folder / file, 'name = "cam0"', f"name = {json.dumps('cam' + TAG)}")
    (folder / "masks/cam0/000001.png").write_bytes(b"no image")  # a note names the file
    with shown(folder) as bench:
        eventually(
            lambda: any("&lt;img" in text for text in written_in(bench.server)), "the name is shown"
        )
        assert [text for text in written_in(bench.server) if "<img" in text] == []
