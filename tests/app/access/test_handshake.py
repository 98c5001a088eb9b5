"""Who is let in, tried on a running server; and where it listens."""

import contextlib
import http.client
import os
import socket
import webbrowser
from importlib.metadata import version
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from handtrack_app.access import address, web_server
from handtrack_app.access.address import choose_port, host_warning, is_loopback
from handtrack_app.access.web_server import MOST_CLIENTS, show_in_browser, start_web_server
from tests.app.waiting import eventually
from tests.conftest import refused

VISER = [f"viser-v{version('viser')}"]


@pytest.fixture(scope="module")
def web():
    running = start_web_server()
    yield running
    running.server.stop()


@pytest.fixture(scope="module")
def open_host():
    running = start_web_server("0.0.0.0")
    yield running
    running.server.stop()


def asked(web, path=None, **headers):
    """The answer to one who has the cookie, where no path is given."""
    connection = http.client.HTTPConnection("127.0.0.1", web.port)
    if path is None:
        headers = {"Cookie": f"handtrack_{web.port}={web.token}"} | headers
    connection.request("GET", path or "/", headers=headers)
    answer = connection.getresponse()
    answer.words = answer.read().decode()
    connection.close()
    return answer


def socket_of(web, token=True, host="127.0.0.1", **options):
    url = f"ws://{host}:{web.port}/" + (f"?token={web.token}" if token else "")
    return connect(url, subprotocols=VISER, max_size=None, **options)


def refused_status(web, **options):
    with pytest.raises(InvalidStatus) as refused:
        socket_of(web, **options)
    return refused.value.response.status_code


def test_the_page_is_served_on_loopback_alone(web):
    assert web.server.get_host() == "127.0.0.1"
    assert asked(web).status == 200
    address = f"localhost:{web.port}"
    assert asked(web, Host=address, Origin=f"http://{address}").status == 200


PATHS = "/ /?token= /?token=wrong /index.html /?tokens=x //[ /?% /?token=%ff *"


@pytest.mark.parametrize("path", PATHS.split())
def test_a17_c47_without_the_token_no_page_is_served(web, path):
    answer = asked(web, path)
    assert answer.status == 403
    assert "Set-Cookie" not in answer.headers


def test_a17_c47_without_the_token_no_socket_is_opened(web):
    assert refused_status(web, token=False) == 403
    wrong = {"Cookie": f"handtrack_{web.port}=wrong"}
    assert refused_status(web, token=False, additional_headers=wrong) == 403


def test_a17_the_page_gets_a_cookie_which_lets_its_socket_in(web):
    port = web.port
    answer = asked(web, f"/?token={web.token}&fixedDpr=1")
    assert (answer.status, answer.headers["Location"]) == (303, "/?fixedDpr=1")
    cookie = answer.headers["Set-Cookie"]
    assert cookie == f"handtrack_{port}={web.token}; Path=/; HttpOnly; SameSite=Lax"
    kept = {"Cookie": f"other=1; {cookie.partition(';')[0]}"}
    assert asked(web, "/", **kept).status == 200
    origin = f"http://127.0.0.1:{port}"
    with socket_of(web, token=False, additional_headers=kept, origin=origin) as page:
        assert page.recv()


@pytest.mark.parametrize("path", ["//evil.example/?token=", "/a/b?token="])
def test_the_token_leads_to_this_page_and_no_other(web, path):
    assert asked(web, path + web.token).headers["Location"] == "/"


@pytest.mark.skipif(os.name != "posix", reason="/bin/sh and modes of files")
def test_the_token_is_on_no_command_line_and_its_file_goes_with_the_first_page(
    tmp_path, monkeypatch
):
    (browser := tmp_path / "browser").write_text(f'#!/bin/sh\necho "$@" > {tmp_path}/said\n')
    browser.chmod(0o700)
    monkeypatch.setenv("HANDTRACK_HOME", str(tmp_path / "home"))
    monkeypatch.setattr(webbrowser, "_tryorder", [])
    webbrowser.register(
        "ours", None, webbrowser.GenericBrowser([str(browser), "%s"]), preferred=True
    )
    running = start_web_server()
    show_in_browser(running)
    said = (tmp_path / "said").read_text()
    assert running.token not in said
    file = Path(unquote(urlsplit(said.strip()).path))
    assert running.url in file.read_text()
    assert file.stat().st_mode & 0o777 == 0o600
    asked(running, f"/?token={running.token}")
    assert not file.exists()
    show_in_browser(running)
    running.close()
    assert not file.exists()


def test_a17_each_start_has_a_token_of_its_own(web, open_host):
    assert web.token != open_host.token
    assert len(web.token) >= 32
    assert web.token not in repr(open_host)
    assert web.url == f"http://127.0.0.1:{web.port}/?token={web.token}"
    assert open_host.url_by("lab-pc").startswith("http://lab-pc:")
    assert open_host.url.startswith("http://127.0.0.1:")


