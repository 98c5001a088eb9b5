"""`handtrack track` of a hand whose first frame says something else of its forearm than all others."""

from handtrack.session.formats.tables import read_npz
from handtrack.simulation.simulate import Simulation, simulate


def test_all_frames_decide_whether_there_is_an_arm(handtrack, tmp_path):
    """The first frame's masks end at the wrist; those of the others show the arm."""
    folders = [
        simulate(tmp_path / name, Simulation(frames=40, size=(320, 240), forearm=arm, images=False))
        for name, arm in (("whole", True), ("bare", False))
    ]
    whole, bare = folders
    first = sorted((whole / "masks").glob("*/*0000.*"))
    assert len(first) == 3
    for mask in first:
        mask.write_bytes((bare / mask.relative_to(whole)).read_bytes())
    ended = handtrack("track", whole, "--frames", "0:5", "--set", "tracker.escape=false")
    assert ended.code == 0, ended.err
    track = read_npz(whole / "tracks/poses.npz")
    assert track.frame.tolist() == list(range(5))
    assert "wrist_flex" in track.parameter_names
