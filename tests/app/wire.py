"""A bare client on the wire, as viser's page speaks: for latency, and for input that no page would send."""

from tests.experiments.workbench.wire import WireClient

__all__ = ["WireClient"]
