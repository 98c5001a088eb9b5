"""`handtrack doctor`: what is odd about a session."""

from __future__ import annotations

import argparse

from handtrack.session.session import Session


def run(args: argparse.Namespace) -> int:
    """Print the findings, the gravest first."""
    session = Session.open(args.session)
    print(
        f"{session.name}: {len(session.camera_names)} cameras, {session.frame_count} frames, {session.fps:g} frames a second"
    )
    findings = session.doctor()
    for finding in findings:
        print(f"{finding.severity}: {finding.text}")
    if not findings:
        print("nothing odd was found.")
    return 0
