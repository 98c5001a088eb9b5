"""What of a new session is given, and what is found out: calibration, model, side of the hand, a Pose2Sim project."""

from __future__ import annotations

import math
from argparse import Namespace
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from handtrack.capture.calibration.formats.imported_rig import ImportedRig
from handtrack.capture.calibration.formats.read_calibration import read_calibration
from handtrack.capture.calibration.formats.resolve import (
    Unit,
    named,
    pinholes,
    sized,
    unit_of,
    with_lens,
)
from handtrack.capture.images.openpose import LAYOUTS, height
from handtrack.capture.joints.pose2sim import Pose2SimProject, read_pose2sim
from handtrack.capture.joints.subject import BODY, HAND, Subject, subject_length
from handtrack.errors import HandtrackError
from handtrack.geometry.camera import CameraRig
from handtrack.session.session import Session
from handtrack.session.session_file import BODY_TRACKING, is_definition
from handtrack_app.commands.new_session.recordings import (
    Recorded,
    Recording,
    in_views,
    joint_regions,
    joints_of,
    sizes_of,
)
from handtrack_app.commands.terminal.output import can_ask, confirmed, print_status, question


def given_rig(
    options: Namespace, recording: Recording, kind: Subject
) -> tuple[CameraRig, dict[str, Recorded], list[str]]:
    """Return all cameras of the calibration, with the recording's names, in metres; the recording as they see it, some perhaps in
    pinhole views of other lenses; and what was assumed, in sentences.

    kind: what is tracked. Raises HandtrackError where something cannot be known.
    """
    paths, unit_m = options.calibration, options.world_unit_m
    where = " and ".join(map(str, paths))
    try:
        given, assumed = named(read_calibration(paths), list(recording), where)
        given = _with_lens(given, options.lens, where)
        given = sized(given, sizes_of(recording), where)
        shown, views = pinholes(given, joint_regions(recording, given))
        seen = in_views(recording, views)
        length = _length(shown.rig(1.0), seen, kind)
        unit = unit_of(given, length, kind) if unit_m is None else Unit(unit_m, True, "")
        chosen = (
            unit.unit_m
            if unit.sure and unit.unit_m
            else _asked(unit, where, options.yes, kind.word)
        )
        rig = shown.rig(chosen)
    except HandtrackError as error:
        text = str(error)
        raise HandtrackError(
            text if any(str(p) in text for p in paths) else f"{where}: {text}"
        ) from None
    notes = [
        assumed,
        f"unit: {unit.why if unit.sure else f'{chosen:g} m.'}" if unit_m is None else "",
    ]
    if length is not None and not kind.fits(length * chosen):
        notes.append(
            f"note: with {chosen:g} m a unit, the joints make a {kind.word} {100 * length * chosen:.3g} cm long; expected "
            f"{kind.range_words}. Is the unit right, and do cameras, joints and frames belong together?"
        )
    for name, lens in {view.name: lens for lens, view in views.values()}.items():
        tiles = [(tile, view.size) for tile, (_, view) in views.items() if view.name == name]
        shown = ", ".join(f"{tile} ({w} × {h})" for tile, (w, h) in tiles)
        bent = "a fisheye lens" if lens.fisheye else "a lens with skew"
        notes.append(
            f"camera '{name}' has {bent}: its images are undistorted to a pinhole view, {shown}."
        )
    return rig, seen, [text for text in notes if text not in ("", "unit: ")]


def _length(rig: CameraRig, recording: Recording, kind: Subject) -> float | None:
    """Return how long what is tracked is, in the rig's unit, where joints tell it."""
    observed = {name: joints for name, joints in joints_of(recording).items() if name in rig}
    pixels = {name: joints.pixels(rig[name].size) for name, joints in observed.items()}
    layouts = {name: LAYOUTS[joints.layout(USUAL)] for name, joints in observed.items()}
    return subject_length(rig, pixels, layouts, kind)


def _with_lens(given: ImportedRig, lens: str | None, where: str) -> ImportedRig:
    """Ask for the lens model where the calibration leaves it open; no proposal is made, so nothing is taken unasked."""
    try:
        return with_lens(given, lens, where)
    except HandtrackError as error:
        if lens is not None:
            raise
        if not can_ask():
            raise HandtrackError(
                f"{error} Say which with --lens plain or --lens fisheye. Nothing was written."
            ) from None
        print_status(str(error))
        answer = question("Which lens, plain or fisheye?", "")
        if answer not in ("plain", "fisheye"):
            raise HandtrackError(f"the lens '{answer}'; expected plain or fisheye.") from None
        return with_lens(given, answer, where)


def _asked(result: Unit, where: str, yes: bool, what: str) -> float:
    """Return the unit that the user says, or agrees to."""
    proposal = result.unit_m
    if yes and proposal is not None:
        return proposal
    if can_ask() and not yes:
        print_status(f"{where}: {result.why}")
        answer = question(
            "How many metres is one unit of it?", "" if proposal is None else f"{proposal:g}"
        )
        try:
            unit = float(answer)
        except ValueError:
            unit = math.nan
        if not 0 < unit < math.inf:
            raise HandtrackError(f"the answer '{answer}': expected metres above 0.")
        return unit
    maybe = "" if proposal is None else f" ({proposal:g} would be usual for a {what})"
    raise HandtrackError(
        f"{where}: {result.why} Give the metres in one unit with --world-unit-m{maybe}: 1 for metres, 0.001 for "
        "millimetres, the side of a square in metres for a board counted in squares. Nothing was written."
    )


