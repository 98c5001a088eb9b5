"""MJCF → definition: a robot hand as MuJoCo describes it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from handtrack.arrays import D3, D4, Floats
from handtrack.errors import HandtrackError
from handtrack.geometry.rotation import matrix_from_quaternion, rotation_matrix
from handtrack.model.others.tree import (
    SIZES,
    Hinge,
    Link,
    Shape,
    definition_of,
    ellipsoid_radii,
    mesh_shapes,
    numbers,
    read_root,
    rigid,
)

_EXPANDS = ("include", "frame", "replicate", "attach", "composite", "flexcomp")
"""what MuJoCo makes bodies of when it loads a file; its own saved form has none of them"""
_SAME_M = 1e-6
"""hinges of a body whose anchors differ by less have one"""
_Element = ElementTree.Element
_Given = Mapping[str, str]
_Defaults = dict[str, dict[str, str]]
"""attributes by element"""


def read_mjcf(path: Path) -> dict[str, Any]:
    """Return the definition of a robot's MJCF. Raises HandtrackError for what is none, slides, or must be expanded first."""
    root = read_root(path, "mujoco", "MJCF")
    expands = next((one.tag for one in root.iter() if one.tag in _EXPANDS), None)
    if expands is not None:
        raise HandtrackError(
            f"{path}: it has <{expands}>, which MuJoCo makes bodies of. Let it write what it made: "
            "`mujoco.MjSpec.from_file(...).to_xml()` after `.compile()`, or `mj_saveLastXML`."
        )
    tops = root.findall("worldbody/body")
    moving = [b for b in tops if next(b.iter("joint"), None) is not None]
    if len(moving) != 1:
        raise HandtrackError(
            f"{path}: {len(moving)} bodies with joints stand in the world; expected one, the hand."
        )
    classes = dict[str, _Defaults]()
    for top in root.findall("default"):
        _read_defaults(top, {}, classes)
    _say_all(moving[0], "main", classes, path)
    links = list(_Robot(root, path).links(moving[0], None, np.eye(4)))
    return definition_of(root.get("model", path.stem), links, str(path))


def _read_defaults(table: _Element, above: _Defaults, classes: dict[str, _Defaults]) -> None:
    """Add a class of defaults, and those below it, which take over what it says."""
    own = {tag: dict(given) for tag, given in above.items()}
    for one in table:
        if one.tag != "default":
            own[one.tag] = {**own.get(one.tag, {}), **one.attrib}
    classes[table.get("class", "main")] = own
    for below in table.findall("default"):
        _read_defaults(below, own, classes)


def _say_all(body: _Element, kind: str, classes: Mapping[str, _Defaults], path: Path) -> None:
    """Give what is on a body, and on those below it, the attributes of its class. kind: that of what names none."""
    kind = body.get("childclass", kind)
    for one in body:
        if one.tag == "body":
            _say_all(one, kind, classes, path)
            continue
        own = one.get("class", kind)
        if own != "main" and own not in classes:
            raise HandtrackError(
                f"{path}: a <{one.tag}> is of the class '{own}', which no <default> has."
            )
        one.attrib = {**classes.get(own, {}).get(one.tag, {}), **one.attrib}


