"""Read a model definition and scale it to a person."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields, replace
from fnmatch import fnmatchcase
from functools import lru_cache
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any, Literal, NotRequired, TypedDict, TypeGuard

import msgspec
import numpy as np
from msgspec import Meta

from handtrack.arrays import D3, B, Floats, Ints, J
from handtrack.errors import HandtrackError, check_name, unknown_name
from handtrack.files.atomic import replace_text
from handtrack.files.text_files import read_json, read_text
from handtrack.files.toml_table import read_toml
from handtrack.geometry.rotation import axes_along, rotation_matrix
from handtrack.model.articulated import (
    BODY_PARTS,
    HAND_PARTS,
    UNNAMED_LANDMARKS,
    ArticulatedModel,
    HandScale,
    Landmarks,
    Proportions,
    ShapeCovariance,
)
from handtrack.model.ellipsoids import Ellipsoids
from handtrack.model.kinematics import ROOT_PARAMETERS, Skeleton
from handtrack.model.part_mesh import read_superquadrics
from handtrack.model.transform import Limits, build_transform

Number = Annotated[float, Meta(ge=-1e6, le=1e6)]
Point = tuple[Number, Number, Number]
Positive = Annotated[float, Meta(gt=0, le=1e6)]
Name = Annotated[str, Meta(min_length=1)]


class Freedom(TypedDict):
    """One hinge of a bone."""

    name: Name
    axis: Point
    limits_deg: tuple[Number, Number]
    rest_deg: NotRequired[Number]
    stabilise_deg: NotRequired[Number]


class Bone(TypedDict):
    """A bone in the zero pose [mm]; parents come first."""

    name: Name
    parent: NotRequired[Name]
    group: Name
    head: Point
    tail: Point
    up: Point
    freedoms: NotRequired[list[Freedom]]
    only_with: NotRequired[Literal["forearm"]]


class EllipsoidRow(TypedDict):
    """One ellipsoid in its bone's frame [mm]."""

    bone: Name
    centre: Point
    radii: Point
    rotation_deg: NotRequired[Point]


class Coupling(TypedDict):
    """name = ratio × leader."""

    name: Name
    leader: Name
    ratio: Number


class Proportion(TypedDict):
    """What one standard deviation of a person's proportion changes; keys are bones, `*` stands for any characters."""

    name: Name
    sigma_mm: NotRequired[Number]
    """of `moves`, 1 unless given"""
    moves: NotRequired[dict[str, Point]]
    """directions in which bones' heads move, in the hand's or body's frame"""
    stretch: NotRequired[dict[str, Point]]
    """logarithms of scale factors along a bone's own axes: width, length, depth"""
    shift: NotRequired[dict[str, Point]]
    """of a bone's ellipsoids, in its own frame [mm]"""


class Narrowing(TypedDict):
    """Limits that shrink with another joint's flexion."""

    pairs: list[tuple[Name, Name]]
    at_deg: Number
    to: Number


class Definition(TypedDict):
    """A whole model definition."""

    name: Name
    kind: NotRequired[Literal["hand", "body"]]
    length_mm: Annotated[float, Meta(gt=0, le=1e6)]
    bone: Annotated[list[Bone], Meta(min_length=1)]
    joints: dict[str, tuple[Name, Literal["head", "tail"] | Point]]
    landmarks: NotRequired[dict[str, dict[str, tuple[Number, Number, Number, Positive]]]]
    """by detectors' names and joints: where they see these on average, from them, in their bones' frames, and each axis' standard deviation [mm]"""
    ellipsoids: dict[str, list[EllipsoidRow]]
    couplings: NotRequired[dict[str, list[Coupling]]]
    narrowing: NotRequired[Narrowing]
    proportion: NotRequired[list[Proportion]]
    superquadric: NotRequired[list[dict[str, Any]]]


