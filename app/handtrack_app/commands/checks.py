"""Commands that check and measure: a session, a model's definition, poses against the truth, this machine's speed, its kernels."""

from __future__ import annotations

import re
import time
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import tomlkit

from handtrack.bench.registry import QUICK, benchmark
from handtrack.capture.calibration.rig_picture import draw_rig
from handtrack.diagnostics.metrics import evaluate, in_truths_landmarks
from handtrack.errors import HandtrackError
from handtrack.export.motion import urdf_text
from handtrack.files.atomic import replace_text, replacing
from handtrack.model.articulated import JOINT_CENTRES, ArticulatedModel
from handtrack.model.model_file import load_model, read_definition
from handtrack.session.doctor.check_agreement import joint_lines
from handtrack.session.doctor.check_views import SEVERITIES, Finding
from handtrack.session.doctor.examine import examine
from handtrack.session.session import Session
from handtrack.session.sources.video_audits import keep_audits
from handtrack.session.tables import read_npz
from handtrack.session.truth import import_truth
from handtrack_app.commands.output import Answer, output_file, print_status

_SIZES_M = (0.02, 3.0)
"""of what may be tracked: a small gripper to more than a tall body"""
_THIN_M = 1e-4
_ROBOT = ".urdf"


def check_model(file: Path, out: Path | None) -> Answer:
    """Check a definition and say what is in it; write it as TOML, or as a robot's URDF, where that is asked for."""
    if out is not None:
        output_file(out, (".toml", _ROBOT), "definitions and robots are")
        if out.exists():
            raise HandtrackError(f"--out {out}: there is such a file already; name another one.")  # fmt: skip
    model = load_model(file)
    odd = findings(model)
    report = {
        "name": model.name, "kind": model.kind, "bones": len(model.skeleton.bone_names),
        "freedoms": list(model.parameter_names[6:]), "joints": list(model.joint_names),
        "ellipsoids": {key: len(ellipsoids.bone) for key, ellipsoids in model.ellipsoids.items()}, "findings": odd, "output": out,
    }  # fmt: skip
    if out is not None:
        if out.suffix.lower() == _ROBOT:
            text = urdf_text(model)
        else:
            text = f"# Made of {file.name}. What the numbers mean: docs/reference/definitions.md.\n\n{tomlkit.dumps(read_definition(file))}"
        replace_text(out, text)
    shapes = ", ".join(
        f"{count} ellipsoids in {key}" for key, count in report["ellipsoids"].items()
    )
    words = (
        f"{model.name}: {report['bones']} bones, {len(report['freedoms'])} freedoms besides the root's six, "
        f"{len(report['joints'])} joints, {shapes}. {'Nothing odd was found.' if not odd else ''}"
    )
    written = [] if out is None else [f"written to {out}; to use it: [hand], model in a session, or load_model()"]  # fmt: skip
    return Answer(report, [words.rstrip(), *(f"warning: {text}" for text in odd), *written])


def findings(model: ArticulatedModel) -> list[str]:
    """Return what is odd about a model, in sentences."""
    low, high = model.limits.interval[6:].T
    names, bones = model.parameter_names[6:], model.skeleton.bone_names
    rest = model.rest[6:]
    odd = [f"freedom '{n}' has no room: its limits are equal" for n, a, b in zip(names, low, high) if a == b]  # fmt: skip
    odd += [
        f"freedom '{name}': its rest of {np.rad2deg(r):.0f}° is outside of its limits"
        for name, r, a, b in zip(names, rest, low, high) if not a - 1e-9 <= r <= b + 1e-9
    ]  # fmt: skip
    bare = [
        bone for b, bone in enumerate(bones) if b not in set(model.ellipsoids["fine"].bone.tolist())
    ]
    moving = {bones[b] for b in model.skeleton.hinge_bone}
    last = [b for b in bare if b in moving and bones.index(b) not in model.skeleton.parent]
    odd += [f"bone '{bone}' moves but has no ellipsoid: silhouettes cannot measure it" for bone in last]  # fmt: skip
    ellipsoids = model.ellipsoids["fine"]
    thin = np.flatnonzero(ellipsoids.radii.min(axis=1) < _THIN_M)
    odd += [f"ellipsoid {bones[ellipsoids.bone[n]]}_{n} is thinner than 0.1 mm" for n in thin]
    size = float(np.ptp(model.joint_positions(model.bones(model.rest_params())), axis=0).max())
    if not _SIZES_M[0] < size < _SIZES_M[1]:
        odd.append(f"its joints are {size:.3g} m apart at most: is the unit wrong? Definitions are in millimetres, URDF in metres")  # fmt: skip
    return odd


