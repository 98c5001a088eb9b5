"""session.toml ↔ frozen dataclasses. Unknown keys are refused, naming the known ones."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from handtrack.capture.images.bayer import METHODS, PATTERNS
from handtrack.capture.images.openpose import LAYOUTS
from handtrack.capture.masks.segmentation import MaskMethod, mask_method_table, read_mask_method
from handtrack.errors import HandtrackError, listed_names
from handtrack.files.toml_table import TableReader
from handtrack.files.toml_text import read_toml, toml_item
from handtrack.model.model_file import MODELS
from handtrack.session.clouds_settings import CloudSettings, read_clouds

FORMAT = 1
_TABLES = ("session", "hand", "camera", "clouds", "tracking")
_BAYER = tuple(pattern.lower() for pattern in PATTERNS)


@dataclass(frozen=True)
class RecordingSettings:
    """[session]: what the recording is called and how its numbers are to be read."""

    name: str
    fps: float | None = None
    """frames a second; may be absent when timestamps are given."""
    timestamps: str | None = None
    """a csv file with the columns camera, frame, time_s."""
    world_unit_m: float = 1.0
    """metres in one unit of calibration.toml and of the clouds."""


@dataclass(frozen=True)
class HandSettings:
    """[hand]: whose hand, by which model."""

    model: str = "hand26"
    """a model's name, or the path of a definition in the folder."""
    side: str = "right"
    scale: float | str = 1.0
    """a factor, "fit" (from the keypoints of init.json), or the path of a saved hand in the
    folder."""
    forearm: bool | str = "auto"
    """whether the model has a forearm: true, false, or "auto"."""


@dataclass(frozen=True)
class CameraSettings:
    """[[camera]]: what one camera gave; whatever is absent is not observed."""

    name: str
    images: str | None = None
    """a video, or a pattern of numbered files."""
    masks: str | MaskMethod | None = None
    """a pattern of numbered files, or how masks are computed."""
    roi: tuple[int, int, int, int] | None = None
    """x, y, w, h [px] in the image as it was taken; outside of it nothing counts as observed."""
    depth: str | None = None
    """a pattern of numbered 16 bit files."""
    depth_scale_m: float | None = None
    """metres in one unit of the depth files."""
    bayer: str | None = None
    """the images are raw mosaics (8 or 16 bit files) of this pattern: rggb, bggr, grbg or gbrg."""
    demosaic: str | None = None
    """how mosaics become colour images."""
    white_level: float | None = None
    """the value of a mosaic that becomes 255."""
    keypoints: str | None = None
    """a pattern of numbered files of 2D joints, as OpenPose writes them."""
    keypoint_layout: str | None = None
    """which of their points are which joints: body_25, body_25b, hand_left or hand_right."""


@dataclass(frozen=True)
class SessionFile:
    """All that session.toml says."""

    session: RecordingSettings
    hand: HandSettings
    cameras: tuple[CameraSettings, ...]
    clouds: CloudSettings | None = None
    tracking: Mapping[str, Any] = field(default_factory=dict)
    """nested tables as written; the tracker checks them, see `dotted`."""


def is_definition(model: str) -> bool:
    """Return whether [hand] model is the path of a definition, and no model's name."""
    return model.endswith(".toml") or "/" in model


