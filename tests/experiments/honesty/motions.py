"""Motions of a hand's angles and of its wrist: some made here, some read from others' recordings."""

from __future__ import annotations

import json
from base64 import b64decode
from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter1d

from handtrack.arrays import D3, D5, Array, F, Floats, K
from handtrack.geometry.rotation import rotation_matrix, rotation_vector
from tests.experiments.honesty.meshes import FINGERS, HINGES
from tests.experiments.mean_hand.makehuman import file_of

Angles = Floats[F, D5, K]
"""(F, 5, 4) [rad] as `HandMesh.posed` takes them"""
_OPEN = np.array([[0.1, 0.0, 0.1, 0.1], *[[0.0, 0.15, 0.2, 0.1]] * 4])
_FIST = np.array([[0.5, 0.45, 0.6, 0.6], *[[0.0, 1.35, 1.65, 1.0]] * 4])
_SPREAD = np.array([0.22, 0.02, -0.16, -0.30])
_FASTEST = np.deg2rad(8.0)
"""a joint's between two frames, as in the data's own sessions"""


def _still(rng: np.random.Generator) -> Floats:
    pose = _OPEN.copy()
    pose[1:, 1:] += rng.normal(0, 0.08, (4, 3)).clip(-0.1, 0.2)
    pose[1:, 0] = rng.uniform(0, 0.6) * _SPREAD
    return pose


def _letter(rng: np.random.Generator) -> Floats:
    """Return fingers each straight, hooked or closed, as in an alphabet of one hand."""
    pose = _still(rng)
    for f in range(1, FINGERS):
        shape = rng.choice(3, p=[0.4, 0.2, 0.4])
        bends = [_OPEN[f, 1:], np.array([0.3, 1.3, 0.8]), _FIST[f, 1:]][shape]
        pose[f, 1:] = bends + rng.normal(0, 0.08, 3)
    pose[0] = rng.uniform(0, 1) * (_FIST[0] - _OPEN[0]) + _OPEN[0]
    return pose


def _curl(rng: np.random.Generator) -> Floats:
    """Return a hand half closed, some fingers more."""
    share = np.clip(rng.uniform(0.2, 0.9) + rng.normal(0, 0.2, (FINGERS, 1)), 0, 1)
    pose = _OPEN + share * (_FIST - _OPEN)
    pose[1:, 0] = rng.uniform(0, 0.8) * _SPREAD
    return pose


def _fist(rng: np.random.Generator) -> Floats:
    pose = _FIST + rng.normal(0, 0.04, (FINGERS, HINGES))
    pose[0, 1] = rng.uniform(0.2, 0.7)
    return pose


def _count(rng: np.random.Generator) -> Floats[D5, K]:
    """Return a fist with some fingers out, the index first."""
    pose = _fist(rng)
    out = slice(1, int(rng.integers(1, FINGERS + 1)))
    pose[out] = _still(rng)[out]
    return pose


def _pinch(rng: np.random.Generator) -> Floats:
    """Return thumb and one or two fingers bent towards each other."""
    pose = _still(rng)
    pose[0] = [0.75, 0.25, 0.35, 0.4]
    for f in rng.choice([1, 2, 3], size=rng.integers(1, 3), replace=False):
        pose[f, 1:] = [0.75, 0.85, 0.45]
    return pose


def _spread(rng: np.random.Generator) -> Floats:
    pose = _still(rng)
    pose[1:, 0] = rng.uniform(0.6, 1.0) * _SPREAD
    pose[0] = [0.1, -0.25, 0.0, 0.0]
    return pose


SHAPES: dict[str, list[Callable[[np.random.Generator], Floats[D5, K]]]] = {
    "fist": [_still, _fist],
    "curls": [_still, _curl, _curl],
    "counts": [_count],
    "pinches": [_still, _pinch],
    "spread": [_spread, _still, _curl],
    "letters": [_letter],
    "turns": [_still, _spread, _curl],
    "waves": [_still, _spread],
}
"""the poses that a motion passes through, in turns"""


def moving(kind: str, frames: int, rng: np.random.Generator) -> Angles:
    """Return angles of a motion that goes from pose to pose and rests there for a while."""
    poses, stays = [], []
    while sum(stays) < frames + 20:
        for shape in SHAPES[kind]:
            poses.append(shape(rng))
            stays.append(int(rng.integers(14, 26)))
    steps = np.repeat(np.array(poses), stays, axis=0)[: frames + 20]
    return _believable(np.asarray(gaussian_filter1d(steps, 3.0, axis=0)))[:frames]


def read(path: Path, first: int, frames: int) -> Angles:
    """Return angles of a RealSense `.pose` file (17 bones a line) from a row on; 8° a joint at most between frames."""
    rows = np.loadtxt(path)[first:].reshape(-1, 17, 7)
    x, y, z, w = np.moveaxis(rows[..., 3:], -1, 0)
    turns = np.stack(
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w),
         2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w),
         2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)], axis=-1,
    ).reshape(*x.shape, 3, 3)  # fmt: skip
    found = np.zeros((len(rows), FINGERS, HINGES))
    for f in range(FINGERS):
        before = 1
        for k in range(3):
            bone = 2 + 3 * f + k
            turn = rotation_vector(np.swapaxes(turns[:, before], 1, 2) @ turns[:, bone])
            found[:, f, k + 1] = turn[:, 0]
            if k == 0:
                found[:, f, 0] = turn[:, 1]
            before = bone
    return _of_a_hand(found, frames)


