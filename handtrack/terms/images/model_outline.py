"""The model's predicted outline in a camera: visible points of the occluding contours, fixed to their bones."""

from __future__ import annotations

import numpy as np

from handtrack.arrays import D2, D3, Array, Floats, Ints, N, array_dataclass
from handtrack.geometry.camera import Camera
from handtrack.model.kinematics import BonePoses
from handtrack.model.surfaces.part_mesh import PartMesh
from handtrack.terms.images.depth_picture import DepthPicture

_BESIDE_PX = 1.5  # that far to either side of the contour the picture shows who hides whom


@array_dataclass
class OutlinePoints:
    """Short pieces of outline, each by its middle."""

    camera: Camera
    bone: Ints[N]
    local: Floats[N, D3]
    """in the bone's frame [m]"""
    pixel: Floats[N, D2]
    """where the point is seen at the pose the outline was made for [px]"""
    normal: Floats[N, D2]
    """unit, out of the model, in the image"""
    length_px: Floats[N]
    """of each piece"""

    def subset(self, keep: Array[N]) -> OutlinePoints:
        """Return the pieces for which `keep` is True."""
        return OutlinePoints(
            self.camera,
            self.bone[keep],
            self.local[keep],
            self.pixel[keep],
            self.normal[keep],
            self.length_px[keep],
        )


def outline_points(
    mesh: PartMesh, bones: BonePoses, picture: DepthPicture, step_m: float
) -> OutlinePoints:
    """Return the pieces of contour that can be seen as an edge in the camera of `picture`, made at the same pose.

    A piece is seen where the part is in front, and what shows beside it is further away by `step_m` at least: where
    parts of one limb meet, nothing is to be seen. On a face whose corners look partly to the camera and partly away
    the contour runs between the points of its edges where the normal is across the viewing ray.
    """
    camera = picture.camera
    points, normals = mesh.carried(bones)
    towards = ((camera.centre - points) * normals).sum(axis=1)
    faces = mesh.faces
    crossed = _crossed(towards, faces)
    start, end = (_between(points, towards, pair) for pair in crossed)
    first, last = (_between(normals, towards, pair) for pair in crossed)
    middle = 0.5 * (start + end)
    depth = camera.to_camera(middle)[:, 2]
    pixel, side = camera.project(middle), _image_normals(camera, middle, first + last)
    length = np.linalg.norm(camera.project(end) - camera.project(start), axis=1)
    bone = mesh.bone[crossed[0][0]]
    inner_face, inner = picture.at(pixel - _BESIDE_PX * side)
    outer = picture.at(pixel + _BESIDE_PX * side)[1]
    own = mesh.bone[faces[inner_face, 0]] == bone  # a round part bulges towards the camera at once
    seen = (inner_face >= 0) & (own | (inner > depth - step_m)) & (outer > depth + step_m)
    seen &= np.isfinite(pixel).all(axis=1) & _inside(pixel, camera) & (length > 0)
    local = np.einsum("nji,nj->ni", bones.rotation[bone], middle - bones.position[bone])
    return OutlinePoints(camera, bone, local, pixel, side, length).subset(seen)


Pair = tuple[Ints[N], Ints[N]]


def _crossed(towards: Floats, faces: Ints) -> tuple[Pair, Pair]:
    """Return, for each face with corners on both sides, the two edges that the contour crosses: from the corner that
    is alone on its side to the two others."""
    ahead = towards[faces] > 0
    count = ahead.sum(axis=1)
    mixed = (count == 1) | (count == 2)
    faces, ahead, count = faces[mixed], ahead[mixed], count[mixed]
    alone = np.argmax(ahead == (count == 1)[:, None], axis=1)
    rows = np.arange(len(faces))
    a, b, c = (faces[rows, (alone + i) % 3] for i in range(3))
    return (a, b), (a, c)


def _between(values: Floats, towards: Floats, pair: Pair) -> Floats:
    """Return values (N, 3) where `towards` is 0 on the edges."""
    a, b = pair
    share = (towards[a] / (towards[a] - towards[b]))[:, None]
    return (1.0 - share) * values[a] + share * values[b]


def _image_normals(camera: Camera, points: Floats, normals: Floats) -> Floats:
    """Return unit (N, 2) the directions in the image in which the surface ends.

    On the contour the normal is across the viewing ray; moving along it moves the point across the contour.
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        moved = np.einsum("nij,nj->ni", camera.project_jacobian(points), normals)
        return moved / np.linalg.norm(moved, axis=1, keepdims=True)


def _inside(pixel: Floats, camera: Camera) -> Array:
    width, height = camera.size
    u, v = pixel.T
    return (u >= 0) & (v >= 0) & (u <= width - 1) & (v <= height - 1)
