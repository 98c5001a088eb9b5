"""[clouds] of session.toml: where point clouds come from, how pairs are matched, and which points are the hand's."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

from handtrack.capture.clouds.cloud_filters import CloudFilters
from handtrack.capture.clouds.disparity import StereoSettings
from handtrack.capture.clouds.skin_ellipse import SkinEllipse
from handtrack.errors import HandtrackError
from handtrack.files.toml_table import TableReader
from handtrack.setting import NotAcceptedError, Setting, declared

_CLOUD_SOURCES = ("files", "stereo", "depth")
_STEREO = "stereo_"
CLOUD_SETTINGS: dict[str, Setting] = {**declared(CloudFilters), **declared(StereoSettings, _STEREO)}
"""every setting of [clouds] by its name there, beside the source"""


@dataclass(frozen=True)
class CloudSettings:
    """[clouds]: where point clouds come from (exactly one source), and what is said of filters and matching."""

    files: str | None = None
    """a pattern of .ply or .npz files."""
    stereo: tuple[tuple[str, str], ...] = ()
    """pairs of cameras to match."""
    depth: tuple[str, ...] = ()
    """cameras whose depth is used."""
    given: Mapping[str, Any] = field(default_factory=dict)
    """settings by name, as far as they are given; False: off. The others are as usual for the source."""

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

    def _given_of(self, table: type, prefix: str = "") -> dict[str, Any]:
        """Return what is given of a class of settings, by its fields."""
        return {
            name.removeprefix(prefix): None if self.given[name] is False else self.given[name]
            for name in declared(table, prefix)
            if name in self.given
        }


def read_clouds(values: Any, cameras: Sequence[Any], where: str) -> CloudSettings:
    """Return the settings of a table [clouds]. Raises HandtrackError naming `where` and the key.

    cameras: those of the session, which must have what is asked of them.
    """
    table = TableReader(values, where)
    sources = [key for key in _CLOUD_SOURCES if table.raw(key) is not None]
    if len(sources) != 1:
        raise HandtrackError(
            f"{table.where}: expected exactly one of {', '.join(_CLOUD_SOURCES)}; found "
            f"{', '.join(sources) or 'none'}."
        )
    given = {name: table.raw(name) for name in CLOUD_SETTINGS}
    if given["skin"] is not None:
        given["skin"] = _skin(TableReader(given["skin"], f"{table.where}, skin"))
    settings = CloudSettings(
        files=table.text("files") if sources == ["files"] else None,
        stereo=_pairs(table, cameras) if sources == ["stereo"] else (),
        depth=_names(table, "depth", table.raw("depth"), cameras, "depth")
        if sources == ["depth"]
        else (),
    )
    table.finish()
    return settings.with_values(given, table.where)


def _accepted(known: Setting, value: Any, where: str) -> Any:
    if (value is False and known.optional) or isinstance(value, SkinEllipse):
        return value
    try:
        if isinstance(value, str | bool) and known.kind is not str:
            raise NotAcceptedError(known.range_words)
        return known.accept(value)
    except NotAcceptedError as error:
        shown = f'"{value}"' if isinstance(value, str) else str(value)
        shown = shown.lower() if isinstance(value, bool) else shown
        raise HandtrackError(f"{where}: {known.name} = {shown}; expected {error}.") from None


def _skin(table: TableReader) -> SkinEllipse:
    mean, covariance = table.raw("mean"), table.raw("covariance")
    for key, value, count in (("mean", mean, 2), ("covariance", covariance, 3)):
        form = f"{count} numbers, as fitted from samples of skin"
        if not isinstance(value, list) or len(value) != count:
            raise table.error(key, value, form)
        if not all(isinstance(v, int | float) and not isinstance(v, bool) for v in value):
            raise table.error(key, value, form)
    if covariance[0] <= 0 or covariance[0] * covariance[2] <= covariance[1] ** 2:
        raise table.error("covariance", covariance, "rr, rg, gg of an ellipse: rr gg > rg²")
    size = table.number("size", SkinEllipse.size, above=0.0, unit="standard deviations")
    table.finish()
    rr, rg, gg = (float(v) for v in covariance)
    return SkinEllipse((float(mean[0]), float(mean[1])), (rr, rg, gg), size)


def _pairs(table: TableReader, cameras: Sequence[Any]) -> tuple[tuple[str, str], ...]:
    value = table.raw("stereo")
    form = 'pairs of camera names, such as [["cam0", "cam1"]]'
    if not isinstance(value, list) or not value:
        raise table.error("stereo", value, form)
    pairs = []
    for pair in value:
        if not isinstance(pair, list) or len(pair) != 2 or pair[0] == pair[1]:
            raise table.error("stereo", value, form)
        left, right = _names(table, "stereo", pair, cameras, "images")
        pairs.append((left, right))
    return tuple(pairs)


def _names(
    table: TableReader, key: str, value: Any, cameras: Sequence[Any], needs: str
) -> tuple[str, ...]:
    """Return camera names that exist and have what is needed of them."""
    if not isinstance(value, list) or not value:
        raise table.error(key, value, 'a list of camera names, such as ["cam0"]')
    known = {camera.name: camera for camera in cameras}
    for name in value:
        if name not in known:
            raise HandtrackError(
                f"{table.where}: {key} names the camera '{name}', which has no [[camera]]; known: "
                f"{', '.join(known)}."
            )
        if getattr(known[name], needs) is None:
            raise HandtrackError(
                f"{table.where}: {key} uses the camera '{name}', which has no `{needs}`."
            )
    return tuple(value)
