"""[clouds] of session.toml: where point clouds come from, and the filters' settings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from handtrack.capture.clouds.cloud_filters import COMPONENTS
from handtrack.capture.clouds.disparity import STEREO_METHODS
from handtrack.capture.clouds.skin_ellipse import SkinEllipse
from handtrack.errors import HandtrackError
from handtrack.files.toml_table import TableReader

_CLOUD_SOURCES = ("files", "stereo", "depth")
_CLOUD_NUMBERS = {
    "crop_m": "m",
    "voxel_m": "m",
    "near_m": "m",
    "far_m": "m",
    "front_m": "m",
    "outlier_ratio": "",
    "stereo_left_right_px": "px",
    "stereo_contrast": "grey levels",
}
_CLOUD_COUNTS = (
    "max_points",
    "outlier_neighbours",
    "per_voxel",
    "stereo_window_px",
    "stereo_speckle_px",
)
_CLOUD_OFF = ("near_m", "far_m", "crop_m", "voxel_m", "outlier_neighbours", "max_points")


@dataclass(frozen=True)
class CloudSettings:
    """[clouds]: where point clouds come from (exactly one source), and the filters' settings;
    None: the filter's own; false: off."""

    files: str | None = None
    """a pattern of .ply or .npz files."""
    stereo: tuple[tuple[str, str], ...] = ()
    """pairs of cameras to match."""
    depth: tuple[str, ...] = ()
    """cameras whose depth is used."""
    stereo_method: str = "sgbm"
    """how pairs are matched: sgbm, or correlation."""
    stereo_window_px: int | None = None
    """side of the squares that are compared."""
    stereo_left_right_px: float | None = None
    """how far the matches from left to right and back may differ."""
    stereo_contrast: float | None = None
    """standard deviation around a pixel [grey levels] below which nothing is matched."""
    stereo_speckle_px: int | None = None
    """smaller patches that stand off from their surroundings are taken for wrong."""
    near_m: float | bool | None = None
    far_m: float | bool | None = None
    crop_m: float | bool | None = None
    skin: SkinEllipse | None = None
    component: str | None = None
    front_m: float | None = None
    voxel_m: float | bool | None = None
    per_voxel: int | None = None
    outlier_neighbours: int | bool | None = None
    outlier_ratio: float | None = None
    max_points: int | bool | None = None


def read_clouds(values: Any, cameras: Sequence[Any], where: str) -> CloudSettings:
    """Return the settings of a table [clouds]. Raises HandtrackError naming `where` and the key.

    cameras: those of the session, which must have what is asked of them.
    """
    table = TableReader(values, where)
    given = [key for key in _CLOUD_SOURCES if table.raw(key) is not None]
    if len(given) != 1:
        raise HandtrackError(
            f"{table.where}: expected exactly one of {', '.join(_CLOUD_SOURCES)}; found "
            f"{', '.join(given) or 'none'}."
        )
    filters: dict[str, Any] = {}
    for key in (*_CLOUD_NUMBERS, *_CLOUD_COUNTS):
        value = table.raw(key)
        if value is False and key in _CLOUD_OFF:
            filters[key] = False
        elif value is not None and key in _CLOUD_COUNTS:
            filters[key] = table.whole(key, None, 1)
        elif value is not None:
            filters[key] = table.number(key, above=0.0, unit=_CLOUD_NUMBERS[key])
    if table.raw("component") is not None:
        filters["component"] = table.choice("component", COMPONENTS, COMPONENTS[0])
    if table.raw("skin") is not None:
        filters["skin"] = _skin(TableReader(table.raw("skin"), f"{table.where}, skin"))
    if (filters.get("far_m") or 1e9) <= (filters.get("near_m") or 0.0):
        raise table.error("far_m", filters["far_m"], f"more than near_m = {filters['near_m']:g}")
    settings = CloudSettings(
        files=table.text("files") if given == ["files"] else None,
        stereo=_pairs(table, cameras) if given == ["stereo"] else (),
        depth=_names(table, "depth", table.raw("depth"), cameras, "depth")
        if given == ["depth"]
        else (),
        stereo_method=table.choice("stereo_method", STEREO_METHODS, STEREO_METHODS[0]),
        **filters,
    )
    table.finish()
    return settings


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
