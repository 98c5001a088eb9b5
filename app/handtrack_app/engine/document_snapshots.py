"""Snapshots of a document: the session, the pose shown and the whole recording, as the page draws them."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import get_args

import numpy as np

from handtrack.arrays import Floats, Ints, N
from handtrack.capture.masks.segmentation import METHODS
from handtrack.diagnostics.review import ReviewInterval, intervals_to_review
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.kinematics import BonePoses
from handtrack.model.pose_library import pose_names, pose_title
from handtrack.model.size import shape_numbers
from handtrack.session.session import Session
from handtrack.session.session_file import CloudSettings
from handtrack.session.sources.views import View
from handtrack.store.store import resolved
from handtrack.terms.keypoints import pinned_places
from handtrack.tracking.frame.confidence import hand_words
from handtrack.tracking.frame.result import FrameResult
from handtrack_app.engine.document import Document, mask_source
from handtrack_app.engine.inverse_kinematics import stem_bones
from handtrack_app.protocol import (
    BEFORE,
    CLOUD,
    ERROR,
    FILES,
    HAND_REACH_M,
    IMAGES,
    KEYPOINTS,
    NO_MASKS,
    PROBABILITY,
    SILHOUETTES,
    CloudCard,
    FileKind,
    Hold,
    MaskCameraCard,
    PartCard,
    PinCard,
    PoseSnapshot,
    SessionSnapshot,
    TimelineChange,
    TimelineSnapshot,
)

_BODY_REACH_M = 0.9
_PART_GRID = (20, 16)  # points around and steps along a part that is drawn


def session_snapshot(document: Document) -> SessionSnapshot:
    """Return everything the page is built from."""
    session, model = document.session, document.model
    driving = {model.parameter_names[s] for s in model.driving_joints}
    ellipsoids = model.ellipsoids["fine"]
    return SessionSnapshot(
        name=session.name,
        folder=str(session.folder),
        fps=float(session.fps),
        first_frame=document.first_frame,
        cameras=tuple(camera.without_distortion() for camera in session.rig.cameras),
        clouds=cloud_card(document),
        masks=(masks := mask_cards(document)),
        mask_words=mask_words(masks),
        parameter_names=model.parameter_names,
        driven=tuple(n for n in model.parameter_names if n not in driving),
        interval=model.limits.interval.copy(),
        own_interval=document.own_interval.copy(),
        bone_names=model.skeleton.bone_names,
        bone_length=model.skeleton.length,
        ellipsoid_bone=ellipsoids.bone,
        radii=ellipsoids.radii,
        settings=dict(document.run.settings.flat()),
        unsaved={kind: document.unsaved(kind) for kind in get_args(FileKind)},
        has_truth=session.truth is not None,
        joint_names=model.joint_names,
        stem_bones=stem_bones(model),
        poses=pose_titles(model),
        model=model_words(model),
        kind=model.kind,
        observed=observed_kinds(session),
        parts=part_cards(model),
        reach_m=_BODY_REACH_M * model.scale.overall if model.kind == "body" else HAND_REACH_M,
        live=session.live is not None,
        size_pending=document.size.pending,
        shape=tuple(shape_numbers(model)),
    )


def observed_kinds(session: Session) -> frozenset[str]:
    """Return what a recording has of what can be seen of the model."""
    cameras = [view.settings for view in session.views]
    there = {
        SILHOUETTES: any(
            view.settings.masks is not None or view.corrections.frames for view in session.views
        ),
        CLOUD: session.has_clouds,
        KEYPOINTS: any(camera.keypoints is not None for camera in cameras),
        IMAGES: session.live is not None or any(camera.images is not None for camera in cameras),
    }
    return frozenset(kind for kind, is_there in there.items() if is_there)


_PAIRS = 12  # offered for stereo


def cloud_card(document: Document) -> CloudCard:
    """Return where clouds come from and the settings in force."""
    settings = document.clouds
    views = document.session.views
    with_images = tuple(view.name for view in views if view.settings.images is not None)
    pairs, source = tuple(combinations(with_images, 2)), ""
    if settings is not None:
        source = "stereo" if settings.stereo else "depth" if settings.depth else "files"
        pairs = (*settings.stereo, *(p for p in pairs if p not in settings.stereo))
    in_force = (settings or CloudSettings()).in_force
    return CloudCard(source, in_force, with_images, pairs[:_PAIRS])


_NO_IMAGES = (
    "No camera of this recording has images, so masks can be neither computed nor shown over them."
)
_FILES = "Masks of {} are files. Choose a method to compute them from the images, or correct them below: the files stay."


def mask_cards(document: Document) -> tuple[MaskCameraCard, ...]:
    """Return where each camera's masks come from, with the settings in force."""
    cards = []
    for view in document.session.views:
        source = mask_source(view)
        table = dict(source.masks) if isinstance(source.masks, dict) else {}
        method = str(table.pop("method", NO_MASKS if source.masks is None else FILES))
        possible = possible_masks(document, view)
        cards.append(MaskCameraCard(view.name, method, table, source.roi, possible))
    return tuple(cards)


