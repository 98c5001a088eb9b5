"""What is looked at: an animated mesh (GLB), pages that any browser shows without network, and a film of the model over every camera's images."""

from __future__ import annotations

import html
import json
import struct
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from handtrack.arrays import D3, D4, Array, Axes, B, F, Floats, H, J, V, W, runs
from handtrack.diagnostics.residuals import outline_polygons
from handtrack.errors import HandtrackError
from handtrack.export.table import ResultsTable
from handtrack.files.atomic import check_film, replace_text, replacing
from handtrack.geometry.rotation import quaternion_wxyz
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.ellipsoids import Ellipsoids
from handtrack.model.kinematics import BonePoses
from handtrack.model.metaballs import SHARPNESS_PER_M, MetaballSurface, model_mesh, relaxed_mesh
from handtrack.model.part_mesh import PartMesh, vertex_normals
from handtrack.session.session import Session
from handtrack.tracking.frame.result import Status

# ---- The skin of a model as one mesh, each vertex on one bone


def model_skin(model: ArticulatedModel) -> PartMesh:
    """Return a hand's merged surface in one piece, where it has metaballs; else its parts."""
    if model.kind != "hand" or "metaballs" not in model.ellipsoids:
        return model_mesh(model)
    relaxed = model.bones(model.rest_params())
    mesh = relaxed_mesh(model, SHARPNESS_PER_M, "d3")
    turned = np.swapaxes(relaxed.rotation[mesh.bone], 1, 2)
    normals = vertex_normals(mesh.carried(relaxed)[0], mesh.faces)
    return replace(mesh, normal=np.einsum("vij,vj->vi", turned, normals))


# ---- Which named joints are connected by bones: the lines of a stick figure


def joint_links(model: ArticulatedModel) -> list[tuple[int, int]]:
    """Return pairs of joints (nearer to the root, farther): each hangs on the closest one before it along the bones."""
    links = []
    for joint, (bone, point) in enumerate(zip(model.joint_bone, model.joint_point)):
        before = [
            k
            for k in _on(model, int(bone))
            if np.linalg.norm(model.joint_point[k]) < np.linalg.norm(point)
        ]
        above, place = int(bone), point
        while not before and above >= 0:
            place = model.skeleton.offset[above]  # where this bone begins, in the one above it
            above = int(model.skeleton.parent[above])
            before = _on(model, above)
        if before:
            away = np.linalg.norm(model.joint_point[before] - place, axis=1)
            links.append((before[int(np.argmin(away))], joint))
    return links


def _on(model: ArticulatedModel, bone: int) -> list[int]:
    return np.flatnonzero(model.joint_bone == bone).tolist()


# ---- GLB (glTF 2.0): the model's skin on an animated skeleton, for Blender, game engines and the web


_BLEND_M = 0.006  # about a fingertip's radius: creases of joints are as wide
# glTF 2.0, sections 3.6.2 and 3.9: kinds of numbers, and buffers for vertices and for indices
_UINT8, _UINT32, _FLOAT32 = 5121, 5125, 5126
_VERTICES, _INDICES = 34962, 34963
_SKIN_COLOUR = (0.87, 0.68, 0.57, 1.0)
_KINDS = {(): "SCALAR", (3,): "VEC3", (4,): "VEC4", (4, 4): "MAT4"}


def write_glb(path: Path, table: ResultsTable) -> None:
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
    for bone in np.unique(shapes.bone):
        own = shapes.subset(shapes.bone == bone)
        flesh = MetaballSurface(own, np.eye(len(own), dtype=bool))  # none merges with another
        share[:, bone] = np.clip(1 - flesh.distance(posed, points) / _BLEND_M, 0, 1)
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


# ---- A page of the moving skeleton


_PAGE = Path(__file__).with_name("playback.html")
_DIGITS = 5  # of a metre or a quaternion: a hundredth of a millimetre


def write_playback(path: Path, table: ResultsTable) -> None:
    """Write the page: the skin moved by the bones, joints, cameras, timeline with each frame's state and reason."""
    data = json.dumps(scene_of(table), separators=(",", ":")).replace("<", "\\u003c")
    page = _PAGE.read_text(encoding="utf-8")
    page = page.replace("$TITLE", html.escape(table.track.session or "handtrack"))
    replace_text(path, page.replace('"$DATA"', data))


