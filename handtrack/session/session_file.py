"""session.toml ↔ frozen dataclasses. Unknown keys are refused, naming the known ones."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from msgspec import Meta

from handtrack.capture.clouds.cloud_filters import CloudFilters, SkinEllipse
from handtrack.capture.clouds.stereo import StereoSettings
from handtrack.capture.images.openpose import LAYOUTS
from handtrack.capture.images.raw_frames import METHODS, PATTERNS
from handtrack.capture.masks.mask_correction import Roi
from handtrack.capture.masks.segmentation import MaskMethod, mask_method_table, read_mask_method
from handtrack.errors import HandtrackError, listed_names
from handtrack.files.toml_table import (
    FULL,
    above,
    checked_table,
    one_of,
    read_table,
    read_toml,
    required,
    shown,
    toml_item,
)
from handtrack.geometry.camera import Camera
from handtrack.geometry.rotation import rotation_vector
from handtrack.geometry.source_lens import SourceLens
from handtrack.setting import Setting, declared

# ---- [clouds]: where point clouds come from, how pairs are matched, and which points are the hand's


_CLOUD_SOURCES = ("files", "stereo", "depth")
_STEREO = "stereo_"
CLOUD_SETTINGS: dict[str, Setting] = {**declared(CloudFilters), **declared(StereoSettings, _STEREO)}
"""every setting of [clouds] by its name there, beside the source"""


_PAIRS = 'pairs of camera names, such as [["cam0", "cam1"]]'
_NAMES = 'a list of camera names, such as ["cam0"]'


@dataclass(frozen=True)
class CloudSettings:
    """[clouds]: where point clouds come from, one of `files`, `stereo` and `depth`, and what is said of filters and matching."""

    files: Annotated[str, FULL] | None = None
    """a pattern of .ply or .npz files."""
    stereo: Annotated[tuple[tuple[str, str], ...], Meta(min_length=1, description=_PAIRS)] = ()
    """pairs of cameras to match."""
    depth: Annotated[tuple[str, ...], Meta(min_length=1, description=_NAMES)] = ()
    """cameras whose depth is used."""
    given: Mapping[str, Any] = field(default_factory=dict)
    """settings by name, as far as they are given; False: off. The others are as usual for the source."""
    by_method: Mapping[str, Any] = field(default_factory=dict)
    """what the tracking method sets where nothing is given"""

    @property
    def filters(self) -> CloudFilters:
        """The filters: those given, the others as they are usual.

        From depth images the part nearest to the camera is taken unless `component` says otherwise: nothing else tells
        the hand from what is behind it. Files may come from anywhere: their distance to the cameras is looked at only
        where near_m or far_m are given.
        """
        usual = CloudFilters()
        if self.depth:
            usual = replace(usual, component="nearest")
        if self.files is not None:
            usual = replace(usual, near_m=None, far_m=None)
        return replace(usual, **self._given_of(CloudFilters))

    @property
    def matching(self) -> StereoSettings:
        """How pairs are matched."""
        given = self._given_of(StereoSettings, _STEREO)
        ranged = {name: self.given[name] for name in ("near_m", "far_m") if self.given.get(name)}
        return StereoSettings(**given, **ranged)

    @property
    def sources(self) -> tuple[object, ...]:
        """What decides on the measured clouds, before any filter."""
        return self.files, self.depth, self.stereo, self.matching if self.stereo else None

    @property
    def table(self) -> dict[str, Any]:
        """What stands in [clouds] for these settings, by its keys."""
        given = {n: asdict(v) if isinstance(v, SkinEllipse) else v for n, v in self.given.items()}
        return {key: value for key in _CLOUD_SOURCES if (value := getattr(self, key))} | given

    @property
    def in_force(self) -> dict[str, Any]:
        """Every setting by name, given or usual; None is off."""
        stereo = self.matching
        values = {name: getattr(self.filters, name) for name in declared(CloudFilters)}
        values |= {_STEREO + name: getattr(stereo, name) for name in declared(StereoSettings)}
        return values | {f"{_STEREO}window_px": stereo.window}

    def with_values(self, values: Mapping[str, Any], where: str = "[clouds]") -> CloudSettings:
        """Return a copy with settings replaced; None: as usual, False: off. `stereo`, pairs of cameras, takes another
        source's place. Raises HandtrackError naming `where` and the setting.
        """
        given, changed = dict(self.given), self
        for name, value in values.items():
            if name == "stereo":
                changed = replace(self, files=None, depth=(), stereo=value)
            elif name not in CLOUD_SETTINGS:
                known = ", ".join(sorted(CLOUD_SETTINGS))
                raise HandtrackError(f"no setting '{name}' in {where}; known: {known}")
            elif value is None:
                given.pop(name, None)
            else:
                given[name] = _accepted(CLOUD_SETTINGS[name], value, where)
        changed = replace(changed, given=given)
        near, far = changed.filters.near_m or 0.0, changed.filters.far_m or float("inf")
        if near >= far:
            raise HandtrackError(f"{where}: far_m = {far}; expected more than near_m = {near:g}.")
        return changed

    def _given_of(self, table: type[Any], prefix: str = "") -> dict[str, Any]:
        """Return what is given, or the method's, of a class of settings, by its fields."""
        said = {**self.by_method, **self.given}
        return {
            name.removeprefix(prefix): None if said[name] is False else said[name]
            for name in declared(table, prefix)
            if name in said
        }