def mask_words(cards: Sequence[MaskCameraCard]) -> str:
    """Return what is to be said of where masks come from."""
    if all(set(card.possible) <= {FILES, NO_MASKS} for card in cards):
        return _NO_IMAGES
    files = [card.name for card in cards if card.method == FILES]
    return _FILES.format(", ".join(files)) if files else ""


def possible_masks(document: Document, view: View) -> tuple[str, ...]:
    """Return the mask methods that a camera has what it takes for; files where session.toml names some."""
    settings, saved = view.settings, document.saved["masks"][view.name].masks
    names = [n for n, kind in METHODS.items() if getattr(settings, kind.needs) is not None]
    if settings.keypoints is None:
        names = [name for name in names if name != "seeded"]
    return (*names, *([FILES] if isinstance(saved, str) else []), NO_MASKS)


def pose_snapshot(document: Document) -> PoseSnapshot:
    """Return the hand as it is shown."""
    model, frame, moment = document.model, document.frame, document.moment
    bones, posed = moment.bones, moment.ellipsoids
    result = document.results.get(frame)
    is_now = document.before is None
    by_hand = frame in document.by_hand
    solved = result if is_now and not by_hand else None
    return PoseSnapshot(
        frame=frame,
        version=document.version,
        values=document.displayed.copy(),
        bone_position=bones.position,
        bone_rotation=bones.rotation,
        centre=posed.centre,
        rotation=posed.rotation,
        origin=_origin(document, frame) if is_now else BEFORE,
        status=3 if by_hand else int(result.status) if result is not None else -1,
        energy=float("nan") if solved is None else float(solved.energy),
        std=None if solved is None else solved.parameter_std,
        truth=document.truth_at(frame),
        error_mm=document.error_mm(frame, bones),
        note=_note(solved) if solved is not None else "",
        joints=model.joint_positions(bones),
        pins=pin_cards(document, frame, bones) if is_now else (),
        accepted=frame in document.accepted,
    )


def _origin(document: Document, frame: int) -> str:
    if frame in document.by_hand:
        decided = document.decided_pose(frame)
        if decided.pinned:
            return "pinned"
        if decided.refitted:
            return "refitted"
        return "found" if decided.found else "set"
    return "tracked" if frame in document.results else "carried"


def timeline_snapshot(document: Document) -> TimelineSnapshot:
    """Return status, energy and error of every frame."""
    rows = document.rows
    rows.follow(document)
    rows.changed.clear()
    lanes = _lanes(document, np.arange(len(rows.frames)))
    hand = tuple(sorted(document.by_hand))
    searched = tuple(frame for frame in hand if document.decided_pose(frame).found)
    return TimelineSnapshot(
        rows.frames.start, rows.status.copy(), {word: row for word, row in lanes.items() if np.isfinite(row).any()}, hand,
        searched, document.accepted, queue(document), resolved(document.laid, document.takes.frames_of),
        resolved(document.hidden, document.takes.frames_of), document.is_posed,
        {name: one.error.figures for name, one in document.camera_errors.items()},
        document.session.corrected,
    )  # fmt: skip