def scene_of(table: ResultsTable) -> dict[str, Any]:
    """Return what the page draws, as JSON has it [m, wxyz]."""
    track, model = table.track, table.model
    skin = model_skin(model)
    turns = quaternion_wxyz(track.T_world_bone[..., :3, :3])
    poses = np.concatenate([track.T_world_bone[..., :3, 3], turns], axis=-1)
    cameras = () if table.rig is None else table.rig
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    return {
        "session": track.session,
        "model": track.model if model.kind == "body" else f"{track.model}, {track.side}",
        "fps": table.fps,
        "frame": track.frame.tolist(),
        "time_s": np.round(track.time_s, 4).tolist(),
        "status": track.status.tolist(),
        "status_names": [status.words for status in Status],
        "reason": [] if track.reason is None else [str(text) for text in track.reason],
        "poses": _rounded(poses.reshape(len(track), -1)),
        "joints": _rounded(track.joint_positions.reshape(len(track), -1)),
        "joint_names": list(track.joint_names),
        "links": joint_links(model),
        "skin": {
            "bone": skin.bone.tolist(),
            "local": _rounded(skin.local),
            "faces": skin.faces.ravel().tolist(),
        },
        "cameras": [
            {
                "name": camera.name,
                "centre": _rounded(camera.centre),
                "corners": _rounded(camera.rays(corners * camera.size - 0.5)),
                "up": _rounded(-camera.rotation[1]),
            }
            for camera in cameras
        ],
    }


def _rounded(values: Any) -> Any:
    return np.round(np.asarray(values, float), _DIGITS).tolist()


# ---- A page on how the tracking went: states, doubts with their reasons, curves


_COLOURS = {0: "#3fa34d", 1: "#f0a028", 2: "#dc3c3c", 3: "#2b7de0", 4: "#8a63d2"}
_MOST_INTERVALS = 40  # a page that one reads: the longest come first
_STYLE = """
:root{color-scheme:light dark;--ink:#1c2430;--paper:#fff;--line:#d5dae1;--soft:#66707f}
@media(prefers-color-scheme:dark){:root{--ink:#e7ebf0;--paper:#14181e;--line:#323a45;--soft:#98a3b3}}
body{margin:2em auto;max-width:900px;padding:0 1em;background:var(--paper);color:var(--ink);font:15px/1.5 system-ui,sans-serif}
h1{font-size:1.4em;margin-bottom:.2em}h2{font-size:1.05em;margin:1.8em 0 .4em}.soft{color:var(--soft)}
table{border-collapse:collapse;width:100%}td,th{padding:.25em .8em .25em 0;text-align:left;border-bottom:1px solid var(--line)}
td.n,th.n{text-align:right;font-variant-numeric:tabular-nums}.lane{width:100%;height:16px;display:block;border-radius:3px}
figure{margin:.4em 0 1em}figcaption span{margin-right:1em;font-size:.85em}i{display:inline-block;width:.8em;height:.8em;border-radius:2px;margin-right:.35em}
svg{width:100%;height:auto}svg text{font-size:11px;fill:var(--soft)}svg .grid{stroke:var(--line)}svg path{stroke-width:1.4}
"""


def write_report(path: Path, table: ResultsTable) -> None:
    """Write the page."""
    track = table.track
    title = html.escape(track.session or "A tracked sequence")
    parts = [
        f"<h1>{title}</h1><p class=soft>{html.escape(_about(table))}</p>",
        "<h2>Frames</h2>",
        _lane(table),
        _counts(table),
        "<h2>Intervals with low confidence, or lost</h2>",
        _intervals(table),
    ]
    if track.p_off_25mm is not None:
        parts += [
            "<h2>Probability that some joint's error exceeds 25 mm</h2>",
            curves(track.time_s, {"P": track.p_off_25mm}, "1"),
        ]
    spread = np.where(table.is_lost[:, None], np.nan, 1e3 * table.joint_std.max(axis=2))
    shown = {"median": np.median(spread, axis=1), "largest": spread.max(axis=1)}
    parts += [
        "<h2>Reported standard deviation of the joints</h2>",
        curves(track.time_s, shown, "mm"),
        "<h2>Speed of the joints</h2>",
        curves(track.time_s, {"median": _speed(table)}, "m/s"),
    ]
    for name, angles in _angle_groups(table).items():
        parts += [f"<h2>{html.escape(name)}</h2>", curves(track.time_s, angles, "°")]
    body = "\n".join(parts)
    page = (
        f'<!doctype html><html lang="en"><meta charset="utf-8"><link rel="icon" href="data:,"><title>{title} · handtrack</title>'
        f"<style>{_STYLE}</style>\n{body}\n</html>\n"
    )
    replace_text(path, page)


