"""Light on the hand, and a faint ground below it."""

from __future__ import annotations

import numpy as np
import viser
import viser.transforms as vtf

from handtrack.arrays import D3, Floats
from handtrack_app.protocol.snapshots import HAND_REACH_M

_BELOW = 0.16  # [m] the ground lies this far below the hand's middle
_LINE, _SECTION = (44, 48, 54), (62, 68, 76)


def add_surroundings(
    server: viser.ViserServer, hand: Floats[D3], up: Floats[D3], reach_m: float = HAND_REACH_M
) -> None:
    """Add lights and the ground for a hand [m] in a world whose upward axis is `up`.

    reach_m: how far it extends around its middle; a body stands on the ground.
    """
    larger = reach_m / HAND_REACH_M
    scene = server.scene
    side = np.cross(up, (1.0, 0.0, 0.0) if abs(up[0]) < 0.8 else (0.0, 1.0, 0.0))
    side /= np.linalg.norm(side)
    frame = np.stack([side, np.cross(up, side), up], axis=1)
    wxyz = vtf.SO3.from_matrix(frame).wxyz
    scene.add_light_hemisphere(
        "/light/sky", sky_color=(255, 255, 255), ground_color=(120, 120, 130), intensity=0.6
    )
    for name, way, strength in (("key", (0.4, -0.5, 1.0), 1.4), ("fill", (-0.8, 0.6, 0.3), 0.5)):
        scene.add_light_directional(
            f"/light/{name}", intensity=strength, position=tuple(frame @ np.array(way))
        )
    scene.add_grid(
        "/ground", 3.0 * larger, 3.0 * larger, plane="xy", cell_size=0.05 * larger, section_size=0.25 * larger, cell_color=_LINE,
        section_color=_SECTION, cell_thickness=0.6, section_thickness=0.8, fade_distance=2.5 * larger,
        fade_strength=1.5, shadow_opacity=0.0, wxyz=wxyz, position=hand - larger * _BELOW * up,
    )  # fmt: skip


def light(server: viser.ViserServer) -> None:
    """Let nothing but the surroundings' own lights shine."""
    server.scene.world_axes.visible = False
    server.scene.configure_default_lights(enabled=False)
    server.scene.configure_environment_map("studio", environment_intensity=0.15)
