"""[clouds] of session.toml: where point clouds come from, how pairs are matched, and which points are the hand's."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Annotated, Any

from msgspec import Meta

from handtrack.capture.clouds.cloud_filters import CloudFilters
from handtrack.capture.clouds.skin_ellipse import SkinEllipse
from handtrack.capture.clouds.stereo import StereoSettings
from handtrack.errors import HandtrackError
from handtrack.files.toml_table import FULL, checked_table, read_table, shown
from handtrack.setting import Setting, declared

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