def dotted(tracking: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return nested settings by the names that `--set` takes, such as `silhouettes.weight`."""
    flat: dict[str, Any] = {}
    for key, value in tracking.items():
        if isinstance(value, Mapping):
            flat |= dotted(value, f"{prefix}{key}.")
        else:
            flat[prefix + key] = value
    return flat


def read_session_file(path: Path) -> SessionFile:
    """Return the settings of a session.toml. Raises HandtrackError naming file, table and key."""
    tables = read_toml(path, "a session's settings")
    for name in tables:
        if name not in _TABLES:
            raise HandtrackError(
                f"{path}: unknown key '{name}'; {listed_names(name, _TABLES, 'known tables')}"
            )
    if "session" not in tables:
        raise HandtrackError(
            f"{path}: the table [session] is missing; it needs `format = {FORMAT}` and `fps`."
        )
    recording = _recording(TableReader(tables["session"], f"{path}, [session]"), path)
    hand = _hand(TableReader(tables.get("hand", {}), f"{path}, [hand]"))
    cameras = _cameras(tables.get("camera"), path)
    clouds = None
    if "clouds" in tables:
        clouds = read_clouds(tables["clouds"], cameras, f"{path}, [clouds]")
    tracking = tables.get("tracking", {})
    if not isinstance(tracking, Mapping):
        raise HandtrackError(f"{path}: tracking = {tracking}; expected a table [tracking].")
    return SessionFile(recording, hand, cameras, clouds, tracking)


def write_session_file(path: Path, file: SessionFile) -> None:
    """Write a session.toml that reads back as the same settings."""
    import tomlkit  # slow to import, and most commands only read

    tables = {
        "session": _items({"format": FORMAT, **vars(file.session)}),
        "hand": _items(vars(file.hand)),
        "camera": [_items(_camera_values(camera)) for camera in file.cameras],
        "clouds": _items(file.clouds.table if file.clouds else {}),
        "tracking": dict(file.tracking),
    }
    text = tomlkit.dumps({name: table for name, table in tables.items() if table})
    Path(path).write_text(text, encoding="utf-8")


def _camera_values(camera: CameraSettings) -> dict[str, Any]:
    masks = camera.masks
    return vars(camera) | {
        "masks": masks if isinstance(masks, str | None) else mask_method_table(masks)
    }


def _items(values: Mapping[str, Any]) -> dict[str, Any]:
    return {key: toml_item(value) for key, value in values.items() if value is not None}


def _recording(table: TableReader, path: Path) -> RecordingSettings:
    version = table.whole("format", None, 1)
    if version > FORMAT:
        raise HandtrackError(
            f"{path}: format = {version}, but this handtrack reads format {FORMAT}. The session "
            "was written by a newer handtrack: update handtrack."
        )
    has_fps = table.raw("fps") is not None
    timestamps = table.text("timestamps") if table.raw("timestamps") is not None else None
    recording = RecordingSettings(
        name=table.text("name", path.resolve().parent.name or "session"),
        fps=table.number("fps", above=0.0, unit="1/s") if has_fps else None,
        timestamps=timestamps,
        world_unit_m=table.number("world_unit_m", 1.0, above=0.0, unit="m"),
    )
    table.finish()
    if recording.fps is None and timestamps is None:
        raise HandtrackError(
            f"{table.where}: give `fps` (frames a second) or `timestamps` (a csv file)."
        )
    return recording


def _hand(table: TableReader) -> HandSettings:
    model = table.text("model", HandSettings.model)
    if model not in MODELS and not is_definition(model):
        known = listed_names(model, MODELS, "known models")
        raise HandtrackError(
            f'{table.where}: model = "{model}" is no model, and no path of a definition (.toml); {known}'
        )
    side = table.choice("side", ("right", "left"), HandSettings.side)
    scale = table.raw("scale")
    forearm = table.raw("forearm")
    if forearm not in (None, "auto", True, False):
        raise table.error("forearm", forearm, 'true, false or "auto"')
    hand = HandSettings(
        model=model,
        side=side,
        scale=scale if isinstance(scale, str) and scale else table.number("scale", 1.0, above=0.0),
        forearm=HandSettings.forearm if forearm is None else forearm,
    )
    table.finish()
    return hand


def _cameras(tables: Any, path: Path) -> tuple[CameraSettings, ...]:
    if not isinstance(tables, list) or not tables:
        raise HandtrackError(
            f"{path}: no camera; expected at least one table [[camera]] (two brackets)."
        )
    cameras = tuple(
        _camera(TableReader(t, f"{path}, [[camera]] number {i + 1}")) for i, t in enumerate(tables)
    )
    names = [camera.name for camera in cameras]
    for name in names:
        if names.count(name) > 1:
            raise HandtrackError(
                f"{path}: two tables [[camera]] have the name '{name}'; one a camera is expected."
            )
    return cameras


def _camera(table: TableReader) -> CameraSettings:
    name = table.text("name")
    table.where = f"{table.where.rsplit(', ', 1)[0]}, camera '{name}'"
    images = table.text("images") if table.raw("images") is not None else None
    depth = table.text("depth") if table.raw("depth") is not None else None
    masks = table.raw("masks")
    if masks is not None and not isinstance(masks, str):
        masks = read_mask_method(masks, f"{table.where}, masks")
        if (images if masks.needs == "images" else depth) is None:
            raise HandtrackError(
                f'{table.where}: masks by the method "{masks.name}" need the camera\'s '
                f"`{masks.needs}`, which is missing."
            )
    roi = table.whole_list("roi", None, "x y w h") if table.raw("roi") is not None else None
    if roi is not None and (min(roi[:2]) < 0 or min(roi[2:]) < 1):
        raise table.error("roi", list(roi), "[x, y, w, h] in pixels, inside the image")
    scale = (
        table.number("depth_scale_m", above=0.0, unit="m")
        if table.raw("depth_scale_m") is not None
        else None
    )
    if depth is not None and scale is None:
        raise HandtrackError(
            f"{table.where}: depth needs `depth_scale_m`, the metres in one unit of its files."
        )
    bayer, method, white = _mosaic(table, images)
    joints, layout = _keypoints(table)
    table.finish()
    box = None if roi is None else (roi[0], roi[1], roi[2], roi[3])
    mosaic = (bayer, method, white)
    return CameraSettings(name, images, masks, box, depth, scale, *mosaic, joints, layout)


def _keypoints(table: TableReader) -> tuple[str | None, str | None]:
    """Return the pattern of a detector's files and their layout; None where not given."""
    joints = table.text("keypoints") if table.raw("keypoints") is not None else None
    if table.raw("keypoint_layout") is None:
        return joints, None
    if joints is None:
        raise HandtrackError(
            f"{table.where}: keypoint_layout says how `keypoints` are to be read, which is missing."
        )
    return joints, table.choice("keypoint_layout", tuple(LAYOUTS), "body_25")


def _mosaic(table: TableReader, images: str | None) -> tuple[str | None, str | None, float | None]:
    """Return pattern, method and white level of raw mosaics; None where not given."""
    given = [key for key in ("bayer", "demosaic", "white_level") if table.raw(key) is not None]
    if not given:
        return None, None, None
    if "bayer" not in given:
        raise HandtrackError(
            f"{table.where}: {given[0]} is about raw mosaics, but their pattern `bayer` is missing; expected one of "
            f"{', '.join(_BAYER)}."
        )
    if images is None:
        raise HandtrackError(
            f"{table.where}: bayer says how `images` are to be read, which is missing."
        )
    return (
        table.choice("bayer", _BAYER, _BAYER[0]),
        table.choice("demosaic", METHODS, METHODS[0]) if "demosaic" in given else None,
        table.number("white_level", above=0.0) if "white_level" in given else None,
    )
