"""GLB (glTF 2.0): the model's skin on an animated skeleton, for Blender, game engines and the web."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np

from handtrack.arrays import D4, Array, Axes, B, F, Floats, V
from handtrack.export.shown.mesh import model_skin
from handtrack.export.table import ResultsTable
from handtrack.files.atomic import replacing
from handtrack.geometry.rotation import quaternion_wxyz
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.surfaces.part_mesh import PartMesh

_BLEND_M = 0.006  # about a fingertip's radius: creases of joints are as wide
# glTF 2.0, sections 3.6.2 and 3.9: kinds of numbers, and buffers for vertices and for indices
_UINT8, _UINT32, _FLOAT32 = 5121, 5125, 5126
_VERTICES, _INDICES = 34962, 34963
_SKIN_COLOUR = (0.87, 0.68, 0.57, 1.0)
_KINDS = {(): "SCALAR", (3,): "VEC3", (4,): "VEC4", (4, 4): "MAT4"}


def write(path: Path, table: ResultsTable) -> None:
    """Write one skinned mesh, a joint for each bone, and an animation with a key at every frame: the root's place, every bone's
    turn. Metres; the axes are the world's of the recording (glTF means +y to be up). Lost frames hold the last estimate.
    """
    model, track, buffer = table.model, table.track, _Buffer()
    skeleton, skin = model.skeleton, model_skin(model)
    rest = model.bones(model.params_from({}))
    local = local_poses(track.T_world_bone, skeleton.parent)
    bones = skeleton.bone_count
    nodes: list[dict[str, Any]] = []
    for bone, name in enumerate(skeleton.bone_names):
        node: dict[str, Any] = {"name": name}
        children = np.flatnonzero(skeleton.parent == bone).tolist()
        node |= {"children": children} if children else {}
        node["translation"] = local[0, bone, :3, 3].tolist()
        node["rotation"] = np.roll(quaternion_wxyz(local[0, bone, :3, :3]), -1).tolist()
        nodes.append(node)
    nodes.append({"name": "skin", "mesh": 0, "skin": 0})
    posed, normal = skin.carried(rest)
    on, weights = blended(model, skin)
    attributes = {
        "POSITION": buffer.add(posed, _FLOAT32, True, _VERTICES),
        "NORMAL": buffer.add(normal, _FLOAT32, target=_VERTICES),
        "JOINTS_0": buffer.add(on, _UINT8, target=_VERTICES),
        "WEIGHTS_0": buffer.add(weights, _FLOAT32, target=_VERTICES),
    }
    surface = {
        "attributes": attributes,
        "indices": buffer.add(skin.faces.ravel(), _UINT32, target=_INDICES),
        "material": 0,
    }
    back = np.swapaxes(np.linalg.inv(rest.T_world_bone), 1, 2)  # column by column
    samplers, channels = _animation(buffer, track.time_s, local)
    tree = {
        "asset": {"version": "2.0", "generator": f"handtrack {track.version}"},
        "scene": 0,
        "scenes": [{"name": track.session, "nodes": [0, bones]}],
        "nodes": nodes,
        "meshes": [{"name": model.name, "primitives": [surface]}],
        "materials": [
            {
                "name": "skin",
                "doubleSided": True,
                "pbrMetallicRoughness": {
                    "baseColorFactor": _SKIN_COLOUR,
                    "metallicFactor": 0.0,
                    "roughnessFactor": 0.8,
                },
            }
        ],
        "skins": [
            {
                "inverseBindMatrices": buffer.add(back, _FLOAT32),
                "skeleton": 0,
                "joints": list(range(bones)),
            }
        ],
        "animations": [
            {"name": track.session or "track", "samplers": samplers, "channels": channels}
        ],
    }
    with replacing(path) as part:
        part.write_bytes(_packed(tree | buffer.tables, bytes(buffer.data)))


def blended(model: ArticulatedModel, skin: PartMesh) -> tuple[Array[V, D4], Floats[V, D4]]:
    """Return the bones (V, 4) that carry each vertex, and their weights: its own, and the neighbours it is near to.

    Half of a vertex that lies on its own bone's ellipsoids and on a neighbour's is each one's; a vertex _BLEND_M away from a
    neighbour is its own bone's alone. For looking: what is measured is the rigid surface.
    """
    skeleton, shapes = model.skeleton, model.ellipsoids["fine"]
    posed = model.bones(model.rest_params())
    points, _ = skin.carried(posed)
    # at least four columns, of which some may be of no bone
    share = np.zeros((len(points), max(skeleton.bone_count, 4)))
    for bone in range(skeleton.bone_count):
        near = np.full(len(points), np.inf)
        local = (points - posed.position[bone]) @ posed.rotation[bone]
        for k in np.flatnonzero(shapes.bone == bone):
            scaled = (local - shapes.centre[k]) @ shapes.rotation[k] / shapes.radii[k]
            level = np.linalg.norm(scaled, axis=1)
            slope = np.linalg.norm(scaled / shapes.radii[k], axis=1) / np.maximum(level, 1e-9)
            near = np.minimum(near, (level - 1) / np.maximum(slope, 1e-9))  # to first order
        share[:, bone] = np.clip(1 - near / _BLEND_M, 0, 1)
    related = np.zeros((skeleton.bone_count, skeleton.bone_count), dtype=bool)
    below = np.flatnonzero(skeleton.parent >= 0)
    related[below, skeleton.parent[below]] = related[skeleton.parent[below], below] = True
    share[:, : skeleton.bone_count] *= related[skin.bone]
    share[np.arange(len(points)), skin.bone] = 1.0
    bones = np.argsort(-share, axis=1, kind="stable")[:, :4]
    weights = np.take_along_axis(share, bones, axis=1)
    weights = (weights / weights.sum(axis=1, keepdims=True)).astype(np.float32)
    return np.where(weights > 0, bones, 0).astype(np.uint8), weights


def local_poses(T_world_bone: Floats[F, B, D4, D4], parent: Array[B]) -> Floats[F, B, D4, D4]:
    """Return each bone's pose in its parent's frame, the root's in the world."""
    local = T_world_bone.copy()
    below = np.flatnonzero(parent >= 0)
    local[:, below] = np.linalg.solve(T_world_bone[:, parent[below]], T_world_bone[:, below])
    return local


