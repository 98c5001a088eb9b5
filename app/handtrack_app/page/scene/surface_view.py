"""The surface that the solver sees, as one mesh."""

from __future__ import annotations

import numpy as np
import viser

from handtrack_app.protocol.messages import SurfaceSnapshot
from handtrack_app.protocol.palette import SURFACE


def add_surface(server: viser.ViserServer, name: str) -> viser.MeshHandle:
    """Add the mesh, hidden until the first one comes."""
    corner = np.zeros((3, 3), np.float32)
    return server.scene.add_mesh_simple(
        name, corner, np.array([[0, 1, 2]], np.uint32), color=SURFACE,
        visible=False,
    )  # fmt: skip


def update_surface(mesh: viser.MeshHandle, surface: SurfaceSnapshot) -> None:
    """Take the surface of another pose."""
    mesh.vertices = surface.vertices
    mesh.faces = surface.faces.astype(np.uint32)