def read_leap(git: Path, name: str, first: int, frames: int) -> Angles:
    """Return angles of a right hand that Leap Motion recorded, of a git folder's `recorder/recordings`, from a row on, every fourth."""
    packed = file_of(git, f"recorder/recordings/{name}.json.lz")
    found = []
    for frame in json.loads(_unpacked(packed))["frames"][first::4]:
        hand = next(hand for hand in frame["hands"] if hand["type"] == "right")
        own = [one for one in frame["pointables"] if one["handId"] == hand["id"]]
        joints = [[one[f"{j}Position"] for j in ("mcp", "pip", "dip", "tip")] for one in sorted(own, key=lambda one: one["type"])]  # fmt: skip
        bones = np.diff(np.array(joints), axis=1)
        bones /= np.linalg.norm(bones, axis=2, keepdims=True)
        along, inwards = np.array(hand["direction"]), np.array(hand["palmNormal"])
        spread = np.arcsin(bones[:, 0] @ np.cross(along, inwards))
        bend = np.arctan2(bones[:, 0] @ inwards, bones[:, 0] @ along)
        bends = np.arccos(np.clip((bones[:, :-1] * bones[:, 1:]).sum(axis=2), -1.0, 1.0))
        found.append(np.column_stack([spread, bend, bends]))
    return _of_a_hand(np.array(found), frames)


def _unpacked(text: str) -> str:
    """Return what LZ-String packed into base64: words in as many bits as their count has, the lowest first; 0 and 1 before a new letter's bits."""
    bits = iter(np.unpackbits(np.frombuffer(b64decode(text + "=="), np.uint8)).tolist())
    word, words, found = "", [""] * 3, []

    def number(count: int) -> int:
        return sum(next(bits) << k for k in range(count))

    while (code := number(len(words).bit_length())) != 2:
        if code < 2:
            words.append(chr(number(8 << code)))
            code = len(words) - 1
        now = words[code] if code < len(words) else word + word[0]
        if word:
            words.append(word + now[0])
        word = now
        found.append(word)
    return "".join(found)


def _of_a_hand(found: Floats[F, D5, K], frames: int) -> Angles:
    """Return measured angles about those of a hand at rest, within its limits, at a pace of a hand."""
    middle = np.median(found, axis=0)
    found[:, 1:, 0] = 0.5 * (found[:, 1:, 0] - middle[1:, 0])
    found[:, 0, :2] = np.array([0.3, 0.15]) + 0.5 * (found[:, 0, :2] - middle[0, :2])
    found[:, 0, 2:] = np.abs(found[:, 0, 2:])
    low, high = np.array([-0.3, -0.2, 0.0, 0.0]), np.array([0.3, 1.5, 1.75, 1.2])
    found[:, 1:] = np.clip(found[:, 1:], low, high)
    found[:, 0] = np.clip(found[:, 0], [-0.1, -0.3, 0.0, 0.0], [0.8, 0.7, 0.8, 0.9])
    slow = _believable(np.asarray(gaussian_filter1d(found[: 3 * frames], 1.5, axis=0)))
    return slow[:frames] if len(slow) >= frames else np.resize(slow, (frames, FINGERS, HINGES))


def _believable(angles: Floats) -> Angles:
    """Return the motion at a pace at which no joint turns faster than it may: time is stretched where it would."""
    steps = np.abs(np.diff(angles, axis=0)).max(axis=(1, 2))
    time = np.concatenate([[0.0], np.cumsum(np.maximum(1.0, steps / _FASTEST))])
    at = np.arange(int(time[-1]) + 1)
    flat = angles.reshape(len(angles), -1)
    return np.stack([np.interp(at, time, c) for c in flat.T], axis=1).reshape(-1, FINGERS, HINGES)


def wrist(
    kind: str, frames: int, rng: np.random.Generator
) -> tuple[Floats[F, D3, D3], Floats[F, D3]]:
    """Return the hand's rotation and its middle's place [m] in the world, frame by frame.

    A hand at rest has its fingers up and its back to the first cameras; it sways, turns with `turns`, is fast with `waves`.
    """
    time = np.arange(frames) / 25.0
    turn_deg = {"turns": 45.0, "waves": 30.0}.get(kind, 14.0)
    place_mm = {"waves": 45.0}.get(kind, 18.0)
    rate = {"turns": 0.55, "waves": 0.8}.get(kind, 0.4)

    def sway(size: float) -> Array:
        phase, pace = rng.uniform(0, 2 * np.pi, 3), rate * rng.uniform(0.7, 1.3, 3)
        weight = rng.uniform(0.4, 1.0, 3)
        return size * weight * np.sin(2 * np.pi * pace * time[:, None] + phase)

    turns = rotation_matrix(np.deg2rad(sway(turn_deg)))
    first = rotation_matrix(np.deg2rad(rng.normal(0, 15.0, 3)))
    return turns @ first, sway(1e-3 * place_mm)