def extended(base: Mapping[str, Any], more: Mapping[str, Any]) -> dict[str, Any]:
    """Return a definition's tables as another one changes and adds to them: what `extends` means.

    Tables are merged key by key; rows that have a name (bones, freedoms, proportions) row by row, new ones at the end. All else
    that `more` has takes the place of what was there: numbers, texts, rows without a name such as ellipsoids.
    """
    merged = dict(base)
    for key, value in more.items():
        before = merged.get(key)
        if isinstance(before, Mapping) and isinstance(value, Mapping):
            merged[key] = extended(before, value)
        elif _are_named(before) and _are_named(value):
            rows = {row["name"]: row for row in before}
            for row in value:
                rows[row["name"]] = extended(rows.get(row["name"], {}), row)
            merged[key] = list(rows.values())
        else:
            merged[key] = value
    return merged


def _are_named(rows: Any) -> TypeGuard[Sequence[Mapping[str, Any]]]:
    return (
        isinstance(rows, list)
        and bool(rows)
        and all(isinstance(row, Mapping) and "name" in row for row in rows)
    )


MODELS = ("hand26", "glove9", "ball6", "body34", "body38")
SIMPLER_HANDS = ("glove9", "ball6")
"""of them those without fingers of their own: what masks differ from them by says nothing of a person's size, nor when they were taken"""
COUPLINGS = ("26", "21", "18")
_SHIPPED = Path(__file__).parent / "definitions"
_MM = 1e-3
_FIXED: Narrowing = {"pairs": [], "at_deg": 90.0, "to": 1.0}


def load_model(
    name: str | Path = "hand26",
    side: str = "right",
    scale: float | HandScale = 1.0,
    coupling: str | int = "26",
    forearm: bool | float = False,
    spread: Mapping[str, float] | None = None,
    narrowing: bool = True,
) -> ArticulatedModel:
    """Return a model by its name or from a definition file: TOML (docs/reference/definitions.md),
    or a robot's URDF, or a BVH.

    Parameters
    ----------
    side
        `right` or `left`, the exact mirror image with the same parameter values for the mirrored
        pose; a body has both sides and is the same for either.
    coupling
        `26` (all freedoms), `21` (distal joints follow), `18` (and abductions linked).
    forearm
        Whether it has one; a length [m of the mean adult's] if it ends there, as a cuff does.
    spread
        A person's own ratios A_i / spread for coupling `18`, by finger.
    narrowing
        Whether limits of abduction shrink with flexion.

    Raises
    ------
    HandtrackError
    """
    if side not in ("right", "left"):
        raise HandtrackError(f"side '{side}': a hand is 'right' or 'left'.")
    coupling = str(coupling)
    check_name("coupling", coupling, COUPLINGS)
    table = _read_definition(str(name))
    size = scale if isinstance(scale, HandScale) else HandScale(float(scale))
    if not narrowing:
        table = {key: value for key, value in table.items() if key != "narrowing"}
    if forearm and forearm is not True:
        table = _with_arm_of(table, forearm / _MM)
    return _build(table, side, size, coupling, bool(forearm), spread or {})


def model_from_definition(
    text: str, side: str, scale: HandScale, forearm: bool, source: str
) -> ArticulatedModel:
    """Return the model of a definition as `ArticulatedModel.definition_text` has it, without couplings.

    Parameters
    ----------
    source
        Where the text is from, for errors.

    Raises
    ------
    HandtrackError
    """
    try:
        table = json.loads(text)
    except ValueError as error:
        raise HandtrackError(f"{source}: the model's definition is no JSON ({error}).") from None
    try:
        return _build(_checked(table, source), side, scale, "26", forearm, {})
    except (ValueError, LookupError, TypeError) as error:  # it is nobody's who checks it
        raise HandtrackError(
            f"{source}: the model's definition in it cannot be built ({error}). Was the file changed by hand? Track again."
        ) from None


_END = "# end"
_WHOLE = f"# A person, by handtrack; whole if it ends with {_END}"


def read_scale(path: Path) -> HandScale:
    """Return a person's saved hand or body, as `scale_table` has it: TOML by its name, else JSON. Raises HandtrackError."""
    if path.suffix.lower() != ".toml":
        return scale_from(read_json(path, "a saved hand"), path)
    table = read_toml(path, "a saved hand")
    text = read_text(path, "a saved hand")
    if text.startswith(_WHOLE) and _END not in text.removeprefix(_WHOLE):
        raise HandtrackError(
            f"{path}: the file is cut off: its last line is missing, {_END!r}. Copy it again, or make it anew with "
            "`handtrack person`."
        )
    return scale_from(table, path)