def continuous(quaternions: Floats[F, D4]) -> Floats[F, D4]:
    """Return the same turns, each quaternion on the side of the one before: what is interpolated takes the short way."""
    dots = (quaternions[1:] * quaternions[:-1]).sum(axis=1)
    signs = np.concatenate([[1.0], np.cumprod(np.where(dots < 0, -1.0, 1.0))])
    return quaternions * signs[:, None]


def _animation(
    buffer: _Buffer, time_s: Floats[F], local: Floats[F, B, D4, D4]
) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    times = buffer.add(time_s - time_s[0], _FLOAT32, bounds=True)
    moved = [(0, "translation", local[:, 0, :3, 3])]
    for bone in range(local.shape[1]):
        turns = continuous(quaternion_wxyz(local[:, bone, :3, :3]))
        if bone == 0 or np.abs(turns - turns[0]).max() > 1e-12:
            moved.append((bone, "rotation", np.roll(turns, -1, axis=1)))
    samplers = [{"input": times, "output": buffer.add(v, _FLOAT32)} for _, _, v in moved]
    channels = [
        {"sampler": k, "target": {"node": bone, "path": what}}
        for k, (bone, what, _) in enumerate(moved)
    ]
    return samplers, channels


class _Buffer:
    """The binary part: arrays one after the other, each with its view and accessor."""

    def __init__(self) -> None:
        self.data = bytearray()
        self._views: list[dict[str, Any]] = []
        self._accessors: list[dict[str, Any]] = []

    def add(
        self, values: Array[*Axes], kind: int, bounds: bool = False, target: int | None = None
    ) -> int:
        """Return the number of the accessor of an array.

        Parameters
        ----------
        bounds
            Say the least and the largest, where glTF asks for them.
        target
            What a mesh's are for.
        """
        types = {_UINT8: np.uint8, _UINT32: np.uint32, _FLOAT32: np.float32}
        array = np.ascontiguousarray(values, types[kind])
        view = {"buffer": 0, "byteOffset": len(self.data), "byteLength": array.nbytes}
        view |= {} if target is None else {"target": target}
        self.data += array.tobytes()
        self.data += bytes(-len(self.data) % 4)
        table: dict[str, Any] = {"bufferView": len(self._views), "componentType": kind}
        table |= {"count": len(array), "type": _KINDS[array.shape[1:]]}
        if bounds:
            rows = array.reshape(len(array), -1)
            table |= {"min": rows.min(axis=0).tolist(), "max": rows.max(axis=0).tolist()}
        self._views.append(view)
        self._accessors.append(table)
        return len(self._accessors) - 1

    @property
    def tables(self) -> dict[str, Any]:
        return {
            "buffers": [{"byteLength": len(self.data)}],
            "bufferViews": self._views,
            "accessors": self._accessors,
        }


def _packed(tree: dict[str, Any], data: bytes) -> bytes:
    text = json.dumps(tree, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    body = struct.pack("<II", len(text), 0x4E4F534A) + text  # "JSON"
    body += struct.pack("<II", len(data), 0x004E4942) + data  # "BIN"
    return struct.pack("<III", 0x46546C67, 2, 12 + len(body)) + body  # "glTF"