def _about(table: ResultsTable) -> str:
    track = table.track
    sided = track.side and track.keypoints21 is not None
    words = [f"{track.model}, {track.side}" if sided else track.model]
    words.append(f"frames {track.frame[0]} to {track.frame[-1]} at {table.fps:g} a second")
    if table.rig is not None:
        words.append(f"cameras {', '.join(table.rig.names)}")
    if track.hand_length_mm is not None:
        std = track.hand_length_std_mm
        std = "" if std is None else f" ± {max(std, 1.0):.0f}"  # as the command line rounds it
        words.append(f"hand {track.hand_length_mm:.0f} mm{std}")
    if track.refinement:
        why = json.loads(track.refinement).get("why", "")
        words.append(f"refined over the whole recording ({why})" if why else "refined")
    return f"{'; '.join(words)}. handtrack {track.version}"


def _lane(table: ResultsTable) -> str:
    """Return a strip: a colour for each stretch of frames of one state."""
    frame, status = table.track.frame, table.track.status
    total = frame[-1] - frame[0] + 1
    rows = [
        f'<rect x="{frame[first] - frame[0]}" width="{frame[end - 1] - frame[first] + 1}" height="1" '
        f'fill="{_COLOURS[int(status[first])]}"/>'
        for first, end in sorted(
            run for state in np.unique(status) for run in runs(status == state)
        )
    ]
    return (
        f'<svg class=lane viewBox="0 0 {total} 1" preserveAspectRatio="none">{"".join(rows)}</svg>'
    )


def _counts(table: ResultsTable) -> str:
    status, rows = table.track.status, []
    for known in Status:
        count = int((status == known).sum())
        if count:
            mark = f'<i style="background:{_COLOURS[int(known)]}"></i>{known.words}'
            rows.append(f"<tr><td>{mark}<td class=n>{count}<td class=n>{count / len(status):.1%}")
    return f"<table><tr><th>status<th class=n>frames<th class=n>share{''.join(rows)}</table>"


def _intervals(table: ResultsTable) -> str:
    track = table.track
    bad = [*runs(track.status == Status.DOUBTFUL), *runs(track.status == Status.LOST)]
    if not bad:
        return "<p>None.</p>"
    bad.sort(key=lambda run: (run[0] - run[1], run[0]))
    rows = []
    for first, end in bad[:_MOST_INTERVALS]:
        state = Status(int(track.status[first])).words
        reasons = [] if track.reason is None else [str(t) for t in track.reason[first:end]]
        why = max(set(reasons), key=lambda text: (reasons.count(text), text), default="")
        rows.append(
            f"<tr><td class=n>{track.frame[first]}–{track.frame[end - 1]}<td class=n>{end - first}<td>{state}<td>{html.escape(why)}"
        )
    more = len(bad) - _MOST_INTERVALS
    rest = f"<p class=soft>{more} shorter ones are not listed.</p>" if more > 0 else ""
    return f"<table><tr><th class=n>frames<th class=n>count<th>status<th>most frequent reason{''.join(rows)}</table>{rest}"


def _speed(table: ResultsTable) -> Floats[F]:
    """Return the joints' median speed up to each frame [m/s], NaN beside lost frames."""
    track, lost = table.track, table.is_lost
    moved = np.linalg.norm(np.diff(track.joint_positions, axis=0), axis=2)
    step = np.maximum(np.diff(track.time_s), 1e-9)
    speed = np.median(moved, axis=1) / step
    speed[lost[1:] | lost[:-1]] = np.nan
    return np.concatenate([[np.nan], speed])


def _angle_groups(table: ResultsTable) -> dict[str, dict[str, Floats[F]]]:
    """Return the angles [°] by what they move: those of a name's first word together, at most five curves a picture."""
    track = table.track
    groups: dict[str, dict[str, Floats]] = {}
    for s, name in enumerate(track.parameter_names[6:], start=6):
        part = name.split("_", maxsplit=1)[0]
        own = groups.setdefault(f"Angles: {part}", {})
        own[name] = np.where(table.is_lost, np.nan, np.rad2deg(track.parameters[:, s]))
    return {
        (name if k == 0 else f"{name}, more"): dict(list(own.items())[k : k + 5])
        for name, own in groups.items()
        for k in range(0, len(own), 5)
    }


