"""`handtrack doctor`: what is odd about a session."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2

from handtrack.capture.calibration.rig_picture import draw_rig
from handtrack.files.atomic import replacing
from handtrack.session.doctor.check_agreement import joint_lines
from handtrack.session.doctor.check_views import SEVERITIES, Finding
from handtrack.session.doctor.examine import examine
from handtrack.session.session import Session
from handtrack.session.sources.video_audits import keep_audits
from handtrack_app.commands.terminal.output import Answer, output_file


def check_session(session: Path, picture: Path | None) -> Answer:
    """Print the findings, the gravest first; draw the rig where that is asked for."""
    if picture is not None:
        output_file(picture, (".png",), "pictures are", option="--picture")
    opened = Session.open(session)
    opened.check_init()
    findings = examine(opened)
    keep_audits(opened.folder, opened.videos)
    findings = sorted(findings, key=lambda found: -SEVERITIES.index(found.severity))
    counts = {kind: sum(f.severity == kind for f in findings) for kind in ("error", "warning")}
    odd = [f"{n} {kind}{'s' if n > 1 else ''}" for kind, n in counts.items() if n]
    lines = [f"{finding.severity}: {finding.text}" for finding in findings]
    lines.append(f"{opened.name}: {' and '.join(odd) or 'nothing odd was found'}.")
    if picture is not None:
        _draw(opened, findings, picture)
        lines.append(f"the rig is drawn in {picture}.")
    report = [{"severity": finding.severity, "text": finding.text} for finding in findings]
    return Answer({"session": opened.name, "findings": report, "picture": picture}, lines)


def _draw(session: Session, findings: Sequence[Finding], out: Path) -> None:
    """Draw cameras and hand from three sides; cameras that a warning or an error names are orange."""
    grave = " ".join(f.text for f in findings if f.severity in ("warning", "error"))
    odd = [name for name in session.rig.names if f"'{name}'" in grave]
    picture = draw_rig(session.rig, joint_lines(session), odd)
    with replacing(out) as path:
        path.write_bytes(cv2.imencode(".png", picture)[1].tobytes())
