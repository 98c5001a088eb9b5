"""The mask desk: methods tried live and saved, boxes, strokes that become files, undone, carried on, never lost."""

import tomllib

import numpy as np

from handtrack import Session
from handtrack.capture.masks.mask_correction import HAND, empty_layer, painted
from handtrack.capture.masks.segmentation import SkinYCrCb
from handtrack.files.atomic import versions
from handtrack.session.sources.corrections import encoded
from handtrack_app import protocol
from tests.app.cloudy_session import BOX, SETTINGS, cloudy_session
from tests.app.desk import working
from tests.app.waiting import eventually
from tests.session.small_session import edit, make_session

SKIN = {"method": "skin_ycrcb"}
X, Y = BOX[0] + BOX[2] // 2, BOX[1] + BOX[3] // 2
"""amid the skin, in cam0"""


def method(told, camera="cam0"):
    return next(c.method for c in told.masks if c.name == camera)


def masks_told(listener, test):
    """Return the session, once the page is told of such."""
    return listener.wait(protocol.SessionSnapshot, test)


def stroke(worker, frame=0, brush="hand"):
    worker.engine.paint_mask(frame, "cam0", brush, ((10.0, 40.0), (20.0, 40.0)), 4.0, brush)


def held(worker):
    return worker.document.session.view("cam0").corrections.frames


def file_of(folder, frame=0):
    return folder / "masks_corrected" / "cam0" / f"{frame:06d}.png"


def test_a_method_is_tried_over_all_cameras_at_once(cloudy_desk, tmp_path):
    (worker, listener), folder = cloudy_desk, tmp_path
    first = listener.wait(protocol.SessionSnapshot)
    assert [method(first, c.name) for c in first.masks] == ["none", "none"]
    assert "skin_ycrcb" in first.masks[0].possible
    assert {"seeded", "depth_range", "files"}.isdisjoint(first.masks[0].possible)
    worker.engine.want_pictures(True, "plain", masks=True)
    worker.engine.set_masks("", SKIN)
    card = masks_told(listener, lambda c: method(c) == "skin_ycrcb")
    assert card.unsaved["masks"] == ("cam0", "cam1")
    assert card.masks[0].values["cr"] == (138, 175)

    def is_dark(cam0, cam1):
        return cam0[Y, X].mean() > 100 and cam0[5, 5].mean() < 20

    listener.wait(protocol.PictureSnapshot, lambda p: p.masks and is_dark(**p.masks))
    worker.engine.set_masks("cam1", {"y_min": 255})
    changed = masks_told(listener, lambda c: c.masks[1].values.get("y_min") == 255)
    assert changed.masks[0].values["y_min"] == 40
    assert (folder / "session.toml").read_text() == SETTINGS


def test_what_is_tried_is_saved_and_taken_back(cloudy_desk, tmp_path):
    (worker, listener), folder = cloudy_desk, tmp_path
    worker.engine.set_masks("", SKIN)
    worker.engine.set_masks("cam1", {"roi": (10, 5, 60, 50)})
    worker.engine.set_masks("cam0", {"cr": (140, 170)})
    worker.engine.save_to_file("masks")
    masks_told(listener, lambda c: c.masks[1].roi and not c.unsaved["masks"])
    text = (folder / "session.toml").read_text()
    assert text.startswith("# a comment that stays\n")
    saved = tomllib.loads(text)["camera"]
    assert saved[0]["masks"] == {"method": "skin_ycrcb", "cr": [140, 170]}
    assert saved[1]["roi"] == [10, 5, 60, 50]
    assert Session.open(folder).views[0].settings.masks == SkinYCrCb(cr=(140, 170))
    worker.engine.set_masks("cam0", {"y_min": 90})
    masks_told(listener, lambda c: c.unsaved["masks"] == ("cam0",))
    worker.engine.undo(1)
    eventually(lambda: not worker.document.unsaved("masks"))
    worker.engine.set_masks("", {"method": "background_median"})
    eventually(lambda: len(worker.document.unsaved("masks")) == 2)
    worker.engine.restore_from_file("masks")
    eventually(lambda: not worker.document.unsaved("masks"))
    worker.engine.set_masks("cam0", {"y_min": 90})
    worker.engine.save_to_file("masks")
    eventually(lambda: "y_min = 90" in (folder / "session.toml").read_text())
    assert len(versions(folder / "session.toml")) == 2


