"""Waiting for what other threads do."""

import time
from collections.abc import Callable
from typing import Any


def eventually(test: Callable[[], Any], what: str = "", timeout: float = 300.0) -> Any:
    """Wait until the test is true, at most `timeout` [s] of waiting (the machine may be busy); what: in words, where the test does not say it."""
    for _ in range(int(100 * timeout)):
        if value := test():
            return value
        time.sleep(0.01)
    raise AssertionError(f"not within {timeout:g} s: {what}")