WIDTH, HEIGHT = 860, 130
_LEFT, _RIGHT, _TOP, _BOTTOM = 56, 10, 8, 20
_LINE_COLOURS = ("#2b7de0", "#e0702b", "#3fa34d", "#8a63d2", "#c2477f")
_TICKS = 4


def curves(time_s: Floats[F], values: Mapping[str, Floats[F]], unit: str) -> str:
    """Return a picture of curves by name, with their axis; gaps where a value is not finite."""
    finite = np.concatenate([column[np.isfinite(column)] for column in values.values()])
    low, high = (float(finite.min()), float(finite.max())) if len(finite) else (0.0, 1.0)
    if high - low < 1e-12:
        low, high = low - 0.5, high + 0.5
    first, last = float(time_s[0]), float(max(time_s[-1], time_s[0] + 1e-9))
    x = _LEFT + (time_s - first) / (last - first) * (WIDTH - _LEFT - _RIGHT)
    span = HEIGHT - _TOP - _BOTTOM
    parts = []
    for tick in _rounded_ticks(low, high):
        y = _TOP + (high - tick) / (high - low) * span
        parts.append(f'<path d="M{_LEFT} {y:.1f}H{WIDTH - _RIGHT}" class="grid"/>')
        parts.append(f'<text x="{_LEFT - 6}" y="{y + 4:.1f}" text-anchor="end">{tick:g}</text>')
    for tick in _rounded_ticks(first, last):
        at = _LEFT + (tick - first) / (last - first) * (WIDTH - _LEFT - _RIGHT)
        parts.append(f'<text x="{at:.1f}" y="{HEIGHT - 5}" text-anchor="middle">{tick:g} s</text>')
    for k, column in enumerate(values.values()):
        y = _TOP + (high - column) / (high - low) * span
        places = [f"{across:.1f} {down:.1f}" for across, down in zip(x, y, strict=True)]
        line = "".join(f"M{'L'.join(places[a:b])}" for a, b in runs(np.isfinite(y)))
        parts.append(f'<path d="{line}" fill="none" stroke="{_colour(k)}"/>')
    named = "".join(
        f'<span><i style="background:{_colour(k)}"></i>{html.escape(name)}</span>'
        for k, name in enumerate(values)
    )
    return (
        f'<figure><figcaption>{named}<span class="soft">[{html.escape(unit)}]</span></figcaption>'
        f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img">{"".join(parts)}</svg></figure>'
    )


def _rounded_ticks(low: float, high: float) -> list[float]:
    """Return a few round numbers within an interval."""
    step = 10.0 ** np.floor(np.log10((high - low) / _TICKS))
    step *= next(m for m in (1, 2, 5, 10) if (high - low) / (m * step) <= _TICKS)
    return [round(k * step, 10) for k in range(int(np.ceil(low / step)), int(high / step) + 1)]


def _colour(index: int) -> str:
    return _LINE_COLOURS[index % len(_LINE_COLOURS)]


# ---- MP4: the model's outline and joints drawn over every camera's images, side by side


_HEIGHT_PX = 480  # of a camera's picture: two side by side fill a usual screen
_CODEC = "vp09"  # the one that opencv-python writes and browsers play
_TINT = 0.25
_MASK = 0.4
_FAR_PX = 1e5  # OpenCV draws in whole numbers of 32 bits, less its fraction
# BGR; those of the workbench's lanes
_STATUS_BGR = {
    Status.TRACKED: (110, 200, 90),
    Status.DOUBTFUL: (40, 170, 240),
    Status.LOST: (60, 60, 230),
}
_MODEL_COLOUR = (230, 190, 120)