def test_a_stroke_becomes_a_file_and_is_undone(cloudy_desk, tmp_path):
    (worker, listener), folder = cloudy_desk, tmp_path
    worker.engine.set_masks("", SKIN)
    worker.engine.save_to_file("masks")
    worker.engine.want_pictures(True, "plain", masks=True)
    stroke(worker)
    listener.wait(
        protocol.PictureSnapshot,
        lambda p: p.corrected.get("cam0", "").startswith("corrected here; 1"),
    )
    eventually(lambda: file_of(folder).is_file())
    for session in (worker.document.session, Session.open(folder)):  # tracking sees it, too
        seen = session.observation(0).silhouettes[0]
        assert (seen.mask[40, 15], seen.mask[30, 15], seen.mask[Y, X]) == (1, 0, 1)
    stroke(worker, brush="as it is")
    eventually(lambda: not file_of(folder).exists(), "nothing is left of it")
    worker.engine.undo(1)
    eventually(lambda: file_of(folder).is_file())
    worker.engine.undo(2)
    eventually(lambda: not file_of(folder).exists())
    worker.engine.redo(3)
    eventually(lambda: file_of(folder).is_file())
    worker.engine.drop_correction(0, "cam0")
    eventually(lambda: not file_of(folder).exists())
    assert not versions(file_of(folder))  # all ours


def test_what_was_painted_comes_back_and_a_file_from_elsewhere_counts_and_is_kept(tmp_path):
    folder = cloudy_session(tmp_path)
    worker, _ = working(folder)
    looks, listener = working(folder)
    stroke(looks)
    listener.refused()
    looks.stop()
    assert not held(looks) and not file_of(folder).exists(), "who may not write may not paint"
    stroke(worker)
    eventually(lambda: held(worker) == [0])
    worker.stop()  # before edits rest
    assert file_of(folder).is_file()
    again, _ = working(folder)
    assert held(again) == [0]
    again.stop()
    theirs = encoded(painted(empty_layer((96, 72)), np.array([[80.0, 8]]), 5.0, HAND))
    for frame in (0, 1):  # over ours, and where we have none
        file_of(folder, frame).write_bytes(theirs)
    again, _ = working(folder)
    corrections = again.document.session.view("cam0").corrections
    for frame in (0, 1):
        assert corrections.content(frame) == theirs
        stroke(again, frame)
    for frame in (0, 1):
        eventually(lambda frame=frame: len(versions(file_of(folder, frame))) == 1)
    layer = corrections.layer(1)
    assert layer[8, 80] == layer[40, 15] == HAND  # painted over theirs
    again.engine.undo(1)
    eventually(lambda: file_of(folder, 1).read_bytes() == theirs)
    again.stop()


def test_a_correction_is_carried_on_but_not_over_painted_frames(tmp_path):
    folder = cloudy_session(tmp_path, frames=6)  # in which nothing moves
    worker, listener = working(folder)
    square = tuple((float(x), 30.0) for x in (45, 50))
    worker.engine.paint_mask(2, "cam0", "not hand", square, 6.0, "1")
    worker.engine.paint_mask(5, "cam0", "hand", ((5.0, 5.0),), 4.0, "2")
    worker.engine.carry_masks(2, "", 20, 20)
    eventually(lambda: file_of(folder, 4).is_file())
    corrections = worker.document.session.view("cam0").corrections
    eventually(lambda: corrections.frames == [0, 1, 2, 3, 4, 5])
    layer, own = corrections.layer(4), corrections.layer(2)
    assert ((layer == 0) == (own == 0)).mean() > 0.98
    painted_there = corrections.layer(5)
    assert painted_there[5, 5] == HAND
    assert not (painted_there == 0).any()
    listener.told("4 frames")
    worker.engine.undo(1)
    eventually(lambda: corrections.frames == [2, 5])
    worker.engine.carry_masks(0, "cam1", 1, 1)
    listener.told("nothing to propagate")
    worker.stop()


def test_files_are_said_to_be_files_and_stay(tmp_path):
    folder = make_session(tmp_path)
    settings, mask = folder / "session.toml", folder / "masks" / "cam0" / "000.png"
    edit(settings, 'cam0/*.png"\n\n', 'cam0/*.png"\nmask_unknown = 100\n\n')
    worker, listener = working(folder)
    assert method(listener.wait(protocol.SessionSnapshot)) == "files"
    before = mask.read_bytes()
    stroke(worker)
    eventually(lambda: file_of(folder).is_file())
    assert mask.read_bytes() == before
    worker.engine.set_masks("cam0", SKIN)
    worker.engine.save_to_file("masks")
    eventually(lambda: "skin_ycrcb" in settings.read_text())
    assert "mask_unknown" not in settings.read_text()
    Session.open(folder)
    worker.stop()
