"""Hands that are not handtrack's: skinned meshes read from others' files, all brought into one form."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter1d, maximum_filter1d

from handtrack import HandtrackError
from handtrack.arrays import D3, D4, D5, D21, Array, F, Floats, K, L, T, V
from handtrack.geometry.rotation import rotation_matrix

FINGERS, HINGES = 5, 4
"""of each finger, thumb first: two at its base, its middle joint, its end joint"""
_FRAMES = 1 + 3 * FINGERS
_WEBXR = ("thumb", "index-finger", "middle-finger", "ring-finger", "pinky-finger")
_COMPONENT = {5121: np.uint8, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
_BACK, _FURTHEST_BACK = np.array([0.15, -1.0, -0.8, -0.4]), 0.8
"""direction of a thumb's angles in which it gives way to fingers, our own choice, and by how much at most [rad]"""
_PRESSED_M = 0.002
"""by which skin gives way where fingers touch (Serina et al. 1997)"""
_WIDTH = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}


@dataclass(frozen=True, eq=False)
class HandMesh:
    """A right hand at rest in the hand frame of the contracts (wrist at 0, +y to the fingers, +z out of the back) [m].

    Its vertices hang on 16 frames: the palm, and three of each finger, those after its second, third and fourth hinge.
    """

    name: str
    vertices: Floats[V, D3]
    triangles: Array[T, D3]
    weights: Floats[V, K]
    """(V, 16) sum 1"""
    pivots: Floats[D5, L, D3]
    """(5, 4, 3) [m]"""
    axes: Floats[D5, L, D3]
    """(5, 4, 3) unit; bending is positive about all but a finger's first, about which positive is towards the thumb"""
    keypoints: Floats[D21, D3]
    """at rest, tips on the skin"""
    palmar: int
    """which of the thumb's two hinges at its base, 0 or 1, lifts it towards the palm's side"""

    def posed(self, angles: Floats[D5, L]) -> tuple[Floats[V, D3], Floats[D21, D3]]:
        """Return vertices and keypoints of the hand with angles (5, 4) [rad], in its own frame.

        A finger's angles: towards the thumb, then three bends; the thumb's: towards the palm's side, across, two bends.
        """
        return self.carried(self._frames(angles))

    def carried(self, frames: Floats[F, K, D4]) -> tuple[Floats[V, D3], Floats[D21, D3]]:
        """Return vertices and keypoints as the 16 frames carry them, maps of three or four rows."""
        blended = np.einsum("vk,kij->vij", self.weights, frames)
        vertices = np.einsum("vij,vj->vi", blended[:, :3, :3], self.vertices) + blended[:, :3, 3]
        own = frames[_OF_KEYPOINT]
        points = np.einsum("kij,kj->ki", own[:, :3, :3], self.keypoints) + own[:, :3, 3]
        return vertices, points

    def thumb_outside(self, angles: Floats[T, D5, L]) -> Floats[T, D5, L]:
        """Return the motion whose thumb goes less far across the palm, and bends less, where it would pass through a finger."""
        found, radii, back = angles.copy(), self._radii(), np.zeros(len(angles))
        for n, pose in enumerate(found):
            while back[n] < _FURTHEST_BACK and self._thumb_gap(pose, radii) < -_PRESSED_M:
                back[n] += 0.03
                pose[0] = angles[n, 0] + back[n] * _BACK
        back = gaussian_filter1d(maximum_filter1d(back, 5), 1.5)
        found[:, 0] = angles[:, 0] + back[:, None] * _BACK
        return found

    def _thumb_gap(self, angles: Floats[D5, L], radii: Floats[D5, D3]) -> float:
        """Return how far the thumb's skin is from the fingers' [m]; negative where it is in them."""
        along = np.linspace(0.0, 1.0, 9)[:, None]
        fingers = self.posed(angles)[1][1:].reshape(FINGERS, 4, 1, 3)
        bones = fingers[:, :3] + along * (fingers[:, 1:] - fingers[:, :3])
        far = np.linalg.norm(bones[0, 1:, None, None, :, None] - bones[1:, :, None], axis=-1)
        return float((far.min(axis=(3, 4)) - radii[0, 1:, None, None] - radii[1:]).min())

    def _radii(self) -> Floats[D5, D3]:
        """Return how thick the flesh about each bone is, on average [m]."""
        found = np.empty((FINGERS, 3))
        for finger, part in np.ndindex(found.shape):
            start, end = self.keypoints[1 + 4 * finger + part :][:2]
            own = self.vertices[self.weights[:, 1 + 3 * finger + part] > 0.7] - start
            share = own @ (end - start) / ((end - start) @ (end - start))
            off = own - share[:, None] * (end - start)
            found[finger, part] = np.linalg.norm(off[(share > 0) & (share < 1)], axis=1).mean()
        return found

    def _frames(self, angles: Floats) -> Floats[F, D4, D4]:
        if self.palmar:
            angles = angles.copy()
            angles[0, :2] = angles[0, 1::-1]
        frames = np.tile(np.eye(4), (_FRAMES, 1, 1))
        for finger in range(FINGERS):
            pose = np.eye(4)
            for hinge in range(HINGES):
                turn = rotation_matrix(self.axes[finger, hinge] * angles[finger, hinge])
                pivot = self.pivots[finger, hinge]
                local = np.eye(4)
                local[:3, :3], local[:3, 3] = turn, pivot - turn @ pivot
                pose = pose @ local
                if hinge:
                    frames[3 * finger + hinge] = pose
        return frames


