"""What the page may load and who may show it: the headers of every answer."""

from __future__ import annotations

import base64
import functools
import hashlib
import logging
import re
from pathlib import Path

import viser

log = logging.getLogger(__name__)
_LOADER = re.compile(
    r'<script data-p="(?P<packed>[^"]*)" data-ss="(?P<styles>\d+)" data-cs="\d+">(?P<code>.*?)</script>',
    re.DOTALL,
)
_ALPHABET = "".join(chr(code) for code in range(0x21, 0x7F) if chr(code) not in "\"&<>'`")
"""the loader's 88 digits; five are four bytes"""


@functools.cache
def page_headers() -> dict[str, str]:
    """Return the headers: only viser's own scripts run, no other site frames the page or hears of the token.

    Of a page that is packed in a way not known here, all scripts that stand in it run.
    """
    try:
        scripts = " ".join(f"'sha256-{digest}'" for digest in _script_digests(_client_page()))
    except Exception as why:  # whatever another release's page may be: it is shown all the same
        log.warning("viser %s: scripts are not told from others (%r)", viser.__version__, why)
        scripts = "'self' 'unsafe-inline' blob:"
    policy = {
        "default-src": "'none'",
        # zstd in WebAssembly; what unpacks the environment's light makes functions from strings of its own
        "script-src": f"{scripts} 'wasm-unsafe-eval' 'unsafe-eval'",
        "worker-src": "'self' blob:",  # the connection lives in a worker
        "style-src": "'self' 'unsafe-inline'",  # set by the page's libraries while they run
        "img-src": "'self' data: blob:",
        "font-src": "'self' data:",
        "connect-src": "'self' data: blob:",  # the socket; the environment's light is a data URL
        "base-uri": "'none'",
        "form-action": "'none'",
        "frame-ancestors": "'none'",
    }
    return {
        "Content-Security-Policy": "; ".join(f"{name} {value}" for name, value in policy.items()),
        "X-Frame-Options": "DENY",
        "X-Content-Type-Options": "nosniff",
        "Referrer-Policy": "no-referrer",
        "Cross-Origin-Opener-Policy": "same-origin",
        "Cache-Control": "no-store",
    }


def _client_page() -> str:
    return (Path(viser.__file__).parent / "client" / "build" / "index.html").read_text("utf-8")


def _script_digests(page: str) -> list[str]:
    """Return the SHA-256, in base 64, of the page's loader and of the script that it unpacks and runs.

    Raises one error or another for a page that is not made as that of viser 1.1.1.
    """
    import zstandard  # viser's own way to pack

    found = _LOADER.search(page)
    if found is None:
        raise ValueError("no loader as in viser 1.1.1")
    unpacked = zstandard.ZstdDecompressor().decompress(_unpacked(found["packed"]))
    texts = found["code"].encode(), unpacked[int(found["styles"]) :]
    return [base64.b64encode(hashlib.sha256(text).digest()).decode() for text in texts]


def _unpacked(digits: str) -> bytes:
    """Return bytes from digits to base 88, four from five; a last group of r + 1 digits is r bytes."""
    places = {ord(digit): place for place, digit in enumerate(_ALPHABET)}
    made = bytearray()
    for at in range(0, len(digits), 5):
        group = digits[at : at + 5]
        number = 0
        for digit in group:
            number = number * 88 + places[ord(digit)]
        made += number.to_bytes(4, "big")[5 - len(group) :]
    return bytes(made)