def read_clouds(values: Any, cameras: Sequence[Any], where: str) -> CloudSettings:
    """Return the settings of a table [clouds].

    Parameters
    ----------
    cameras
        Those of the session, which must have what is asked of them.

    Raises
    ------
    HandtrackError
        Naming `where` and the key.
    """
    table = checked_table(values, where)
    sources = [key for key in _CLOUD_SOURCES if key in table]
    if len(sources) != 1:
        raise HandtrackError(
            f"{where}: expected exactly one of {', '.join(_CLOUD_SOURCES)}; found "
            f"{', '.join(sources) or 'none'}."
        )
    also = tuple(CLOUD_SETTINGS)
    source = read_table(CloudSettings, table, where, also, given={}, by_method={})
    for left, right in source.stereo:
        if left == right:
            raise HandtrackError(f"{where}: stereo = {shown(table['stereo'])}; expected {_PAIRS}.")
        _check_names((left, right), cameras, "images", f"{where}: stereo")
    _check_names(source.depth, cameras, "depth", f"{where}: depth")
    given = {name: table[name] for name in CLOUD_SETTINGS if name in table}
    if "skin" in given:
        given["skin"] = read_table(SkinEllipse, given["skin"], f"{where}, skin")
    return source.with_values(given, where)


def _check_names(names: Sequence[str], cameras: Sequence[Any], needs: str, what: str) -> None:
    """Raise HandtrackError for a camera that does not exist, or lacks what is needed of it."""
    known = {camera.name: camera for camera in cameras}
    for name in names:
        if name not in known:
            raise HandtrackError(
                f"{what} names the camera '{name}', which has no [[camera]]; known: "
                f"{', '.join(known)}."
            )
        if getattr(known[name], needs) is None:
            raise HandtrackError(f"{what} uses the camera '{name}', which has no `{needs}`.")


def _accepted(known: Setting, value: Any, where: str) -> Any:
    if (value is False and known.optional) or isinstance(value, SkinEllipse):
        return value
    try:
        if isinstance(value, str | bool) and known.kind is not str:
            raise ValueError(known.range_words)
        return known.accept(value)
    except ValueError as error:
        shown = f'"{value}"' if isinstance(value, str) else str(value)
        shown = shown.lower() if isinstance(value, bool) else shown
        raise HandtrackError(f"{where}: {known.name} = {shown}; expected {error}.") from None


# ---- The whole of session.toml


FORMAT = 1
BODY_TRACKING = {
    "silhouettes": {
        "bands_mm": (60.0, 30.0, 10.0),
        "outline_sigma_mm": 10.0,
        "outline_correlation_mm": 80.0,
    },
    "prior": {"motion_sigma_mm": 60.0, "motion_sigma_deg": 15.0},
}
"""[tracking] that new sessions of a body have: outlines are as much coarser than a hand's as the body is larger"""
_TABLES = ("session", "hand", "camera", "clouds", "tracking")
_BAYER = tuple(pattern.lower() for pattern in PATTERNS)
_Text = Annotated[str, FULL]
_FOREARM = Meta(description='true, false or "auto"')
_LEVEL = Meta(ge=1, le=254, description="a grey value between 0 and 255")
_SIZE = Meta(description="2 whole numbers [width, height], in pixels")
_FINITE_S = Meta(ge=-sys.float_info.max, le=sys.float_info.max, description="a number [s]")


@dataclass(frozen=True)
class RecordingSettings:
    """[session]: what the recording is called and how its numbers are to be read."""

    name: _Text
    fps: Annotated[float, above(0, "1/s")] | None = None
    """frames a second; may be absent when timestamps are given."""
    timestamps: _Text | None = None
    """a csv file with the columns camera, frame, time_s."""
    world_unit_m: Annotated[float, above(0, "m")] = 1.0
    """metres in one unit of calibration.toml and of the clouds."""


