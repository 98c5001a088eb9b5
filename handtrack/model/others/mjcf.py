"""MJCF → definition: a robot hand as MuJoCo describes it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from handtrack.arrays import D3, Floats
from handtrack.errors import HandtrackError
from handtrack.geometry.rotation import matrix_from_quaternion, rotation_matrix
from handtrack.model.others import shapes
from handtrack.model.others.tree import Hinge, Link, Shape, definition_of, hinge, numbers, read_root

_EXPANDS = ("include", "frame", "replicate", "attach", "composite", "flexcomp")
"""what MuJoCo makes bodies of when it loads a file; its own saved form has none of them"""
_SAME_M = 1e-6
"""hinges of a body whose anchors differ by less have one"""
_Element = ElementTree.Element
_Given = Mapping[str, str]


def read_mjcf(path: Path) -> dict[str, Any]:
    """Return the definition of a robot's MJCF. Raises HandtrackError for what is none, slides, or must be expanded first."""
    root = read_root(path, "mujoco", "MJCF")
    expands = next((one.tag for one in root.iter() if one.tag in _EXPANDS), None)
    if expands is not None:
        raise HandtrackError(
            f"{path}: it has <{expands}>, which MuJoCo makes bodies of. Let it write what it made: "
            "`mujoco.MjSpec.from_file(...).to_xml()` after `.compile()`, or `mj_saveLastXML`."
        )
    robot = _Robot(root, path)
    tops = [b for world in root.findall("worldbody") for b in world.findall("body")]
    moving = [b for b in tops if next(b.iter("joint"), None) is not None]
    if len(moving) != 1:
        raise HandtrackError(
            f"{path}: {len(moving)} bodies with joints stand in the world; expected one, the hand."
        )
    links = list(robot.links(moving[0], None, np.zeros(3), "main"))
    return definition_of(root.get("model", path.stem), links, str(path))


