"""Where a free view stands: close to the hand, or so that hand and cameras just fill the page."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
import viser

from handtrack.arrays import D3, D5, Floats
from handtrack.geometry.camera import Camera
from handtrack_app import viser_internals as internals
from handtrack_app.protocol.snapshots import SessionSnapshot

_LEAST = 0.35  # share of the picture's height that a hand reaches over at least if cameras are shown with it at first: bent, it fills two thirds of that
_FOV = 0.65  # of a free view, from top to bottom [rad]
_WIDE, _ABOVE, _BELOW = 0.9, 0.94, 0.94  # free part of the picture, in half heights


@dataclass(frozen=True)
class Viewpoint:
    """Where a free view stands."""

    position: Floats[D3]
    look_at: Floats[D3]
    up: Floats[D3]
    fov: float = _FOV


_RAISES, _TURNS = (0.35, 0.2, 0.6, 0.9, 1.3), range(-75, 76, 15)
"""views that are tried: raised by a share of the way to the cameras, and turned about what is upright [°]"""


def first_view(session: SessionSnapshot, hand: Floats[D3]) -> Viewpoint:
    """Return the view to begin with: with the cameras, unless they stand so far off that the hand would be small."""
    wide = hand_view(session, hand, everything=True)
    return wide if _size(wide, hand, session.reach_m) >= _LEAST else hand_view(session, hand)


def hand_view(session: SessionSnapshot, hand: Floats[D3], everything: bool = False) -> Viewpoint:
    """Return the view that shows the hand, and everything else where that is asked for, as large as can be, with no camera before it.

    From the cameras' side and above, so that their pictures are seen upright, not from their backs. hand: its middle [m].
    """
    frusta = [frustum_corners(card, hand) for card in session.cameras]
    images = [corners[1:] for corners in frusta] if everything else []
    around = session.reach_m * np.array(list(product((-1.0, 1.0), repeat=3)))
    points = np.concatenate([hand + around, *images])
    up = upward(session)
    tried = list[tuple[float, Viewpoint]]()
    for raised, turn in product(_RAISES, np.deg2rad([*_TURNS])):
        axes = _axes(session, hand, up, raised, turn)
        view = _fitted(points, axes, up)
        score = _size(view, hand, session.reach_m) - 0.04 * (abs(turn) + abs(raised - _RAISES[0]))
        for card, corners in zip(session.cameras, frusta, strict=True):
            score -= 0.5 * _hides(view, axes, corners, hand, session.reach_m)
            score += 0.15 * min(float(-axes[2] @ card.rotation[2]), 0.6) / len(frusta)
        tried.append((score, view))
    return max(tried, key=lambda one: one[0])[1]


def _size(view: Viewpoint, hand: Floats, reach_m: float) -> float:
    """Return the share of the picture's height that a hand fills."""
    return float(reach_m / (np.linalg.norm(view.position - hand) * np.tan(view.fov / 2)))


def _hides(view: Viewpoint, axes: Floats, frustum: Floats, hand: Floats, reach_m: float) -> bool:
    """Return whether a drawn camera (5, 3) comes into the round place that the hand has in the picture."""
    apex, *image = frustum
    middle = np.mean(image, axis=0)
    edges = [a + s * (b - a) for a in image for b in (apex, middle) for s in np.linspace(0, 1, 7)]
    observed = np.array([hand, *edges]) - view.position
    depth = -observed @ axes[2]
    flat = observed @ axes[:2].T / np.maximum(depth, 1e-6)[:, None]
    near = np.linalg.norm(flat[1:] - flat[0], axis=1) < 0.9 * reach_m / depth[0]
    return bool(near.any())


def upward(session: SessionSnapshot) -> Floats[D3]:
    """Return the mean of the cameras' upward axes: worlds differ."""
    up = -np.mean([card.rotation[1] for card in session.cameras], axis=0)
    if np.linalg.norm(up) < 0.2:
        up = -session.cameras[0].rotation[1]
    return up / np.linalg.norm(up)


def frustum_depth(card: Camera, hand: Floats[D3]) -> float:
    """Return how deep a camera's frustum is drawn [m]: large enough to see its image, clear of the hand."""
    return float(np.clip(0.28 * np.linalg.norm(card.centre - hand), 0.05, 0.25))