@dataclass(frozen=True)
class HandSettings:
    """[hand]: whose hand, by which model."""

    model: _Text = "hand26"
    """a model's name, or the path of a definition in the folder."""
    side: Annotated[str, one_of(("right", "left"))] = "right"
    scale: Annotated[float, above(0)] | _Text = 1.0
    """a factor, "fit" (to the recording), or the path of a person's file in the folder, taken as it is."""
    forearm: Annotated[bool | Literal["auto"], _FOREARM] = "auto"
    """whether the model has a forearm: true, false, or "auto"."""
    person: _Text | None = None
    """with scale = "fit": the path of a person's file in the folder, which the recording adds to."""

    def __post_init__(self) -> None:
        if self.person is not None and self.scale != "fit":
            raise ValueError(
                f'person = "{self.person}" is what a fit begins with, and needs scale = "fit". To take the file as it is, '
                f'write scale = "{self.person}" alone.'
            )


@dataclass(frozen=True)
class LensSettings:
    """[camera.lens]: the lens that took a camera's images, where the calibration's camera is a pinhole view of them."""

    model: Annotated[str, one_of(("fisheye", "plain"))]
    size: Annotated[tuple[int, int], _SIZE]
    matrix: Annotated[
        list[list[float]], Meta(min_length=3, max_length=3, description="3 x 3 numbers [px]")
    ]
    coefficients: Annotated[
        list[float],
        Meta(description="numbers: of a fisheye k1 k2 k3 k4, of a plain lens k1 k2 p1 p2 k3 …"),
    ]
    rotation: Annotated[
        list[float],
        Meta(min_length=3, max_length=3, description="a rotation vector, lens to view [rad]"),
    ]

    @classmethod
    def of(cls, lens: SourceLens, view: Camera) -> LensSettings:
        """Return the settings of a view made by `pinholes`."""
        return cls(
            "fisheye" if lens.fisheye else "plain",
            lens.size,
            lens.matrix.tolist(),
            lens.coefficients.tolist(),
            rotation_vector(view.rotation).tolist(),
        )

    @property
    def source(self) -> SourceLens:
        """The lens. Raises HandtrackError for numbers that are none's."""
        return SourceLens(
            self.size, np.array(self.matrix), np.array(self.coefficients), self.model == "fisheye"
        )


@dataclass(frozen=True)
class CameraSettings:
    """[[camera]]: what one camera gave; whatever is absent is not observed."""

    name: _Text
    images: _Text | None = None
    """a video, or a pattern of numbered files."""
    masks: _Text | MaskMethod | None = None
    """a pattern of numbered files, or how masks are computed."""
    mask_unknown: Annotated[int, _LEVEL] | None = None
    """value in the files of masks where nobody knows whether it is hand or background; it counts for nothing."""
    image_size: Annotated[tuple[int, int], _SIZE] | None = None
    """width, height [px] of all that the camera gave, where that is the calibration's images scaled: its matrix is scaled
    likewise."""
    roi: Roi | None = None
    """x, y, w, h [px] in the image as it was taken; outside of it nothing counts as observed."""
    depth: _Text | None = None
    """a pattern of numbered 16 bit files."""
    depth_scale_m: Annotated[float, above(0, "m")] | None = None
    """metres in one unit of the depth files."""
    bayer: Annotated[str, one_of(_BAYER)] | None = None
    """the images are raw mosaics (8 or 16 bit files) of this pattern: rggb, bggr, grbg or gbrg."""
    demosaic: Annotated[str, one_of(METHODS)] | None = None
    """how mosaics become colour images."""
    white_level: Annotated[float, above(0)] | None = None
    """the value of a mosaic that becomes 255."""
    keypoints: _Text | None = None
    """a pattern of numbered files of 2D joints, as OpenPose writes them."""
    keypoint_layout: Annotated[str, one_of(tuple(LAYOUTS))] | None = None
    """which of their points are which joints: of bodies body_25, body_25b, coco17, coco18, halpe26, coco133, mediapipe33 or body22,
    of hands hand_left, hand_right or mediapipe21."""
    fps: Annotated[float, above(0, "1/s")] | None = None
    """the camera's frames a second, where they are not the session's: its frames are then taken by time."""
    lag_s: Annotated[float, _FINITE_S] | None = None
    """by how much the camera's clock is late, or its recording began early [s]: what happened at a time stands this much
    later in it."""
    lens: LensSettings | None = None
    """the lens of its images, files of masks included, where the calibration's camera is a pinhole view of them."""


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
    from handtrack.model.model_file import OTHERS  # slow to import

    return model.lower().endswith((".toml", *OTHERS)) or "/" in model


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
    from handtrack.model.model_file import MODELS, OTHERS  # slow; the page never reads one

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
    recording = _recording(tables["session"], path)
    where = f"{path}, [hand]"
    hand = read_table(HandSettings, tables.get("hand", {}), where)
    if hand.model not in MODELS and not is_definition(hand.model):
        known, others = listed_names(hand.model, MODELS, "known models"), ", ".join(OTHERS)
        raise HandtrackError(
            f'{where}: model = "{hand.model}" is no model, and no path of a definition (.toml, {others}); {known}'
        )
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

    cameras = []
    for camera in file.cameras:
        masks, lens = camera.masks, camera.lens and vars(camera.lens)
        masks = masks if isinstance(masks, str | None) else mask_method_table(masks)
        cameras.append(_items(vars(camera) | {"masks": masks, "lens": lens}))
    tables = {
        "session": _items({"format": FORMAT, **vars(file.session)}),
        "hand": _items(vars(file.hand)),
        "camera": cameras,
        "clouds": _items(file.clouds.table if file.clouds else {}),
        "tracking": dict(file.tracking),
    }
    text = tomlkit.dumps({name: table for name, table in tables.items() if table})
    Path(path).write_text(text, encoding="utf-8")