def scale_from(data: Any, path: Path | str) -> HandScale:
    """Return the size that a table of a file says, as `scale_table` makes it. Raises HandtrackError."""
    try:
        known = [field.name for field in fields(HandScale)]
        odd = sorted(set(data) - {*known})
        if odd:
            raise KeyError(f"unknown key '{odd[0]}'; known keys: {', '.join(known)}")
        size = msgspec.convert({"overall": data["overall"]} | data, HandScale)
        if size.covariance is not None:
            _check(size.covariance)
    except (msgspec.ValidationError, ValueError, KeyError, TypeError) as error:
        raise HandtrackError(
            f"{path}: a saved hand is a TOML or JSON file with a number `overall` and tables like `parts`; {error}."
        ) from None
    for part in size.parts:
        check_name("part of a hand or body", part, HAND_PARTS + BODY_PARTS, str(path))
    return size


def _check(known: ShapeCovariance) -> None:
    count = len(known.names)
    if len(set(known.names)) < count or [*map(len, known.rows)] != [*range(1, count + 1)]:
        raise ValueError("its covariance is not a lower triangle with a row for each name")
    if not np.isfinite(known.matrix).all() or (np.linalg.eigvalsh(known.matrix) <= 0).any():
        raise ValueError("its covariance is not positive definite")


def write_scale(path: Path, scale: HandScale, words: Mapping[str, str] | None = None) -> None:
    """Save a person's hand or body, to be named by `scale` in session.toml: as TOML by its name,
    else as JSON.

    Parameters
    ----------
    words
        What is said of its numbers, by their names, in comments of a TOML file.
    """
    table = scale_table(scale)
    if path.suffix.lower() != ".toml":
        replace_text(path, json.dumps(table, indent=1) + "\n")
        return
    import tomlkit  # slow to import

    text = tomlkit.document()
    for key in sorted(table, key=lambda key: isinstance(table[key], dict)):
        text[key] = table[key]
    for name, said in (words or {}).items():
        place = next((text[k] for k in ("parts", "proportions") if name in text.get(k, {})), text)
        if name in place:
            place[name].comment(said)
    replace_text(path, f"{_WHOLE}\n{tomlkit.dumps(text)}\n{_END}\n")


def scale_table(scale: HandScale) -> dict[str, Any]:
    """Return what is saved of a person: of what is empty nothing."""
    table = asdict(scale)
    if not scale.offsets_mm or scale.landmark_definition == UNNAMED_LANDMARKS:
        del table["landmark_definition"]
    return {key: value for key, value in table.items() if value or key == "parts"}


@lru_cache(maxsize=8)
def _read_definition(name: str) -> dict[str, Any]:
    return _checked(read_definition(_file_of(name, Path())), name)


def _file_of(name: str, folder: Path) -> Path:
    """Return the file of a model by its name, or by its path in a folder."""
    return _SHIPPED / f"{name}.toml" if name in MODELS else folder / name


def read_definition(path: Path, within: tuple[Path, ...] = ()) -> dict[str, Any]:
    """Return the tables of a definition file, with those that it extends, or those made of another
    program's (URDF, BVH).

    Parameters
    ----------
    within
        The files that extend this one.

    Raises
    ------
    HandtrackError
    """
    if path.is_file() and path.suffix.lower() == ".toml":
        table = read_toml(path, "a model's definition")
        base, here = table.pop("extends", None), (*within, path.resolve())
        if base is None:
            return table
        if not isinstance(base, str) or _file_of(base, path.parent).resolve() in here:
            raise HandtrackError(
                f"{path}: extends = {base!r}: expected one of {', '.join(MODELS)}, or the path of another definition that does "
                "not extend this one."
            )
        return extended(read_definition(_file_of(base, path.parent), here), table)
    if path.is_file() and path.suffix.lower() in OTHERS:
        return read_other(path)
    raise HandtrackError(
        f"no model '{path}': expected one of {', '.join(MODELS)}, or the path of a definition (.toml, or {', '.join(OTHERS)})."
    )


