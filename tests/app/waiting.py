"""Waiting for what other threads do."""

import time
from collections.abc import Callable
from typing import Any


def eventually(test: Callable[[], Any], what: str = "", timeout: float = 60.0) -> Any:
    """Wait until the test is true, at most `timeout` [s] (a kernel may be compiled meanwhile); what: in words, where the test does not say it."""
    until = time.monotonic() + timeout
    while not (value := test()):
        assert time.monotonic() < until, f"not within {timeout:g} s: {what}"
        time.sleep(0.01)
    return value
