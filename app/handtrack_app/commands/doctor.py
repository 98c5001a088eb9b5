"""`handtrack doctor`: what is odd about a session."""

from __future__ import annotations

import argparse

from handtrack.session.doctor.examine import examine
from handtrack.session.doctor.finding import SEVERITIES
from handtrack.session.seen.video_audits import keep_audits
from handtrack.session.session import Session


def run(args: argparse.Namespace) -> int:
    """Print the findings, the gravest first."""
    session = Session.open(args.session)
    session.check_init()
    findings = examine(session)
    keep_audits(session.folder, session.videos)
    for finding in sorted(findings, key=lambda found: -SEVERITIES.index(found.severity)):
        print(f"{finding.severity}: {finding.text}")
    counts = {kind: sum(f.severity == kind for f in findings) for kind in ("error", "warning")}
    odd = [f"{n} {kind}{'s' if n > 1 else ''}" for kind, n in counts.items() if n]
    print(f"{session.name}: {' and '.join(odd) or 'nothing odd was found'}.")
    return 0
