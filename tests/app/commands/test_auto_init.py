"""`handtrack track --init auto`: sure of its start, or not."""

from dataclasses import replace

from handtrack import Session, Status, evaluate, read_npz
from handtrack.session import track_session
from handtrack.session.first_pose_search import find_first_poses
from handtrack_app.commands import track
from handtrack_app.commands.track import percent


def test_a_start_that_is_not_sure_is_taken_where_frames_confirm_it_or_its_user_says_so(
    handtrack, session, tmp_path, monkeypatch
):
    (session / "init.json").unlink()
    assert handtrack("track", session).code == 2
    searched, changed = [], {}

    def search(*given):
        """Search once: that costs far more than all else here."""
        searched.extend([] if searched else find_first_poses(*given))
        return [replace(one, **changed) for one in searched]

    monkeypatch.setattr(track, "find_first_poses", search)
    monkeypatch.setattr(track_session, "wrong_side_warning", lambda *_: "")  # as long as a search
    out = tmp_path / "poses.npz"
    asked = ("track", session, "--init", "auto", "--out", out, "--frames")
    ended = handtrack.does(*asked, "0:2")
    assert "\n  or: " in ended.err
    tracked = read_npz(out)
    assert evaluate(tracked, Session.open(session).truth)["mpjpe_tracked_mm"] < 0.5  # measured 0.1
    assert tracked.start_confidence > 0.85

    out.unlink()
    changed["confidence"] = 0.5
    refused = handtrack(*asked, "0:2")
    assert refused.code == 2, "too few to confirm it"
    assert "--yes" in refused.err
    assert not out.exists()
    ended = handtrack.does(*asked, "0:2", "--yes")
    assert read_npz(out).start_confidence == 0.5
    assert percent(0.5) in ended.out
    handtrack.does(*asked, "0:5")
    assert (read_npz(out).status == Status.TRACKED).all()

    masks = session / "masks"
    for old, new in (("cam0", "other"), ("cam1", "cam0"), ("other", "cam1")):
        (masks / old).rename(masks / new)
    ended = handtrack(*asked, "0:1", "--yes")
    assert "if cameras 'cam0' and 'cam1' were exchanged" in ended.err
