"""Where the workbench listens."""

import socket

import pytest

from handtrack import HandtrackError
from handtrack_app.door import address
from handtrack_app.door.address import choose_port, host_warning, is_loopback, own_names


@pytest.fixture
def taken():
    """A port of loopback where something listens already."""
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        listener.listen()
        yield listener.getsockname()[1]


@pytest.mark.parametrize(
    ("host", "own"),
    [
        *(
            ("127.0.0.1", True),
            ("localhost", True),
            ("::1", True),
            ("[::1]", True),
            ("127.9.9.9", True),
        ),
        *(("0.0.0.0", False), ("::", False), ("192.168.1.5", False), ("localhost.evil", False)),
        *(("", False), ("127.0.0.1.evil", False)),
    ],
)
def test_what_loopback_is(host, own):
    assert is_loopback(host) is own


def test_an_open_host_is_warned_of():
    assert host_warning("127.0.0.1") == ""
    warning = host_warning("0.0.0.0")
    assert warning.startswith("--host 0.0.0.0: everyone who knows the address with its token")
    assert "not encrypted" in warning
    with pytest.raises(
        HandtrackError, match="--host 203.0.113.7: this machine cannot listen there"
    ):
        host_warning("203.0.113.7")


def test_on_an_open_host_the_names_of_this_machine_are_its_own():
    assert own_names("127.0.0.1") == {"127.0.0.1", "localhost", "::1"}
    assert {"0.0.0.0", "localhost", socket.gethostname().lower()} <= own_names("0.0.0.0")


def test_a_port_that_is_asked_for_and_taken_is_an_error(taken):
    """Fault C45."""
    with pytest.raises(HandtrackError) as error:
        choose_port("127.0.0.1", taken)
    assert str(error.value).startswith(f"--port {taken}: this port of 127.0.0.1 cannot be used (")
    with pytest.raises(HandtrackError, match="--port 70000: expected a number from 1 to 65535"):
        choose_port("127.0.0.1", 70000)


def test_the_next_free_port_is_found(taken, monkeypatch):
    """Fault C45."""
    monkeypatch.setattr(address, "FIRST_PORT", taken)
    assert taken < choose_port("127.0.0.1") <= taken + 100
    assert choose_port("127.0.0.1", 0) == 0
