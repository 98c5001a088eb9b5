"""Waiting for what other threads do."""

import time
from collections.abc import Callable
from typing import Any


def eventually(test: Callable[[], Any], what: str, timeout: float = 60.0) -> Any:
    """Wait until the test is true, at most `timeout` [s] (a kernel may be compiled meanwhile); what: in words, for the failure."""
    until = time.monotonic() + timeout
    while not (value := test()):
        assert time.monotonic() < until, f"{what}: not within {timeout:g} s"
        time.sleep(0.01)
    return value