_OF_KEYPOINT = np.array([0, *(3 * f + k for f in range(FINGERS) for k in (1, 2, 3, 3))])
"""the frame in which each of the 21 points is fixed: wrist and knuckles lie in no moving one, but turn about themselves"""


def read_meshes(folder: Path) -> dict[str, HandMesh]:
    """Return the hands of a folder that holds `webxr_generic_hand` or `umetrack_generic_hand`, or both.

    Raises HandtrackError where it has neither.
    """
    webxr = folder / "webxr_generic_hand" / "right.glb"
    umetrack = folder / "umetrack_generic_hand" / "generic_hand_model.json"
    found = {}
    if webxr.is_file():
        found["webxr"] = _webxr(webxr)
    if umetrack.is_file():
        found["umetrack"] = _umetrack(umetrack)
    if not found:
        raise HandtrackError(
            f"{folder}: no hand mesh there; expected {webxr.parent.name}/{webxr.name} or "
            f"{umetrack.parent.name}/{umetrack.name}. Name the folder that holds them."
        )
    return found


def _upright(points: Floats) -> Floats[D3, D3]:
    """Return the rotation into the hand frame of a right hand's wrist, index, middle and little knuckle."""
    wrist, index, middle, little = points
    y = (middle - wrist) / np.linalg.norm(middle - wrist)
    x = little - index
    x = x - y * (x @ y)
    x /= np.linalg.norm(x)
    return np.stack([x, y, np.cross(x, y)])


def _webxr(path: Path) -> HandMesh:
    document, data = _glb(path)
    nodes, skin = document["nodes"], document["skins"][0]
    names = [nodes[j]["name"] for j in skin["joints"]]
    bind = _accessor(document, data, skin["inverseBindMatrices"]).reshape(-1, 4, 4)
    world = np.linalg.inv(np.swapaxes(bind, 1, 2).astype(float))
    joint = dict(zip(names, world, strict=True))
    at = {name: pose[:3, 3] for name, pose in joint.items()}
    part = document["meshes"][0]["primitives"][0]
    raw = {k: _accessor(document, data, v) for k, v in part["attributes"].items()}
    vertices = raw["POSITION"].astype(float)
    triangles = _accessor(document, data, part["indices"]).reshape(-1, 3).astype(int)
    frame_of = np.array([_webxr_frame(name) for name in names])
    weights = np.zeros((len(vertices), _FRAMES))
    share = raw["WEIGHTS_0"] / raw["WEIGHTS_0"].sum(axis=1, keepdims=True)
    for k in range(4):
        np.add.at(weights, (np.arange(len(vertices)), frame_of[raw["JOINTS_0"][:, k]]), share[:, k])
    knuckle = [f"{f}-phalanx-proximal" for f in (_WEBXR[1], _WEBXR[2], _WEBXR[4])]
    turn = _upright(np.array([at["wrist"], *(at[k] for k in knuckle)]))
    chains, axes, tips = [], [], []
    for f, finger in enumerate(_WEBXR):
        parts = ["metacarpal", "phalanx-proximal", "phalanx-distal"]
        if f:
            parts = ["phalanx-proximal", "phalanx-intermediate", "phalanx-distal"]
        chain = [f"{finger}-{p}" for p in parts]
        chains.append([chain[0], *chain])
        bend = [-joint[c][:3, 0] for c in chain]
        axes.append([joint[chain[0]][:3, 1], *bend])
        tip, last = at[f"{finger}-tip"], at[chain[-1]]
        tips.append(_skin_point(vertices, last, tip - last))
    pivots = np.array([[at[c] for c in chain] for chain in chains])
    points = [at["wrist"]]
    for f in range(FINGERS):
        points += [pivots[f, 1], pivots[f, 2], pivots[f, 3], tips[f]]
    return _made("webxr", vertices, triangles, weights, pivots, np.array(axes), points, turn)