# ---- The model of a new session, and a body's settings


USUAL_MODELS = {HAND: "hand26", BODY: "body34"}
_JOINT_ERROR_M = 0.025
"""of a detector's joints of bodies, against markers: 16 to 50 mm (Needham et al. 2021)"""


def definition_of(model: str) -> Path | None:
    """Return the definition that a model's path names; None for a model's name. Raises HandtrackError."""
    file = Path(model) if is_definition(model) else None
    if file is not None and not file.is_file():
        raise HandtrackError(
            f"--model {model}: no such file; expected a definition, or {' or '.join(USUAL_MODELS.values())}."
        )
    return file


def tracking_of(
    kind: Subject, recording: Recording, sizes: Mapping[str, tuple[int, int]]
) -> Mapping[str, object]:
    """Return [tracking] of what is tracked: of a body as coarse as it is large. sizes: of cameras' images [px]."""
    if kind is not BODY:
        return {}
    heights = [
        height(points)
        for name, joints in joints_of(recording).items()
        for points in joints.pixels(sizes[name]).values()
    ]
    if not heights:
        return dict(BODY_TRACKING)
    sigma_px = float(np.median(heights)) * _JOINT_ERROR_M / BODY.size_m
    return BODY_TRACKING | {"keypoints": {"sigma_px": round(max(sigma_px, 0.1), 1)}}


# ---- Which hand was recorded: said by the user, else seen by the detector, where its weights are there


USUAL = "right"
_SURE = 0.9  # below, somebody is asked


def check_detector(options: Namespace, wanted: bool) -> str:
    """Return what is missing for the hand to be found in images, in a sentence, or nothing. Raises HandtrackError for a file
    that was named and cannot be used. wanted: it will be looked for, so that a detector is fetched if that is agreed to.
    """
    from handtrack.detector.weights import DOWNLOAD_MB, fetch_weights, has_weights
    from handtrack.session.detection import HandDetector

    weights = options.detector
    offer = f"The hand detector is not installed. Fetch it now, {DOWNLOAD_MB} MB by pip?"
    try:
        if wanted and weights is None and not has_weights() and (options.yes or confirmed(offer)):
            print_status(f"fetching the hand detector, {DOWNLOAD_MB} MB …")
            fetch_weights()
        HandDetector.open(weights)
    except HandtrackError as error:
        if weights is not None:
            raise HandtrackError(str(error).replace("--weights", "--detector")) from None
        return str(error)
    return ""


def side_of_hand(session: Session, options: Namespace) -> str:
    """Return the side that the images show, with how sure that is said; asked where it is not sure, `right` where nobody knows.

    Weights must be there.
    """
    from handtrack.session.detection import HandDetector, observed_side

    print_status("looking which hand it is …")
    side, confidence, count, looks = observed_side(session, HandDetector.open(options.detector))
    observed = f"a hand is detected in {count} of {looks} images"
    if not count:
        print_status(
            f"note: {observed}; the side is taken to be {USUAL}. Use --side left for a left hand."
        )
        return USUAL
    percent = f"{100 * confidence:.0f} % sure"
    if confidence >= _SURE or options.yes or not can_ask():
        warning = "" if confidence >= _SURE else " The confidence is low: give --side."
        print_status(f"side: {side}, {percent} ({observed}).{warning}")
        return side
    answer = ""
    while answer not in ("right", "left"):
        answer = question(
            f"side: {side}, {percent} ({observed}). Which hand is it, right or left?", side
        )
    return answer


# ---- A project of another program (`handtrack new --project`)


def fill_by_project(options: Namespace) -> Pose2SimProject | None:
    """Fill in what the user left open by the project's folder; return the project, None without one. Raises HandtrackError."""
    if options.folder is not None:
        raise HandtrackError(
            f"unexpected '{options.folder}'. For a Pose2Sim project or trial, write --project {options.folder}; a camera's video is given "
            "with --video CAMERA=FILE."
        )
    if options.project is None:
        if not options.calibration:
            raise HandtrackError(
                "give the cameras with --calibration FILE, or a Pose2Sim project with --project FOLDER."
            )
        return None
    if len(options.calibration) > 1:
        raise HandtrackError("--project: expected one --calibration at most.")
    project = read_pose2sim(options.project, next(iter(options.calibration), None))
    options.calibration = [project.calibration]
    for kind, theirs in (
        ("video", project.videos), ("images", project.images), ("keypoints", project.keypoints),
    ):  # fmt: skip
        given = getattr(options, kind)
        more = {name: str(path) for name, path in theirs.items() if name not in given}
        setattr(options, kind, given | more)
    options.fps = project.fps if options.fps is None else options.fps
    return project
