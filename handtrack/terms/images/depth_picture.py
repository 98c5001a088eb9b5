"""Depth picture of a model in a camera: at every pixel the nearest face and its distance."""

from __future__ import annotations

import numpy as np

from handtrack.arrays import D2, Floats, H, Ints, N, W, array_dataclass
from handtrack.geometry.camera import Camera
from handtrack.model.kinematics import BonePoses
from handtrack.model.surfaces.part_mesh import PartMesh
from handtrack.terms.images.image_kernels import fill_triangles


@array_dataclass
class DepthPicture:
    """A window of a camera's undistorted image, around the model."""

    camera: Camera
    corner: tuple[int, int]
    """column and row of the window's first pixel in the camera's image"""
    depth: Floats[H, W]
    """z in the camera [m]; infinite where nothing of the model is"""
    face: Ints[H, W]
    """the face in front, −1 for none"""

    def at(self, pixels: Floats[N, D2]) -> tuple[Ints[N], Floats[N]]:
        """Return face and depth at the pixels nearest to image points; −1 and infinite outside."""
        at = np.rint(np.nan_to_num(pixels, nan=-1e6)).astype(np.int64) - self.corner
        height, width = self.depth.shape
        inside = (at >= 0).all(axis=1) & (at[:, 0] < width) & (at[:, 1] < height)
        face, depth = np.full(len(at), -1), np.full(len(at), np.inf)
        column, row = at[inside].T
        face[inside], depth[inside] = self.face[row, column], self.depth[row, column]
        return face, depth


def depth_picture(mesh: PartMesh, bones: BonePoses, camera: Camera) -> DepthPicture:
    """Return what `camera`, without distortion, sees of the model's parts where the bones carry them."""
    assert not camera.is_distorted, "the image is undistorted before terms see it"
    at = camera.to_camera(mesh.carried(bones)[0])
    depth = np.ascontiguousarray(at[:, 2])
    ahead = np.maximum(depth, 1e-6)[:, None]
    pixels = at[:, :2] / ahead * np.diag(camera.matrix)[:2] + camera.matrix[:2, 2]
    seen = pixels[depth > 1e-6]
    size = np.array(camera.size)
    low, high = np.zeros(2, np.int64), np.zeros(2, np.int64)
    if len(seen):
        low = np.clip(np.floor(seen.min(axis=0)), 0, size).astype(np.int64)
        high = np.clip(np.ceil(seen.max(axis=0)) + 1, low, size).astype(np.int64)
    shape = (int(high[1] - low[1]), int(high[0] - low[0]))
    nearest, front = np.full(shape, np.inf), np.full(shape, -1, np.int64)
    fill_triangles(np.ascontiguousarray(pixels - low), depth, mesh.faces, nearest, front)
    return DepthPicture(camera, (int(low[0]), int(low[1])), nearest, front)