def _webxr_frame(name: str) -> int:
    for f, finger in enumerate(_WEBXR):
        if name.startswith(finger):
            order = ["phalanx-proximal", "phalanx-intermediate", "phalanx-distal"]
            if f == 0:
                order = ["metacarpal", "phalanx-proximal", "phalanx-distal"]
            if name.endswith("tip"):
                return 3 * f + 3
            part = name[len(finger) + 1 :]
            return 3 * f + 1 + order.index(part) if part in order else 0
    return 0


def _umetrack(path: Path) -> HandMesh:
    raw = {k: np.array(v) for k, v in json.loads(path.read_text()).items()}
    mirror = np.array([[0.0, 0, -1], [1, 0, 0], [0, 1, 0]])  # a left hand's frame → a right hand's
    pivots = raw["joint_rest_positions"][:20].reshape(FINGERS, HINGES, 3) @ mirror.T * 1e-3
    axes = -raw["joint_rotation_axes"][:20].reshape(FINGERS, HINGES, 3) @ mirror.T
    vertices = raw["mesh_vertices"] @ mirror.T * 1e-3
    dense = raw["dense_bone_weights"]
    weights = np.column_stack([dense[:, 0] + dense[:, 1], dense[:, 2:]])
    marks = raw["landmark_rest_positions"] @ mirror.T * 1e-3
    points = [marks[5]]
    for f in range(FINGERS):
        base = pivots[f, 1] if f else 0.5 * (pivots[f, 0] + pivots[f, 1])
        points += [base, pivots[f, 2], pivots[f, 3], marks[f]]
    turn = _upright(np.array([points[0], points[5], points[9], points[17]]))
    triangles = raw["mesh_triangles"].astype(int)
    return _made("umetrack", vertices, triangles, weights, pivots, axes, points, turn)


def _made(name, vertices, triangles, weights, pivots, axes, points, turn) -> HandMesh:
    """Return the hand in its frame, axes' signs as promised."""
    wrist = points[0]
    axes = axes @ turn.T
    axes /= np.linalg.norm(axes, axis=2, keepdims=True)
    axes[1:, 0] *= np.where(axes[1:, :1, 2] < 0, -1.0, 1.0)
    axes[1:, 1:] *= np.where(axes[1:, 1:, :1] > 0, -1.0, 1.0)
    pivots, points = (pivots - wrist) @ turn.T, (np.array(points) - wrist) @ turn.T
    moves = np.cross(axes[0, :2], points[4] - pivots[0, :2])  # of the thumb's tip
    palmar = int(np.argmax(np.abs(moves[:, 2]) - np.abs(moves[:, 0])))
    axes[0, palmar] *= -np.sign(moves[palmar, 2])
    axes[0, 1 - palmar] *= np.sign(moves[1 - palmar, 0])
    vertices = (vertices - wrist) @ turn.T
    return HandMesh(name, vertices, triangles, weights, pivots, axes, points, palmar)


def _skin_point(vertices: Floats, start: Floats, direction: Floats) -> Floats[D3]:
    """Return where the ray from a finger's last joint leaves the skin: the furthest vertex along it, on the ray."""
    along = direction / np.linalg.norm(direction)
    off = vertices - start
    reach = off @ along
    near = (np.linalg.norm(off - reach[:, None] * along, axis=1) < 0.006) & (reach < 0.05)
    return start + along * reach[near].max()


def _glb(path: Path) -> tuple[dict, bytes]:
    raw = path.read_bytes()
    length = int.from_bytes(raw[12:16], "little")
    return json.loads(raw[20 : 20 + length]), raw[20 + length + 8 :]


def _accessor(document: dict, data: bytes, index: int) -> Array:
    entry = document["accessors"][index]
    view = document["bufferViews"][entry["bufferView"]]
    kind, width = np.dtype(_COMPONENT[entry["componentType"]]), _WIDTH[entry["type"]]
    start = view.get("byteOffset", 0) + entry.get("byteOffset", 0)
    step = view.get("byteStride", kind.itemsize * width)
    rows = np.lib.stride_tricks.as_strided(
        np.frombuffer(data, np.uint8, offset=start), (entry["count"], kind.itemsize * width), (step, 1)
    )  # fmt: skip
    found = np.ascontiguousarray(rows).view(kind)
    return found[:, 0] if width == 1 else found
