"""`handtrack track` of a hand whose first frame says something else of its forearm than all others."""

from handtrack.session.formats.tables import read_npz
from tests.session.test_run import opening


def test_all_frames_decide_whether_there_is_an_arm(handtrack, tmp_path):
    """The first frame's masks end at the wrist; those of the others show the arm."""
    whole, bare = (opening(tmp_path / str(arm), 40, 5, arm) for arm in (True, False))
    first = sorted((whole / "masks").glob("*/*0000.*"))
    assert len(first) == 3
    for mask in first:
        mask.write_bytes((bare / mask.relative_to(whole)).read_bytes())
    ended = handtrack("track", whole, "--set", "tracker.escape=false")
    assert ended.code == 0, ended.err
    track = read_npz(whole / "tracks/poses.npz")
    assert track.frame.tolist() == list(range(5))
    assert "wrist_flex" in track.parameter_names