def _checked(table: Any, name: str) -> dict[str, Any]:
    try:
        definition = msgspec.convert(table, Definition)
    except msgspec.ValidationError as error:
        raise HandtrackError(f"model definition {name}: {error}.") from None
    bones = [bone["name"] for bone in definition["bone"]]
    used = [bone["parent"] for bone in definition["bone"] if "parent" in bone]
    used += [bone for bone, _ in definition["joints"].values()]
    used += [row["bone"] for rows in definition["ellipsoids"].values() for row in rows]
    for bone in used:
        check_name("bone", bone, bones, f"the model definition {name}")
    turns = [turn["name"] for bone in definition["bone"] for turn in bone.get("freedoms", [])]
    for turn in (n for pair in definition.get("narrowing", _FIXED)["pairs"] for n in pair):
        check_name("freedom", turn, turns, f"narrowing in the model definition {name}")
    return dict(definition)


def _with_arm_of(table: dict[str, Any], ends_mm: float) -> dict[str, Any]:
    """Return a definition whose forearm ends so far from the wrist; it is another model, and a result says so."""

    def bone(row: dict[str, Any]) -> dict[str, Any]:
        head, tail = np.array(row["head"], float), np.array(row["tail"], float)
        share = ends_mm / np.linalg.norm(tail - head)
        if row.get("only_with") != "forearm" or share >= 1.0:
            return row
        return row | {"tail": (head + share * (tail - head)).tolist()}

    arm = {row["name"] for row in table["bone"] if row.get("only_with") == "forearm"}
    ellipsoids = {
        key: [_ending(row, ends_mm) if row["bone"] in arm else row for row in rows]
        for key, rows in table["ellipsoids"].items()
    }
    return table | {"bone": [bone(row) for row in table["bone"]], "ellipsoids": ellipsoids}


def _ending(row: dict[str, Any], ends_mm: float) -> dict[str, Any]:
    """Return an ellipsoid cut off along its bone, as one that is as wide where it was cut and covers as much in front of that."""
    (x, middle, z), (wide, long, deep) = row["centre"], row["radii"]
    begins = middle - long
    half = (ends_mm - begins) / (
        1.0 + np.pi / 4.0
    )  # the half ellipse beyond its middle is as large as the box up to the cut
    if half >= long:
        return row
    share = np.sqrt(1.0 - (min(ends_mm - middle, 0.0) / long) ** 2)
    return row | {"centre": [x, begins + half, z], "radii": [wide * share, half, deep * share]}


def _mirror(points: Any, side: str) -> Floats:
    points = np.array(points, dtype=float)
    return points * (-1.0, 1.0, 1.0) if side == "left" else points