def write_film(path: Path, table: ResultsTable) -> None:
    """Write a film with a picture for every frame: outline and bones over the image as it was taken, the frame's number and state.

    A camera without images shows its masks, one without either is left out. Raises HandtrackError where nothing is there.
    """
    if table.session_folder is None:
        raise HandtrackError(
            f"{table.source} lies in no session, so there are no images to draw on. Name the session with --session DIR."
        )
    session, table = Session.open(table.session_folder), table.without_gaps
    track = table.track
    asked = track.frame[[0, len(track) // 2, -1]].tolist()
    cameras = [
        view.name
        for view in session.views
        if any(_image_or_mask(session, view.name, frame) is not None for frame in asked)
    ]
    if not cameras:
        raise HandtrackError(
            f"{table.session_folder}: no camera has images or masks in frames {track.frame[0]} to {track.frame[-1]}, so that there is "
            "nothing to draw on. `--to html` shows the track without images."
        )
    links, ellipsoids = joint_links(table.model), table.model.ellipsoids["fine"]
    with replacing(path) as part:
        film = None
        for row, frame in enumerate(track.frame):
            poses = track.T_world_bone[row]
            bones = BonePoses(poses[0, :3, 3], poses[:, :3, :3], poses[:, :3, 3])
            drawn = ellipsoids.posed(bones), track.joint_positions[row], links
            status = Status(int(track.status[row]))
            pictures = [
                _picture(session, name, int(frame), drawn, status, table.is_lost[row])
                for name in cameras
            ]
            picture = np.ascontiguousarray(np.concatenate(pictures, axis=1))
            if film is None:
                size = (picture.shape[1], picture.shape[0])
                code = cv2.VideoWriter.fourcc(*_CODEC)
                film = cv2.VideoWriter(str(part), code, table.fps, size)
                if not film.isOpened():
                    raise HandtrackError(
                        f"{path}: OpenCV here cannot write {_CODEC} films. If the disk is not full, install opencv-python-headless as pip has it."
                    )
            film.write(picture)
        assert film is not None, "a track has frames"
        film.release()
        check_film(part, len(track))


_Drawn = tuple[Ellipsoids, Floats[J, D3], list[tuple[int, int]]]
"""flesh, joints in the world [m] and links between them: what is drawn over an image"""


def _image_or_mask(session: Session, name: str, frame: int) -> Array | None:
    """Return an image BGR as it was taken; where there is none the mask, darker; None where there is neither."""
    image = session.image(name, frame)
    if image is None:
        mask = session.mask(name, frame)
        image = None if mask is None else (_MASK * mask).astype(np.uint8)
    return (
        cv2.cvtColor(image, cv2.COLOR_GRAY2BGR) if image is not None and image.ndim == 2 else image
    )


def _picture(
    session: Session, name: str, frame: int, drawn: _Drawn, status: Status, lost: bool
) -> Array[H, W, D3]:
    """Return an image as it was taken, made smaller, with the model over it; dark where there is none. A lost pose is not drawn."""
    image, camera = _image_or_mask(session, name, frame), session.rig[name]
    across = 2 * round(_HEIGHT_PX * camera.size[0] / camera.size[1] / 2)  # codecs want even ones
    if image is None:
        shown = np.zeros((_HEIGHT_PX, across, 3), np.uint8)
    else:
        shown = cv2.resize(image, (across, _HEIGHT_PX), interpolation=cv2.INTER_AREA)
    small = camera.scaled((across, _HEIGHT_PX))
    ink = _STATUS_BGR.get(status, _STATUS_BGR[Status.TRACKED])
    if not lost:
        ellipsoids, joints, links = drawn
        lines = outline_polygons(small.without_distortion(), ellipsoids)
        lines = [small.distort_points(line) for line in lines]
        whole = [np.rint(line).astype(np.int32) for line in lines if np.isfinite(line).all()]
        tinted = cv2.fillPoly(shown.copy(), whole, _MODEL_COLOUR)
        shown = cv2.addWeighted(tinted, _TINT, shown, 1.0 - _TINT, 0.0)
        cv2.polylines(shown, whole, True, ink, 1, cv2.LINE_AA)
        places = small.project(joints)
        places[~(np.abs(places) < _FAR_PX).all(axis=1)] = np.nan
        for a, b in links:
            if np.isfinite(places[[a, b]]).all():
                ends = np.rint(places[[a, b]]).astype(int).tolist()
                cv2.line(shown, ends[0], ends[1], (255, 255, 255), 1, cv2.LINE_AA)
    words = f"{name}  {frame}  {status.words}"
    for thickness, colour in ((3, (0, 0, 0)), (1, ink)):
        cv2.putText(
            shown, words, (10, 24), cv2.FONT_HERSHEY_SIMPLEX, 0.6, colour, thickness, cv2.LINE_AA
        )
    return shown
