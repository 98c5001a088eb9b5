"""Who may reach the workbench, tried on a running server."""

from __future__ import annotations

import http.client
import socket

import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from handtrack.errors import HandtrackError
from handtrack_app.page import access
from handtrack_app.page.access import (
    choose_port,
    guarded_server,
    host_warning,
    is_loopback,
    is_own_page,
)

VISER = ["viser-v1.1.1"]


@pytest.fixture(scope="module")
def server():
    running = guarded_server()
    yield running
    running.stop()


@pytest.fixture
def taken():
    """A port of loopback where something listens already."""
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        listener.listen()
        yield listener.getsockname()[1]


def status_of(server, **headers) -> int:
    connection = http.client.HTTPConnection("127.0.0.1", server.get_port(), timeout=10)
    connection.request("GET", "/", headers=headers)
    status = connection.getresponse().status
    connection.close()
    return status


def test_the_page_is_served_on_loopback_alone(server):
    assert server.get_host() == "127.0.0.1"
    assert status_of(server) == 200
    address = f"localhost:{server.get_port()}"
    assert status_of(server, Host=address, Origin=f"http://{address}") == 200


@pytest.mark.parametrize("host", ["evil.example", "127.0.0.1.evil.example", "[bad"])
def test_a_name_that_is_not_ours_is_refused(server, host):
    """A site whose name was made to point to loopback."""
    assert status_of(server, Host=host) == 403


def test_a_page_of_another_site_cannot_connect(server):
    url = f"ws://127.0.0.1:{server.get_port()}"
    for origin in (
        "http://evil.example",
        "null",
        "http://127.0.0.1:1",
        "https://localhost.evil.example",
    ):
        with pytest.raises(InvalidStatus) as refused:
            connect(url, origin=origin, subprotocols=VISER)
        assert refused.value.response.status_code == 403


def test_its_own_page_and_programs_can_connect(server):
    url = f"ws://127.0.0.1:{server.get_port()}"
    for origin in (None, f"http://127.0.0.1:{server.get_port()}"):
        with connect(url, origin=origin, subprotocols=VISER, max_size=None) as connection:
            assert connection.recv(timeout=10)


def test_no_client_can_open_a_tunnel(server):
    assert server.request_share_url() is None


def test_the_library_is_left_as_it_was():
    import websockets.asyncio.server as library

    before = library.serve
    guarded_server().stop()
    assert library.serve is before


def test_a_port_taken_while_starting_is_said(taken):
    with pytest.raises(HandtrackError, match=f"port {taken} of 127.0.0.1 was taken while"):
        guarded_server(port=taken)


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
    assert warning.startswith("--host 0.0.0.0: everyone who can reach this machine")
    assert "no password" in warning
    with pytest.raises(
        HandtrackError, match="--host 203.0.113.7: this machine cannot listen there"
    ):
        host_warning("203.0.113.7")


def test_on_an_open_host_origin_must_equal_host():
    names = access._allowed_names("0.0.0.0")
    assert is_own_page("http://lab-pc:8080", "lab-pc:8080", names)
    assert not is_own_page("http://evil.example", "lab-pc:8080", names)


def test_a_port_that_is_asked_for_and_taken_is_an_error(taken):
    with pytest.raises(HandtrackError) as error:
        choose_port("127.0.0.1", taken)
    assert str(error.value).startswith(f"--port {taken}: this port of 127.0.0.1 cannot be used (")
    assert "leave --port away" in str(error.value)
    with pytest.raises(HandtrackError, match="--port 70000: expected a number from 1 to 65535"):
        choose_port("127.0.0.1", 70000)


def test_the_next_free_port_is_found(taken, monkeypatch):
    monkeypatch.setattr(access, "FIRST_PORT", taken)
    assert taken < choose_port("127.0.0.1") <= taken + 100
    assert choose_port("127.0.0.1", 0) == 0