@dataclass
class _Robot:
    """A file: what its elements mean that do not say it themselves."""

    root: _Element
    path: Path
    compiler: dict[str, str] = field(init=False)
    defaults: dict[str, dict[str, dict[str, str]]] = field(init=False, default_factory=dict)
    """class → element → its attributes"""
    meshes: dict[str, _Element] = field(init=False)
    follows: dict[str, tuple[str, float]] = field(init=False)

    def __post_init__(self) -> None:
        self.compiler = {k: v for c in self.root.findall("compiler") for k, v in c.attrib.items()}
        for top in self.root.findall("default"):
            self._read_defaults(top, {})
        files = [m for assets in self.root.findall("asset") for m in assets.findall("mesh")]
        self.meshes = {m.get("name") or Path(m.get("file", "")).stem: m for m in files}
        tied = [one for table in self.root.findall("equality") for one in table.findall("joint")]
        self.follows = dict(self._followed(one) for one in tied if one.get("joint2"))

    def links(
        self, body: _Element, parent: str | None, anchor: Floats[D3], kind: str
    ) -> Iterator[Link]:
        """Yield a body's link and those below it.

        Parameters
        ----------
        anchor
            Where its parent's hinges are, in the parent's body frame [m].
        kind
            The class of what names none.
        """
        kind = body.get("childclass", kind)
        name = body.get("name") or f"body{list(self.root.iter('body')).index(body)}"
        joints = [(one, self._given(one, kind)) for one in body.findall("joint")]
        if parent is None:  # the root is free anyway
            joints = [(one, given) for one, given in joints if given.get("type") != "free"]
            if joints:
                raise HandtrackError(
                    f"{self.path}: body '{name}' turns in the world; expected a base that is fixed or free, and joints above it."
                )
        own = self._anchor(name, [given for _, given in joints])
        turn, place = self._turn(body.attrib), self._vector(body.attrib, "pos")
        hinges = [
            self._hinge(given, f"{name}_{k}" if k else name) for k, (_, given) in enumerate(joints)
        ]
        visuals = self._shapes(body, kind, own)
        label = hinges[0].name if hinges else ""
        yield Link(name, parent, place + turn @ own - anchor, turn, hinges, visuals, label)
        for site in body.findall("site"):
            given = self._given(site, kind)
            if site.get("name"):
                yield Link(
                    str(site.get("name")), name, self._vector(given, "pos") - own, self._turn(given)
                )
        for child in body.findall("body"):
            yield from self.links(child, name, own, kind)

    def _anchor(self, name: str, joints: list[_Given]) -> Floats[D3]:
        """Return where a body's hinges turn, in its frame [m]."""
        anchors = [self._vector(given, "pos") for given in joints] or [np.zeros(3)]
        if max(float(np.linalg.norm(a - anchors[0])) for a in anchors) > _SAME_M:
            raise HandtrackError(
                f"{self.path}: the joints of body '{name}' turn about different points; expected one `pos` for all, or a body for each."
            )
        return anchors[0]

    def _hinge(self, given: _Given, usual: str) -> Hinge:
        name, kind = given.get("name", usual), given.get("type", "hinge")
        if kind != "hinge":
            raise HandtrackError(
                f"{self.path}: joint '{name}' is a {kind}; expected hinges: this program's joints turn about one axis each."
            )
        axis = self._vector(given, "axis", (0.0, 0.0, 1.0))
        limits = (-np.pi, np.pi)
        usual_limited = "range" in given and self.compiler.get("autolimits", "true") == "true"
        limited = given.get("limited", "auto")
        if limited == "true" or (limited == "auto" and usual_limited):
            at_zero = numbers(given, "ref", (0.0,), self.path, 1)
            asked = numbers(given, "range", (0.0, 0.0), self.path, 2)
            low, high = self._radians(asked - at_zero).tolist()
            limits = (low, high)
        return hinge(name, axis, limits, self.follows.get(name), self.path)

    def _shapes(self, body: _Element, kind: str, anchor: Floats[D3]) -> list[Shape]:
        """Return what a body looks like; what only touches counts where nothing is there to be looked at."""
        visuals, touches = list[Shape](), list[Shape]()
        for geom in body.findall("geom"):
            given = self._given(geom, kind)
            is_look = given.get("contype") == "0" and given.get("conaffinity") == "0"
            (visuals if is_look else touches).extend(self._shape(given, anchor))
        return visuals or touches

    def _shape(self, given: _Given, anchor: Floats[D3]) -> list[Shape]:
        kind = given.get("type", "mesh" if "mesh" in given else "sphere")
        place, turn = self._vector(given, "pos") - anchor, self._turn(given)
        if kind == "mesh":
            return self._mesh(given, place, turn)
        if kind not in ("sphere", "capsule", "cylinder", "ellipsoid", "box"):
            return []
        size = numbers(given, "size", None, self.path)
        if "fromto" in given:
            ends = numbers(given, "fromto", None, self.path, 6).reshape(2, 3)
            along = ends[1] - ends[0]
            half = 0.5 * float(np.linalg.norm(along))
            place, turn = ends.mean(axis=0) - anchor, _towards(along)
            size = np.array(
                [size[0], half]
                if kind in ("capsule", "cylinder")
                else [size[0], size[min(1, len(size) - 1)], half]
            )
        wanted = {"sphere": 1, "capsule": 2, "cylinder": 2}.get(kind, 3)
        if len(size) < wanted:
            raise HandtrackError(f"{self.path}: a {kind} of {len(size)} sizes; expected {wanted}.")
        if kind == "sphere":
            radii = shapes.sphere(float(size[0]))
        elif kind == "ellipsoid":
            radii = size[:3]
        elif kind == "box":
            radii = shapes.box(2.0 * size[:3])
        else:
            radii = getattr(shapes, kind)(float(size[0]), 2.0 * float(size[1]))
        return [Shape(place, turn, radii)]

    def _mesh(self, given: _Given, place: Floats[D3], turn: Floats[D3, D3]) -> list[Shape]:
        asset = self.meshes.get(given.get("mesh", ""))
        if asset is None or not asset.get("file"):
            return []
        folder = self.compiler.get("meshdir", self.compiler.get("assetdir", ""))
        file = self.path.parent / folder / str(asset.get("file"))
        scale = numbers(asset.attrib, "scale", (1.0, 1.0, 1.0), self.path, 3)
        return shapes.mesh(file, scale, place, turn)

    # ---- what attributes mean

    def _given(self, element: _Element, kind: str) -> dict[str, str]:
        """Return an element's attributes with those of its class."""
        kind = element.get("class", kind)
        if kind != "main" and kind not in self.defaults:
            raise HandtrackError(
                f"{self.path}: a <{element.tag}> is of the class '{kind}', which no <default> has."
            )
        return {**self.defaults.get(kind, {}).get(element.tag, {}), **element.attrib}

    def _read_defaults(self, table: _Element, above: dict[str, dict[str, str]]) -> None:
        own = {tag: dict(given) for tag, given in above.items()}
        for one in table:
            if one.tag != "default":
                own[one.tag] = {**own.get(one.tag, {}), **one.attrib}
        self.defaults[table.get("class", "main")] = own
        for below in table.findall("default"):
            self._read_defaults(below, own)

    def _followed(self, tied: _Element) -> tuple[str, tuple[str, float]]:
        """Return a joint and the one that it follows, with the ratio."""
        terms = numbers(tied.attrib, "polycoef", (0.0, 1.0), self.path)
        if np.abs(np.delete(terms, 1)).max(initial=0.0) > 0 or len(terms) < 2:
            raise HandtrackError(
                f"{self.path}: joint '{tied.get('joint1')}' follows '{tied.get('joint2')}' by polycoef "
                f"{tied.get('polycoef')}; expected a ratio alone: 0 RATIO 0 0 0."
            )
        return str(tied.get("joint1")), (str(tied.get("joint2")), float(terms[1]))

    def _vector(
        self, given: _Given, key: str, default: tuple[float, float, float] = (0.0, 0.0, 0.0)
    ) -> Floats[D3]:
        return numbers(given, key, default, self.path, 3)

    def _radians(self, values: Floats) -> Floats:
        return values if self.compiler.get("angle", "degree") == "radian" else np.deg2rad(values)

    def _turn(self, given: _Given) -> Floats[D3, D3]:
        """Return the rotation that an element says, in one of five ways."""
        if "quat" in given:
            return matrix_from_quaternion(_unit(numbers(given, "quat", None, self.path, 4)))
        if "axisangle" in given:
            *axis, angle = numbers(given, "axisangle", None, self.path, 4)
            return rotation_matrix(_unit(np.array(axis)) * self._radians(np.array(angle)))
        if "euler" in given:
            angles = self._radians(numbers(given, "euler", None, self.path, 3))
            turn = np.eye(3)
            for letter, angle in zip(self.compiler.get("eulerseq", "xyz"), angles, strict=True):
                one = rotation_matrix(angle * np.eye(3)["xyz".index(letter.lower())])
                turn = turn @ one if letter.islower() else one @ turn
            return turn
        if "xyaxes" in given:
            x, y = numbers(given, "xyaxes", None, self.path, 6).reshape(2, 3)
            x = _unit(x)
            y = _unit(y - x * (x @ y))
            return np.stack([x, y, np.cross(x, y)], axis=1)
        if "zaxis" in given:
            return _towards(numbers(given, "zaxis", None, self.path, 3))
        return np.eye(3)


def _unit(vector: Floats) -> Floats:
    return vector / max(float(np.linalg.norm(vector)), 1e-12)


def _towards(direction: Floats[D3]) -> Floats[D3, D3]:
    """Return the smallest rotation that takes z to a direction."""
    z = _unit(direction)
    axis = np.cross([0.0, 0.0, 1.0], z)
    sine = float(np.linalg.norm(axis))
    if sine < 1e-12:
        return np.diag([1.0, np.sign(z[2]), np.sign(z[2])]) if z[2] else np.eye(3)
    return rotation_matrix(axis / sine * np.arctan2(sine, z[2]))