@pytest.mark.parametrize(
    "host", ["evil.example", "127.0.0.1.evil.example", "[bad", "", "localhost:x"]
)
def test_a_name_that_is_not_ours_is_refused(web, host):
    """A site whose name was made to point to loopback."""
    assert asked(web, Host=host).status == 403


@pytest.mark.parametrize("origin", [None, "http://evil.example"])
def test_a10_c46_on_an_open_host_a_foreign_name_is_refused(open_host, origin):
    """Also where Origin and Host agree: the site's own name points here."""
    headers = {"Host": "evil.example"} | ({"Origin": origin} if origin else {})
    assert asked(open_host, **headers).status == 403
    with socket.create_connection(("127.0.0.1", open_host.port)) as wire:
        assert refused_status(open_host, host="evil.example", sock=wire, origin=origin) == 403


def test_a10_on_an_open_host_this_machine_is_known(open_host):
    port = open_host.port
    for name in ("127.0.0.1", "localhost", "0.0.0.0", socket.gethostname()):
        assert asked(open_host, Host=f"{name}:{port}").status == 200
    assert asked(open_host, Host=f"192.0.2.7:{port}").status == 403


def test_c46_a_page_of_another_site_cannot_connect(web):
    for origin in (
        "http://evil.example",
        "null",
        "http://127.0.0.1:1",
        "https://localhost.evil.example",
        "http://[",
    ):
        assert refused_status(web, origin=origin) == 403
    assert asked(web, Origin="http://[").status == 403


def test_a_header_that_stands_twice_is_refused(web):
    port = web.port
    with socket.create_connection(("127.0.0.1", port)) as wire:
        hosts = f"Host: 127.0.0.1:{port}\r\n" * 2
        wire.sendall(f"GET /?token={web.token} HTTP/1.1\r\n{hosts}\r\n".encode())
        assert b" 400 " in wire.recv(100)


def test_a16_no_site_can_frame_the_page(web):
    for answer in (asked(web), asked(web, "/")):
        assert answer.headers["X-Frame-Options"] == "DENY"
        policy = answer.headers["Content-Security-Policy"]
        assert "frame-ancestors 'none'" in policy
        assert "connect-src 'self'" in policy
        assert answer.headers["Referrer-Policy"] == "no-referrer"
        assert answer.headers["X-Content-Type-Options"] == "nosniff"


def test_no_client_can_open_a_tunnel(web):
    assert web.server.request_share_url() is None


@pytest.mark.parametrize(
    ("allowed", "most", "status"),
    [((1e-9, 3.0), 3, 429), ((1.0, 2.0 * MOST_CLIENTS), MOST_CLIENTS, 503)],
)
def test_a11_the_number_of_clients_is_bounded(monkeypatch, allowed, most, status):
    monkeypatch.setattr(web_server, "_NEW_CLIENTS", allowed)
    web = start_web_server()
    with contextlib.ExitStack() as clients:
        for _ in range(most):
            clients.enter_context(socket_of(web))
        assert refused_status(web) == status
    web.server.stop()


def test_a11_half_open_connections_keep_nobody_out(web):
    idle = [socket.create_connection(("127.0.0.1", web.port)) for _ in range(150)]
    assert asked(web).status == 200
    most = web_server.MOST_CONNECTIONS
    eventually(lambda: sum(map(closed, idle)) >= len(idle) - most)
    for wire in idle:
        wire.close()


def closed(wire):
    wire.settimeout(0.02)
    try:
        return wire.recv(1) == b""
    except TimeoutError:
        return False
    except OSError:
        return True


def test_a_client_of_another_version_is_told_so_and_the_terminal_is_not(web, capfd):
    url = f"ws://127.0.0.1:{web.port}/?token={web.token}"
    with connect(url, subprotocols=["viser-v0.9"]) as old, pytest.raises(ConnectionClosed) as end:
        old.recv()
    assert end.value.rcvd.code == 1002
    eventually(lambda: not web.server._websock_server._live_connections)
    assert capfd.readouterr().out == ""


@pytest.fixture
def taken():
    """A port of loopback where something listens already."""
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        listener.listen()
        yield listener.getsockname()[1]


def test_what_loopback_is():
    for host in ("127.0.0.1", "localhost", "::1", "[::1]", "127.9.9.9"):
        assert is_loopback(host)
    for host in ("0.0.0.0", "::", "192.168.1.5", "localhost.evil", "", "127.0.0.1.evil"):
        assert not is_loopback(host)


def test_an_open_host_is_warned_of():
    assert host_warning("127.0.0.1") == ""
    assert "--host 0.0.0.0" in host_warning("0.0.0.0")
    refused("--host 203.0.113.7", host_warning, "203.0.113.7")


def test_a_port_that_is_asked_for_and_taken_is_an_error(taken):
    """Fault C45."""
    refused(f"--port {taken}", choose_port, "127.0.0.1", taken)


def test_the_next_free_port_is_found(taken, monkeypatch):
    """Fault C45."""
    monkeypatch.setattr(address, "FIRST_PORT", taken)
    assert taken < choose_port("127.0.0.1") <= taken + 100
    assert choose_port("127.0.0.1", 0) == 0