class _Robot:
    """A file whose elements say all of themselves, but for what holds in all of it."""

    def __init__(self, root: _Element, path: Path) -> None:
        self._path, self._bodies = path, list(root.iter("body"))
        self._compiler = {k: v for c in root.findall("compiler") for k, v in c.attrib.items()}
        files = root.findall("asset/mesh")
        self._meshes = {m.get("name") or Path(m.get("file", "")).stem: m for m in files}
        tied = [one for one in root.findall("equality/joint") if one.get("joint2")]
        self._follows = {str(one.get("joint1")): self._followed(one.attrib) for one in tied}

    def links(self, body: _Element, parent: str | None, above: Floats[D4, D4]) -> Iterator[Link]:
        """Yield a body's link and those below it.

        Parameters
        ----------
        above
            The parent's body frame → its link's, which is where its hinges are [m].
        """
        name = body.get("name") or f"body{self._bodies.index(body)}"
        joints = [one.attrib for one in body.findall("joint")]
        if parent is None:  # the root is free anyway
            joints = [given for given in joints if given.get("type") != "free"]
            if joints:
                raise HandtrackError(
                    f"{self._path}: body '{name}' turns in the world; expected a base that is fixed or free, and joints above it."
                )
        anchor = self._anchor(name, joints)
        frame, own = above @ self._frame(body.attrib) @ rigid(anchor), rigid(-anchor)
        hinges = [
            self._hinge(given, f"{name}_{k}" if k else name) for k, given in enumerate(joints)
        ]
        label = hinges[0].name if hinges else ""
        yield Link(name, parent, frame, hinges, self._shapes(body, own), label)
        for site in (one.attrib for one in body.findall("site")):
            if site.get("name"):
                yield Link(site["name"], name, own @ self._frame(site))
        for child in body.findall("body"):
            yield from self.links(child, name, own)

    def _anchor(self, name: str, joints: list[dict[str, str]]) -> Floats[D3]:
        """Return where a body's hinges turn, in its frame [m]."""
        anchors = [self._vector(given, "pos") for given in joints] or [np.zeros(3)]
        if max(float(np.linalg.norm(a - anchors[0])) for a in anchors) > _SAME_M:
            raise HandtrackError(
                f"{self._path}: the joints of body '{name}' turn about different points; expected one `pos` for all, or a body for each."
            )
        return anchors[0]

    def _hinge(self, given: _Given, usual: str) -> Hinge:
        name, kind = given.get("name", usual), given.get("type", "hinge")
        if kind != "hinge":
            raise HandtrackError(
                f"{self._path}: joint '{name}' is a {kind}; expected hinges: this program's joints turn about one axis each."
            )
        axis = self._vector(given, "axis", (0.0, 0.0, 1.0))
        limits = (-np.pi, np.pi)
        usual_limited = "range" in given and self._compiler.get("autolimits", "true") == "true"
        limited = given.get("limited", "auto")
        if limited == "true" or (limited == "auto" and usual_limited):
            at_zero = numbers(given, "ref", (0.0,), self._path, 1)
            asked = numbers(given, "range", (0.0, 0.0), self._path, 2)
            low, high = self._radians(asked - at_zero).tolist()
            limits = (low, high)
        return Hinge(name, axis, limits, self._follows.get(name))

    def _shapes(self, body: _Element, own: Floats[D4, D4]) -> list[Shape]:
        """Return what a body looks like; what only touches counts where nothing is there to be looked at."""
        visuals, touches = list[Shape](), list[Shape]()
        for given in (geom.attrib for geom in body.findall("geom")):
            is_look = given.get("contype") == "0" and given.get("conaffinity") == "0"
            (visuals if is_look else touches).extend(self._shape(given, own))
        return visuals or touches

    def _shape(self, given: _Given, own: Floats[D4, D4]) -> list[Shape]:
        kind = given.get("type", "mesh" if "mesh" in given else "sphere")
        frame = self._frame(given)
        if kind == "mesh":
            return self._mesh(given, own @ frame)
        if kind not in SIZES:
            return []
        size = numbers(given, "size", None, self._path)
        if "fromto" in given:
            ends = numbers(given, "fromto", None, self._path, 6).reshape(2, 3)
            along = ends[1] - ends[0]
            frame = rigid(ends.mean(axis=0), _towards(along))
            across = size[:1] if SIZES[kind] < 3 else np.resize(size[:2], 2)
            size = np.append(across, 0.5 * np.linalg.norm(along))
        if len(size) < SIZES[kind]:
            raise HandtrackError(
                f"{self._path}: a {kind} of {len(size)} sizes; expected {SIZES[kind]}."
            )
        return [Shape(own @ frame, ellipsoid_radii(kind, size))]

    def _mesh(self, given: _Given, frame: Floats[D4, D4]) -> list[Shape]:
        asset = self._meshes.get(given.get("mesh", ""))
        if asset is None or not asset.get("file"):
            return []
        folder = self._compiler.get("meshdir", self._compiler.get("assetdir", ""))
        file = self._path.parent / folder / str(asset.get("file"))
        scale = numbers(asset.attrib, "scale", (1.0, 1.0, 1.0), self._path, 3)
        return mesh_shapes(file, scale, frame)

    # ---- what attributes mean

    def _followed(self, tied: _Given) -> tuple[str, float]:
        """Return the joint that another follows, with the ratio."""
        terms = numbers(tied, "polycoef", (0.0, 1.0), self._path)
        if np.abs(np.delete(terms, 1)).max(initial=0.0) > 0 or len(terms) < 2:
            raise HandtrackError(
                f"{self._path}: joint '{tied.get('joint1')}' follows '{tied['joint2']}' by polycoef "
                f"{tied.get('polycoef')}; expected a ratio alone: 0 RATIO 0 0 0."
            )
        return tied["joint2"], float(terms[1])

    def _vector(
        self, given: _Given, key: str, default: tuple[float, float, float] = (0.0, 0.0, 0.0)
    ) -> Floats[D3]:
        return numbers(given, key, default, self._path, 3)

    def _radians(self, values: Floats) -> Floats:
        return values if self._compiler.get("angle", "degree") == "radian" else np.deg2rad(values)

    def _frame(self, given: _Given) -> Floats[D4, D4]:
        """Return where an element is in the one that holds it [m]."""
        return rigid(self._vector(given, "pos"), self._turn(given))

    def _turn(self, given: _Given) -> Floats[D3, D3]:
        """Return the rotation that an element says, in one of five ways."""
        if "quat" in given:
            return matrix_from_quaternion(numbers(given, "quat", None, self._path, 4))
        if "axisangle" in given:
            *axis, angle = numbers(given, "axisangle", None, self._path, 4)
            return rotation_matrix(_unit(np.array(axis)) * self._radians(np.array(angle)))
        if "euler" in given:
            angles = self._radians(numbers(given, "euler", None, self._path, 3))
            turn = np.eye(3)
            for letter, angle in zip(self._compiler.get("eulerseq", "xyz"), angles, strict=True):
                one = rotation_matrix(angle * np.eye(3)["xyz".index(letter.lower())])
                turn = turn @ one if letter.islower() else one @ turn
            return turn
        if "xyaxes" in given:
            x, y = numbers(given, "xyaxes", None, self._path, 6).reshape(2, 3)
            x = _unit(x)
            y = _unit(y - x * (x @ y))
            return np.stack([x, y, np.cross(x, y)], axis=1)
        if "zaxis" in given:
            return _towards(numbers(given, "zaxis", None, self._path, 3))
        return np.eye(3)


def _unit(vector: Floats) -> Floats:
    return vector / max(float(np.linalg.norm(vector)), 1e-12)


def _towards(direction: Floats[D3]) -> Floats[D3, D3]:
    """Return the smallest rotation that takes z to a direction; none for a direction of no length."""
    if not direction.any():
        return np.eye(3)
    return Rotation.align_vectors(direction, [0.0, 0.0, 1.0])[0].as_matrix()
