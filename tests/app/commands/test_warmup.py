"""`handtrack warmup`."""

from handtrack.simulation.warm_up import KINDS
from handtrack_app.cli import main


def test_all_kinds_of_tracking_are_compiled_and_named(capsys):
    assert main(["warmup"]) == 0
    told = capsys.readouterr()
    assert all(kind in told.err for kind in KINDS)
