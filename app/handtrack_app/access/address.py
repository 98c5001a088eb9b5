"""Where the workbench listens: on this machine alone unless asked otherwise; and the names it has there."""

from __future__ import annotations

import ipaddress
import socket

from handtrack.errors import HandtrackError

LOOPBACK = "127.0.0.1"
FIRST_PORT = 8080
_PORTS_TRIED = 100


def is_loopback(host: str) -> bool:
    """Return whether only this machine can reach a server that listens on `host`."""
    if host.lower() == "localhost":
        return True
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False


def host_warning(host: str) -> str:
    """Return what the user must know of the chosen host; nothing for loopback.

    Raises HandtrackError when this machine has no such address.
    """
    if is_loopback(host):
        return ""
    try:
        with socket.socket(_family(host), socket.SOCK_STREAM) as probe:
            probe.bind((host, 0))
    except OSError as error:
        raise HandtrackError(
            f"--host {host}: this machine cannot listen there ({error.strerror or error}). Leave out --host to listen on {LOOPBACK}, for this machine alone."
        ) from None
    return (
        f"--host {host}: everyone who knows the address with its token, and can reach this machine over the "
        "network, can now see the recording, change poses and write into the session folder. What is sent is "
        "not encrypted: use it in networks you trust, or forward a port instead: "
        f"ssh -L {FIRST_PORT}:{LOOPBACK}:{FIRST_PORT} this-machine"
    )


def own_names(host: str) -> frozenset[str]:
    """Return the names, in lower case, by which a browser may call a server that listens on `host`.

    The address that a connection reached is one more (`Handshake`); the network's other names for this machine are not known.
    """
    names = {host, "localhost", LOOPBACK, "::1"}
    if not is_loopback(host):
        short = socket.gethostname().partition(".")[0]
        names |= {socket.gethostname(), socket.getfqdn(), short, f"{short}.local"}
    return frozenset(name.lower().strip("[]") for name in names)


def choose_port(host: str, asked: int | None = None) -> int:
    """Return a free port: the one asked for, else the first free one from 8080 on.

    0 lets the system choose. Raises HandtrackError when the port asked for is taken or no port at all.
    """
    if asked is not None:
        if not 0 <= asked <= 65535:
            raise HandtrackError(
                f"--port {asked}: expected a number from 1 to 65535, or 0 for any."
            )
        problem = _bind(host, asked)
        if problem is None:
            return asked
        raise HandtrackError(
            f"--port {asked}: this port of {host} cannot be used ({problem.strerror or problem}). Perhaps "
            "another workbench is open there; close it, or leave out --port to use the next free one."
        )
    for port in range(FIRST_PORT, FIRST_PORT + _PORTS_TRIED):
        if _bind(host, port) is None:
            return port
    raise HandtrackError(
        f"no free port on {host} from {FIRST_PORT} to {FIRST_PORT + _PORTS_TRIED - 1}; name one with --port."
    )


def _bind(host: str, port: int) -> OSError | None:
    """Return why a server could not listen on a port, None when it could."""
    with socket.socket(_family(host), socket.SOCK_STREAM) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port))
            probe.listen(1)
        except OSError as error:
            return error
    return None


def _family(host: str) -> socket.AddressFamily:
    return socket.AF_INET6 if ":" in host else socket.AF_INET
