"""Engines that start at once."""

from types import SimpleNamespace

import pytest

from tests.killing import copies


@pytest.fixture
def quick_engines(monkeypatch):
    """Engines are copies of a process that has all loaded; tests of the whole program start them as its user does, in seconds."""
    context = copies()
    spawning = SimpleNamespace(get_context=lambda _: context)
    monkeypatch.setattr("handtrack_app.process.child.multiprocessing", spawning)