def timeline_change(document: Document) -> TimelineChange:
    """Return what is new of status, energy and error since the last look: its cost does not grow with the recording."""
    rows = document.rows
    rows.follow(document)
    row = np.array(sorted(rows.changed), np.int64)
    rows.changed.clear()
    return TimelineChange(document.frames, row, rows.status[row], _lanes(document, row))


def _lanes(document: Document, row: Ints[N]) -> dict[str, Floats[N]]:
    """Return what is known of some rows, with the errors of poses that were given."""
    model, start = document.model, document.frames.start
    # that a joint is 25 mm off is much for a hand, and usual for a body
    lanes = {
        word: values[row]
        for word, values in document.rows.lanes.items()
        if word != PROBABILITY or model.kind == "hand"
    }
    given = document.by_hand if document.session.truth is not None else {}
    for n in np.flatnonzero(np.isin(row + start, [*given])).tolist():
        frame = start + int(row[n])
        error = lanes.setdefault(ERROR, np.full(len(row), np.nan))
        error[n] = document.error_mm(frame, model.bones_within_limits(given[frame]))
    return lanes


# ---- facts of a frame


def _note(result: FrameResult) -> str:
    """Return why a frame is doubtful or lost; saved results keep no more than that the fingers were held."""
    note = result.note[:1].upper() + result.note[1:]
    return f"Fingers held. {note}".rstrip(". ") + "." if result.is_simplified else note


# ---- facts of a model


def model_words(model: ArticulatedModel) -> str:
    """Return whose model it is, for the page."""
    whose = "" if model.kind == "body" else f", {model.side} hand"
    known = hand_words(model).removeprefix("hand ")
    return f"{model.name}{whose}, size {model.scale.overall:.2f}{known and f': {known}'}"


def part_cards(model: ArticulatedModel) -> tuple[PartCard, ...]:
    """Return a body's superquadrics as meshes; nothing for a hand."""
    parts = model.superquadrics
    if parts is None:
        return ()
    mesh = parts.mesh(*_PART_GRID)
    vertices = np.split(mesh.local, len(parts))
    faces = mesh.faces[: len(mesh.faces) // len(parts)]
    return tuple(PartCard(int(b), v, faces) for b, v in zip(parts.bone, vertices, strict=True))


_MOST = 500  # of the queue: nobody looks at more in one go, and what is told does not grow with the recording


def queue(document: Document) -> tuple[ReviewInterval, ...]:
    """Return the stretches that are worth a look, the worst first."""
    done = document.accepted | document.by_hand.keys()
    return tuple(intervals_to_review(document.rows.heads(), done)[:_MOST])


def pose_titles(model: ArticulatedModel) -> dict[str, str]:
    """Return the names of a model's library by what its poses are called."""
    titles = {name: pose_title(name, model.kind) for name in pose_names(model.kind)}
    return {f"{s} ({group})" if len(s) == 1 else s: name for name, (s, group) in titles.items()}


# ---- The pins of a frame as the page draws them


def pin_cards(document: Document, frame: int, bones: BonePoses) -> tuple[PinCard, ...]:
    """Return the pins of a frame beside the pose of these bones; those of places that the model lacks are left out."""
    model, session = document.model, document.session
    names = model.joint_names, model.skeleton.bone_names
    pins = [pin for pin in session.pins.of(frame) if pin.is_on(*names)]
    if not pins:
        return ()
    places, shown = bones.to_world(*pinned_places(model, pins)), []
    for n, pin in enumerate(pins):
        place = np.asarray(places[n])
        camera = session.rig[pin.camera].without_distortion()
        ray = camera.rays(np.array([pin.pixel]))[0]
        meant = camera.centre + ray * max(float((place - camera.centre) @ ray), 0.0)
        off = float(np.linalg.norm(camera.project(place[None])[0] - pin.pixel))
        words = Hold(pin.joint, pin.bone).words
        shown.append(PinCard(pin.camera, words, pin.pixel, place, meant, off))
    return tuple(shown)