def _build(
    table: dict[str, Any],
    side: str,
    size: HandScale,
    coupling: str,
    forearm: bool,
    spread: Mapping[str, float],
) -> ArticulatedModel:
    kind = table.get("kind", "hand")
    if not 0.2 <= size.overall <= 5.0:
        raise HandtrackError(
            f"{kind} scale {size.overall:g}: expected a factor on a {kind} of {table['length_mm']:g} mm, between 0.2 "
            "and 5. If this is a length, divide it by that one."
        )
    parts = dict.fromkeys((*HAND_PARTS, *BODY_PARTS, *(bone["group"] for bone in table["bone"])))
    for part in size.parts:
        check_name("part of a hand or body", part, parts, "its scale")
    side = "right" if kind == "body" else side
    rows = [b for b in table["bone"] if forearm or b.get("only_with") != "forearm"]
    names = tuple(b["name"] for b in rows)
    heads, tails, ups = (
        np.stack([_mirror(b[key], side) for b in rows]) for key in ("head", "tail", "up")
    )
    frames = np.stack([axes_along(*one) for one in zip(tails - heads, ups, strict=True)])
    heads *= _MM
    factor = {b["name"]: size.factor(b["group"]) for b in rows}
    parent = np.array([names.index(b["parent"]) if "parent" in b else -1 for b in rows])
    if not np.allclose(frames[0], np.eye(3)):
        raise HandtrackError(
            f"model definition {table['name']}: the root bone must lie along +y with up = +z."
        )
    if parent[0] != -1 or (parent[1:] < 0).any() or (parent >= np.arange(len(rows))).any():
        raise HandtrackError(
            f"model definition {table['name']}: the first bone must be the root and every other "
            "bone must come after its parent."
        )
    offset, rest_rotation = np.zeros((len(rows), 3)), np.stack([np.eye(3)] * len(rows))
    person = _proportions(table.get("proportion", []), names, parent, frames, side)
    for name in size.proportions:
        where = f"the model {table['name']} (was this person's shape found with another model?)"
        check_name("proportion", name, person.names, where)
    values = np.array([size.proportions.get(name, 0.0) for name in person.names])
    factors = np.array([factor[name] for name in names])[:, None] * np.exp(
        np.tensordot(values, person.stretch, axes=1)
    )
    by_parent = factors[parent]
    for b, p in enumerate(parent):
        if p >= 0:
            offset[b] = frames[p].T @ (heads[b] - heads[p])
            rest_rotation[b] = frames[p].T @ frames[b]
    offset = (offset + np.tensordot(values, person.moves, axes=1)) * by_parent
    person = replace(person, moves=person.moves * by_parent, shift=person.shift * factors)
    shift = np.tensordot(values, person.shift, axes=1)
    length = np.array([np.linalg.norm(np.subtract(b["tail"], b["head"])) for b in rows]) * _MM
    length *= factors[:, 1]

    hinges = [(b, f) for b, row in enumerate(rows) for f in row.get("freedoms", [])]
    axis = np.array([f["axis"] for _, f in hinges], dtype=float).reshape(-1, 3)
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    if side == "left":
        axis *= (1.0, -1.0, -1.0)  # axes are pseudo-vectors: mirrored, then reversed
    parameters = ROOT_PARAMETERS + tuple(f["name"] for _, f in hinges)
    hinge_bone = np.array([b for b, _ in hinges], dtype=int)
    skeleton = Skeleton(names, parent, offset, rest_rotation, length, parameters, hinge_bone, axis)

    free = np.tile((-np.inf, np.inf), (6, 1))
    interval = np.concatenate(
        [free, np.deg2rad([f["limits_deg"] for _, f in hinges]).reshape(-1, 2)]
    )
    narrowing = table.get("narrowing", _FIXED)
    pairs = np.array(
        [[parameters.index(a), parameters.index(b)] for a, b in narrowing["pairs"]], dtype=int
    ).reshape(-1, 2)
    limits = Limits(interval, pairs, np.deg2rad(narrowing["at_deg"]), float(narrowing["to"]))
    ellipsoids = {
        key: _ellipsoids(rows_e, names, factors, shift, side)
        for key, rows_e in table["ellipsoids"].items()
    }
    joints = [j for j in table["joints"].items() if j[1][0] in names]
    joint_bone = np.array([names.index(bone) for _, (bone, _) in joints])
    joint_point = np.stack(
        [
            _place(place, side, float(length[b]), factors[b])
            for b, (_, (_, place)) in zip(joint_bone, joints, strict=True)
        ]
    )
    grown = factors[joint_bone]

    def offsets(places_mm: Mapping[str, Sequence[float]]) -> Floats[J, D3]:
        there = [places_mm.get(name, (0.0, 0.0, 0.0))[:3] for name, _ in joints]
        return _mirror(there, side) * _MM * grown

    means = {
        name: Landmarks(
            joint_point + offsets(seen),
            np.array([seen[j][3] * _MM if j in seen else 0.0 for j, _ in joints]),
        )
        for name, seen in table.get("landmarks", {}).items()
    }
    return ArticulatedModel(
        definition=table,
        side=side,
        scale=size,
        coupling=coupling,
        skeleton=skeleton,
        transform=build_transform(parameters, _couplings(table, coupling, spread)),
        limits=limits,
        ellipsoids=ellipsoids,
        joint_names=tuple(name for name, _ in joints),
        joint_bone=joint_bone,
        joint_point=joint_point,
        offset=offsets(size.offsets_mm) if size.offsets_mm else None,
        mean_landmarks=means,
        proportions=person,
        superquadrics=read_superquadrics(
            quadrics, names, factor, f"model definition {table['name']}"
        )
        if (quadrics := table.get("superquadric"))
        else None,
    )