def frustum_corners(card: Camera, hand: Floats[D3]) -> Floats[D5, D3]:
    """Return the apex and the image's corners of a camera as it is drawn, world [m]."""
    (width, height), matrix = card.size, card.matrix
    deep = frustum_depth(card, hand)
    across, down = 0.5 * width / matrix[0, 0], 0.5 * height / matrix[1, 1]
    corners = [(0.0, 0.0, 0.0)] + [(x * across, y * down, 1.0) for x in (-1, 1) for y in (-1, 1)]
    return card.centre + deep * np.array(corners) @ card.rotation


def _axes(
    session: SessionSnapshot, hand: Floats, up: Floats, raised: float, turn: float
) -> Floats[D3, D3]:
    """Return the axes of a view from where the cameras are, raised by a share of the way, turned about `up` [rad]: unit vectors to
    the right, upward in the picture, and towards the viewer.
    """
    ways = [card.centre - hand for card in session.cameras]
    back = np.mean([way / max(np.linalg.norm(way), 1e-9) for way in ways], axis=0)
    if np.linalg.norm(back) < 0.4:  # they stand all around
        back = ways[0]
    level = back - (back @ up) * up
    if np.linalg.norm(level) < 0.05:  # they look straight down, or up
        above = session.cameras[0].rotation[1]
        level = (above @ up) * up - above
    level = level / max(float(np.linalg.norm(level)), 1e-9)
    away = np.cos(turn) * level + np.sin(turn) * np.cross(up, level) + raised * up
    away /= np.linalg.norm(away)
    right = np.cross(up, away)
    right /= max(float(np.linalg.norm(right)), 1e-9)
    return np.stack([right, np.cross(away, right), away])


def _fitted(points: Floats, axes: Floats[D3, D3], up: Floats) -> Viewpoint:
    """Return the nearest view along given axes that has all points (N, 3) in the free part of the picture.

    A point is in it when |x − a| ≤ w (d − z) and y between −l (d − z) and h (d − z) of b, where the view stands
    at (a, b, d): bounds linear in a, b and d, so the least d follows from the extremes.
    """
    t = np.tan(_FOV / 2)
    wide, above, below = _WIDE * t, _ABOVE * t, _BELOW * t
    x, y, z = axes @ points.T
    right, left = np.max(x + wide * z), np.min(x - wide * z)
    top, bottom = np.max(y + above * z), np.min(y - below * z)
    d = max((right - left) / (2 * wide), (top - bottom) / (above + below))
    a = 0.5 * (right + left)
    slack = d * (above + below) - (top - bottom)
    b = top - above * d + 0.5 * slack
    position = axes.T @ (a, b, d)
    middle = float(points.mean(axis=0) @ axes[2])
    return Viewpoint(position, position - (d - middle) * axes[2], up)


def look_from(
    client: viser.ClientHandle, view: Viewpoint, near: tuple[float, float] | None = None
) -> None:
    """Move a client's view to a viewpoint. The handle's own setters leave out what they believe is there already, or take for too small a
    step. near: how near and far the point looked at may be from now on [m]; None: as it was.
    """
    up, position, target = (
        (float(x), float(y), float(z)) for x, y, z in (view.up, view.position, view.look_at)
    )
    messages: list[internals.Message] = [
        internals.messages.SetCameraUpDirectionMessage(up),
        internals.messages.SetCameraPositionMessage(position),
        internals.messages.SetCameraLookAtMessage(target),
        internals.messages.SetCameraFovMessage(view.fov),  # a page answers to this one: last
    ]
    if near is not None:
        messages.insert(0, internals.messages.SetCameraMinOrbitDistanceMessage(near[0]))
        messages.insert(-1, internals.messages.SetCameraMaxOrbitDistanceMessage(near[1]))
    with client.atomic():
        for message in messages:
            internals.send(client, message)


def begin_at(server: viser.ViserServer, view: Viewpoint) -> None:
    """Let all pages, and those to come, look from a view."""
    server.scene.set_up_direction(view.up)
    start = server.initial_camera
    start.up, start.position, start.look_at = view.up, view.position, view.look_at
    start.fov, start.near, start.far = view.fov, 0.005, 50.0
    for client in server.get_clients().values():
        look_from(client, view)
