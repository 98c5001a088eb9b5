"""On request: what stands in the workbench goes into the session's own files, the one before kept."""

from __future__ import annotations

from handtrack.capture.masks.segmentation import METHODS
from handtrack.errors import HandtrackError
from handtrack.files.atomic import keep_version, replacing
from handtrack.files.toml_edit import edit_toml
from handtrack.files.toml_table import read_toml
from handtrack.model.model_file import write_scale
from handtrack.session.first_pose.first_pose import FirstPose, write_first_pose
from handtrack.session.formats.tables import write_npz
from handtrack.session.layout import HAND_FILE, INIT_FILE, POSES_FILE, SESSION_FILE
from handtrack.session.session_state import MaskSource
from handtrack.session.takes import file_digest
from handtrack_app.engine.document import usual_values
from handtrack_app.engine.store.persistence import Persistence, whole_track
from handtrack_app.protocol.snapshots import FileKind

_SETTINGS = "a session's settings"


def save_first_pose(store: Persistence) -> str:
    """Write the pose shown to init.json; return a sentence about it."""
    store.check()
    document = store.document
    values = {name: round(v, 6) for name, v in document.model.named(document.shown).items()}
    path = store.folder / INIT_FILE
    try:
        said = _keep_hand_size(store)
        keep_version(path)
        size = document.run.scale if document.size.pending else None
        pose = FirstPose(document.frame, values, scale=size)
        write_first_pose(path, pose)
    except OSError as error:
        raise HandtrackError(
            f"{path}: cannot be written ({error.strerror}). Is the folder read-only?"
        ) from None
    document.start_from(pose)
    return f"Tracking will start from frame {document.frame} with this pose ({path.name}).{said}"


def _keep_hand_size(store: Persistence) -> str:
    """A size that was fitted from the first pose of before belongs to it: it gets its own file."""
    run, path = store.document.run, store.folder / SESSION_FILE
    if store.document.size.pending or not path.is_file():
        return ""
    hand = read_toml(path, _SETTINGS).get("hand")
    if not isinstance(hand, dict) or hand.get("scale") != "fit":
        return ""
    keep_version(store.folder / HAND_FILE)
    write_scale(store.folder / HAND_FILE, run.scale)
    edit_toml(path, {"hand.scale": HAND_FILE}, _SETTINGS)
    return f" The fitted size is kept in {HAND_FILE}."


_TABLES = {"setting": "tracking", "clouds": "clouds"}


def save(store: Persistence, kind: FileKind) -> str:
    """Write what was changed of a kind into session.toml, which says it from now on; return a sentence about it."""
    store.check()
    document = store.document
    now, unsaved = document.settings, document.unsaved(kind)
    if not unsaved:
        return "session.toml has these settings already."
    if kind == "masks":
        what, changes = "Masks", dict[str, object]()
        for number, camera in enumerate(document.session.file.cameras):
            if (name := camera.name) in unsaved:
                saved = document.saved["masks"][name]
                changes |= _mask_changes(f"camera.{number}", now["masks"][name], saved)
                changes[f"camera.{number}.mask_unknown"] = camera.mask_unknown
    else:
        what, values = f"[{_TABLES[kind]}]", now[kind]
        changes = {f"{_TABLES[kind]}.{name}": values.get(name) for name in unsaved}
    kept = edit_toml(store.folder / SESSION_FILE, changes, _SETTINGS)
    document.saved = {**document.saved, kind: now[kind]}
    store.leave_to_the_file(kind)
    store.flush()
    return f"{what} of session.toml: {', '.join(unsaved)}.{kept}"


def _mask_changes(place: str, now: MaskSource, saved: MaskSource) -> dict[str, object]:
    """Return what is to be changed of a camera's table: of the same method only what differs."""
    table, known = now.masks, saved.masks
    changes: dict[str, object] = {f"{place}.roi": None if now.roi is None else list(now.roi)}
    if not isinstance(table, dict):
        return changes | {f"{place}.masks": table}
    if isinstance(known, dict) and known["method"] == table["method"]:
        differ = {key: value for key, value in table.items() if value != known[key]}
        return changes | {f"{place}.masks.{key}": value for key, value in differ.items()}
    usual = usual_values(METHODS[table["method"]])
    said = {k: v for k, v in table.items() if k not in usual or v != usual[k]}
    return changes | {f"{place}.masks": said}


def save_track(store: Persistence) -> str:
    """Write tracks/poses.npz; return a sentence about it."""
    store.check()
    path = store.folder / POSES_FILE
    track = whole_track(store.document)
    try:
        path.parent.mkdir(exist_ok=True)
        previous = keep_version(path)
        with replacing(path) as part:
            write_npz(part, track)
            if store.store is not None:  # known before it is there: else it would become a take
                store.store.know_file(file_digest(part))
    except OSError as error:
        raise HandtrackError(
            f"{path}: cannot be written ({error.strerror}). Is the folder read-only?"
        ) from None
    kept = f" The one before is kept as {previous.name}." if previous is not None else ""
    return f"{len(track)} frames are in {path}.{kept}"