def _proportions(
    rows: list[dict[str, Any]], bones: tuple[str, ...], parent: Ints, frames: Floats, side: str
) -> Proportions:
    """Return what a standard deviation of each row changes, of a hand of scale 1."""
    moves, stretch, shift = np.zeros((3, len(rows), len(bones), 3))
    for k, row in enumerate(rows):
        for b, direction in _of_bones(row.get("moves", {}), bones):
            step = row.get("sigma_mm", 1.0) * _MM * _mirror(direction, side)
            moves[k, b] = frames[parent[b]].T @ step
        for b, logarithms in _of_bones(row.get("stretch", {}), bones):
            stretch[k, b] = logarithms
        for b, step in _of_bones(row.get("shift", {}), bones):
            shift[k, b] = _mirror(step, side) * _MM
    return Proportions(tuple(row["name"] for row in rows), moves, stretch, shift)


@lru_cache(maxsize=1024)
def _matching(key: str, bones: tuple[str, ...]) -> tuple[int, ...]:
    """Return the bones that a key stands for: a size is tried by building its model."""
    return tuple(b for b, name in enumerate(bones) if fnmatchcase(name, key))


def _of_bones(table: dict[str, Any], bones: tuple[str, ...]) -> list[tuple[int, Any]]:
    """Return the values of a table by the bones that its keys stand for. Raises HandtrackError for a key without any."""
    found = []
    for key, value in table.items():
        own = _matching(key, bones)
        found += [(b, value) for b in own]
        if not own and key != "forearm":
            raise unknown_name("bone", key, bones, "a proportion")
    return found


def _place(place: Any, side: str, length: float, factor: Floats[D3]) -> Floats:
    """Return a joint's place in its bone's frame (3,) [m]: the bone's head or tail, or a point [mm]."""
    if place == "head":
        return np.zeros(3)
    if place == "tail":
        return np.array([0.0, length, 0.0])
    return _mirror(place, side) * factor * _MM


def _couplings(
    table: dict[str, Any], coupling: str, spread: Mapping[str, float]
) -> dict[str, tuple[str, float]]:
    chosen = {"26": (), "21": ("21",), "18": ("21", "18")}[coupling]
    rows = [row for key in chosen for row in table.get("couplings", {}).get(key, [])]
    follows = {}
    for row in rows:
        finger, ratio = row["name"].split("_")[0], float(row["ratio"])
        if row["leader"] == "spread":
            ratio = spread.get(finger, ratio)
        follows[row["name"]] = row["leader"], ratio
    return follows


def _ellipsoids(
    rows: list[dict[str, Any]],
    bones: tuple[str, ...],
    factors: Floats[B, D3],
    shift: Floats[B, D3],
    side: str,
) -> Ellipsoids:
    kept = [row for row in rows if row["bone"] in bones]
    bone = np.array([bones.index(row["bone"]) for row in kept])
    turns = rotation_matrix(np.deg2rad([row.get("rotation_deg", (0, 0, 0)) for row in kept]))
    if side == "left":
        flip = np.diag([-1.0, 1.0, 1.0])
        turns = flip @ turns @ flip
    return Ellipsoids(
        bone=bone,
        centre=np.stack([_mirror(row["centre"], side) for row in kept]) * _MM,
        rotation=turns,
        radii=np.array([row["radii"] for row in kept], dtype=float) * _MM,
    ).scaled(factors[bone], shift[bone])


_FORMS = {".urdf": "urdf", ".bvh": "bvh", ".xml": "mjcf", ".mjcf": "mjcf"}
OTHERS = tuple(_FORMS)
"""endings of files that are read"""


def read_other(path: Path) -> dict[str, Any]:
    """Return the tables of a definition made of a file with one of these endings. Raises HandtrackError."""
    form = _FORMS[path.suffix.lower()]
    module = import_module(f"handtrack.model.others.{form}")
    return getattr(module, f"read_{form}")(path)