# ---- `handtrack evaluate`: standard metrics against the truth


_FAR_MM = 1000.0
_COLUMNS = {
    "error mm": ("position_", "_mm"),
    "beside offset mm": ("position_", "_offset_free_mm"),
    "flexion °": ("flexion_", "_deg"),
    "beside offset °": ("flexion_", "_offset_free_deg"),
    "points": ("used_", ""),
}
"""of the table of joints: what stands before and after a joint's name in the name of its figure"""
_OF_A_JOINT = re.compile(r"position_(?!.*_offset_free_mm$).*_mm")


def compare_with_truth(poses: Path, truth: Path, landmarks: str | None) -> Answer:
    """Return the metrics; for people those of joints are a table of their own."""
    track = read_npz(poses)
    reference, note = import_truth(truth, track.side)
    if note:
        print_status(f"note: {note}")
    try:
        compared = in_truths_landmarks(track, reference, landmarks)
        definition = compared.keypoint_definition or JOINT_CENTRES
        metrics = evaluate(compared, reference, definition)
    except HandtrackError as error:
        raise HandtrackError(f"{poses} and {truth}: {error}") from None
    median = metrics["mpjpe_median_mm"]
    if median is not None and median > _FAR_MM:
        print_status(
            f"note: result and truth are {median / 1000:.3g} m apart (median). Is {truth} in metres, and in the world of "
            "the calibration?"
        )
    theirs, others = reference.keypoint_definition, " or ".join(track.landmark_definitions)
    if theirs not in (None, definition):
        print_status(f"note: the points of {truth} are {theirs}; compared are {definition}.")
    elif others and theirs is None and landmarks is None:
        print_status(f"note: compared are {definition}; --landmarks compares others: {others}.")
    joints = [name[9:-3] for name in metrics if _OF_A_JOINT.fullmatch(name)]
    rows = {j: [f"{head}{j}{tail}" for head, tail in _COLUMNS.values()] for j in joints}
    in_table = {name for row in rows.values() for name in row}
    report = metrics | {"keypoint_definition": definition}
    lines = [f"{name:24s} {_shown(v)}" for name, v in report.items() if name not in in_table]
    lines += ["", "".join([f"{'':12s}", *(f"{title:>18s}" for title in _COLUMNS)])]
    for joint, row in rows.items():
        cells = (f"{_shown(metrics.get(name)):>18s}" for name in row)
        lines.append("".join([f"{joint:12s}", *cells]))
    return Answer(report, lines)


def _shown(value: object) -> str:
    return "-" if value is None else f"{value:.4g}" if isinstance(value, float) else str(value)


# ---- `handtrack bench`: each figure beside its reference, measured in one run


def run_benchmarks(name: str | None) -> Answer:
    """Return each figure, as contracts §3 has it."""
    chosen = [name] if name else [*QUICK]
    figures: dict[str, dict[str, object]] = {}
    for one in chosen:
        measure = benchmark(one)
        print_status(f"{one} …")
        figures[one] = measure()
    lines = [
        line
        for title, figure in figures.items()
        for line in (title, *(f"  {key:24s} {_shown(value)}" for key, value in figure.items()))
    ]
    return Answer(figures, lines)


# ---- `handtrack warmup`: compile ahead what tracking would compile at its first frame


def compile_kernels() -> Answer:
    """Track a small frame of every kind; numba keeps what it compiles for later runs."""
    from handtrack.simulation.warm_up import warm_up  # slow to import

    begun = time.perf_counter()
    for kind in warm_up():
        print_status(f"compiled for {kind}")
    seconds = time.perf_counter() - begun
    words = f"ready after {seconds:.0f} s; kept for this machine and this version"
    return Answer({"seconds": round(seconds, 1)}, [words])


# ---- `handtrack doctor`: what is odd about a session


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