def _items(values: Mapping[str, Any]) -> dict[str, Any]:
    return {key: toml_item(value) for key, value in values.items() if value is not None}


def _recording(given: Any, path: Path) -> RecordingSettings:
    where = f"{path}, [session]"
    table = checked_table(given, where)
    version = required(table, "format", where)
    if isinstance(version, bool) or not isinstance(version, int) or version < 1:
        raise HandtrackError(f"{where}: format = {shown(version)}; expected {FORMAT}.")
    if version > FORMAT:
        raise HandtrackError(
            f"{path}: format = {version}, but this handtrack reads format {FORMAT}. The session "
            "was written by a newer handtrack: update handtrack."
        )
    table.setdefault("name", path.resolve().parent.name or "session")
    recording = read_table(RecordingSettings, table, where, also=["format"])
    if recording.fps is None and recording.timestamps is None:
        raise HandtrackError(f"{where}: give `fps` (frames a second) or `timestamps` (a csv file).")
    return recording


def _cameras(tables: Any, path: Path) -> tuple[CameraSettings, ...]:
    if not isinstance(tables, list) or not tables:
        raise HandtrackError(
            f"{path}: no camera; expected at least one table [[camera]] (two brackets)."
        )
    cameras = tuple(_camera(table, path, number) for number, table in enumerate(tables, 1))
    for name, count in Counter(camera.name for camera in cameras).items():
        if count > 1:
            raise HandtrackError(
                f"{path}: two tables [[camera]] have the name '{name}'; one a camera is expected."
            )
    return cameras


def _camera(table: Any, path: Path, number: int) -> CameraSettings:
    where = f"{path}, [[camera]] number {number}"
    table = checked_table(table, where)
    where = f"{path}, camera '{required(table, 'name', where)}'"
    masks = table.get("masks")
    if masks is not None and (not isinstance(masks, str) or not masks):
        masks = read_mask_method(masks, f"{where}, masks")
    lens = table.get("lens")
    if lens is not None:
        lens = read_table(LensSettings, lens, f"{where}, lens")
    also = ("masks", "lens")
    camera = read_table(CameraSettings, table, where, also, masks=masks, lens=lens)
    wrong = missing_counterpart(camera)
    if wrong is not None:
        raise HandtrackError(f"{where}: {wrong}")
    return camera


def missing_counterpart(camera: CameraSettings) -> str | None:
    """Return what a camera's settings lack of one another, in words; None where they go together."""
    masks, roi = camera.masks, camera.roi
    if masks is not None and not isinstance(masks, str) and getattr(camera, masks.needs) is None:
        return f'masks by the method "{masks.name}" need the camera\'s `{masks.needs}`, which is missing.'
    if camera.mask_unknown is not None and not isinstance(masks, str):
        return "mask_unknown is about files of masks, but `masks` names none."
    if roi is not None and (min(roi[:2]) < 0 or min(roi[2:]) < 1):
        return f"roi = {list(roi)}; expected [x, y, w, h] in pixels, inside the image."
    if camera.depth is not None and camera.depth_scale_m is None:
        return "depth needs `depth_scale_m`, the metres in one unit of its files."
    if camera.lens is not None and camera.depth is not None:
        return "depth through a `lens` is not read: it is measured along the lens's axis, not along the view's."
    for key in ("demosaic", "white_level"):
        if camera.bayer is None and getattr(camera, key) is not None:
            return (
                f"{key} is about raw mosaics, but their pattern `bayer` is missing; expected one of "
                f"{', '.join(_BAYER)}."
            )
    for key, other in (("bayer", "images"), ("keypoint_layout", "keypoints")):
        if getattr(camera, key) is not None and getattr(camera, other) is None:
            return f"{key} says how `{other}` are to be read, which is missing."
    return None
