"""Hands in some postures, each as a rigid shape: what a search lays everywhere before it lets fingers move."""

from __future__ import annotations

from functools import cached_property, lru_cache

import numpy as np

from handtrack.arrays import (
    D3,
    D4,
    Array,
    Floats,
    K,
    N,
    P,
    S,
    V,
    X,
    Y,
    Z,
    array_dataclass,
    contiguous,
)
from handtrack.geometry.rotation import rotation_vector
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.pose_library import named_pose
from handtrack.model.surfaces.metaballs import MetaballSurface
from handtrack.model.surfaces.part_mesh import PartMesh
from handtrack.model.surfaces.surface_mesh import surface_mesh
from handtrack.sampling.suppression import apart

_POSTURES = ("open", "curl", "fist", "point")
_WRIST_BENDS_DEG = (0.0, -40.0, 40.0)  # of a forearm in view
_MIDDLE = 0.6  # of the way from the wrist to the middle knuckle: the palm's middle
REACH_M = 0.14
"""Around the palm's middle of a mean hand lies the whole hand, its fingers stretched, and some of the forearm."""
PALM_DEEP_M = 0.014
"""from the palm's skin to its middle"""
PIECE_M = 0.03
"""length of a phalanx, along which a model that is not this person's hand errs alike; it is half as broad"""
_NODE_M = 0.006
_POINT_M = 0.012
_LEAST_BALL_M, _BALLS_COVER = 0.003, 1.5  # radii: a ball stands for those with their middle so near


@array_dataclass
class HandShape:
    """A hand in one posture, in its own frame: the root at the origin, not turned."""

    model: ArticulatedModel
    posture: str
    params: Floats[P]
    """solver parameters"""
    reach: float
    """[m] around the palm's middle: points further away say nothing about this hand"""

    @property
    def is_typical(self) -> bool:
        """Whether this is one of the few shapes that tell where a hand may be at all."""
        model = self.model
        joint = dict(zip(model.parameter_names, model.joint_params(self.params), strict=True))
        return self.posture in ("open", "curl") and not joint.get("wrist_flex")

    @cached_property
    def middle(self) -> Floats[D3]:
        """The palm's middle [m]."""
        return palm_middle(self.model, self.params)

    @cached_property
    def mesh(self) -> PartMesh:
        """The surface, each point on its bone."""
        bones = self.model.bones(self.params)
        return surface_mesh(MetaballSurface.of(self.model), bones, _POINT_M)

    @cached_property
    def samples(self) -> tuple[Floats[V, D3], Floats[V, D3], Array[V]]:
        """Points evenly on the surface, within reach [m]; unit normals, outwards; and whether each is on the forearm, which a sleeve may hide
        anywhere.
        """
        vertices, normals = self.mesh.carried(self.model.bones(self.params))
        near = np.linalg.norm(vertices - self.middle, axis=1) < self.reach
        points, outwards = contiguous(vertices[near], normals[near])
        return points, outwards, self.model.is_forearm(self.mesh.bone[near])

    @cached_property
    def area(self) -> float:
        """Of the surface around each of its points [m²]."""
        vertices, _ = self.mesh.carried(self.model.bones(self.params))
        corners = vertices[self.mesh.faces]
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        return 0.5 * float(np.linalg.norm(across, axis=1).sum()) / len(vertices)

    @cached_property
    def field(self) -> tuple[Array[X, Y, Z], Floats[D3], float]:
        """Distance to the surface, inside and outside, float32, on a grid; its first node and spacing [m]."""
        signed, nodes = self._signed
        return np.abs(signed).astype(np.float32), nodes[0, 0, 0], _NODE_M

    @cached_property
    def spheres(self) -> Floats[K, D4]:
        """Centres and radii of balls that fill the inside [m]."""
        signed, nodes = self._signed
        return _balls(nodes.reshape(-1, 3), -signed.ravel())

    @property
    def _signed(self) -> tuple[Floats[X, Y, Z], Floats[X, Y, Z, D3]]:
        """Signed distances to the surface, and the nodes of a grid where they are."""
        points, bones = self.samples[0], self.model.bones(self.params)
        low, high = points.min(axis=0) - 0.03, points.max(axis=0) + 0.03
        axes = [np.arange(low[i], high[i], _NODE_M) for i in range(3)]
        nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        signed = MetaballSurface.of(self.model).distance(bones, nodes.reshape(-1, 3))
        return signed.reshape(*nodes.shape[:2], -1), nodes

    def params_at(self, rotation: Floats[D3, D3], place: Floats[D3]) -> Floats[P]:
        """Return solver parameters with this posture, turned by rotation, its palm's middle at place."""
        joint = self.model.joint_params(self.params)
        joint[3:6] = rotation_vector(rotation)
        joint[:3] = place - rotation @ self.middle
        return self.model.clipped(self.model.solver_params(joint))


@lru_cache(maxsize=4)
def hand_shapes(model: ArticulatedModel) -> tuple[HandShape, ...]:
    """Return a shape for each posture, and with a forearm for each of some bends of the wrist."""
    bends = _WRIST_BENDS_DEG if model.has_forearm else (0.0,)
    shapes = []
    for posture in _POSTURES:
        joint = named_pose(model, posture)
        for bend in bends:
            if model.has_forearm:
                joint[model.parameter_names.index("wrist_flex")] = np.deg2rad(bend)
            shapes.append(shape_of(model, joint, posture))
    return tuple(shapes)


def group_middles(points: Floats[N, D3], apart_m: float, most: int | None = None) -> Floats[K, D3]:
    """Return the means of groups of points that lie within `apart_m` of the group's first, the first points' groups first."""
    chosen: list[Floats] = []
    while len(points) and (most is None or len(chosen) < most):
        near = np.linalg.norm(points - points[0], axis=1) < apart_m
        chosen.append(points[near].mean(axis=0))
        points = points[~near]
    return np.array(chosen).reshape(-1, 3)


def palm_middle(model: ArticulatedModel, params: Floats[P]) -> Floats[D3]:
    """Return the palm's middle at solver parameters, world [m]."""
    places = model.joint_positions(model.bones(params))
    wrist, knuckle = (places[model.joint_names.index(n)] for n in ("wrist", "middle_mcp"))
    return wrist + _MIDDLE * (knuckle - wrist)


def shape_of(model: ArticulatedModel, joint: Floats[S], posture: str) -> HandShape:
    """Return the shape of joint parameters, whatever their root; posture: what it is called."""
    joint = joint.copy()
    joint[:6] = 0.0
    params = model.clipped(model.solver_params(joint))
    return HandShape(model, posture, params, REACH_M * model.scale.overall)


def _balls(nodes: Floats, depth: Floats) -> Floats:
    """Return (K, 4) balls that fill the inside, the largest first; nodes (N, 3) at depth (N,) below the surface [m]."""
    inside = depth > _LEAST_BALL_M
    left, room = nodes[inside], depth[inside]
    order = np.argsort(-room, kind="stable")
    left, room = left[order], room[order]
    rows = apart(
        range(len(left)),
        lambda a, rest: np.linalg.norm(left[rest] - left[a], axis=1) > _BALLS_COVER * room[a],
    )
    return np.array([[*left[n], room[n]] for n in rows])
