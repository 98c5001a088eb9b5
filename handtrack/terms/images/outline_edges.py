"""The model's predicted outline, edges along its normals, and their term: image edges lie on the outline; robust, normalised, without masks. 2003 paper, section 2."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from handtrack.arrays import D2, D3, Array, Floats, Ints, K, N, array_dataclass
from handtrack.errors import HandtrackError
from handtrack.geometry.camera import Camera
from handtrack.model.kinematics import BonePoses
from handtrack.model.surfaces.part_mesh import PartMesh
from handtrack.terms.bone_system import Sums
from handtrack.terms.images.depth_picture import DepthPicture
from handtrack.terms.images.image_kernels import edges_sums, search_along
from handtrack.terms.images.smooth_image import SmoothImage
from handtrack.terms.term import SurfaceTerm

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


STEP_PX = 0.5  # between samples along a normal
MOST = 4  # edges kept of a normal; more are clutter
CORRELATION_PX = 10.0
"""along how much of an outline an edge's error stays the same: what outlines have in mm, in an image a pixel of which is a millimetre
of the hand"""
CLUTTER = 0.1  # strength that an outline without any edge has
FAINT = 2.0  # [grey levels / px] an edge this weak is noise


ObservedEdges = tuple[OutlinePoints, Floats[N, K], Floats[N, K]]
"""pieces of outline; up to MOST edges on the normal of each: signed distance along it from the piece's own pixel [px], and strength 0 … 1,
0 where there is no edge (N, MOST)"""


def edges_near(outline: OutlinePoints, image: SmoothImage, search_px: float) -> ObservedEdges:
    """Return an outline with the edges within ± search_px of it.

    An edge is a peak of the slope g of brightness along the normal, over all channels together. Its strength
    g²/(g² + mean g² + FAINT²), the mean along the same normal, does not depend on how bright or contrasted that
    part of the image is: a faint edge counts where all is faint.
    """
    count = len(outline.bone)
    place, strength = np.zeros((count, MOST)), np.zeros((count, MOST))
    start = np.ascontiguousarray(outline.pixel - np.array(image.corner, dtype=float))
    half = max(round(search_px / STEP_PX), 1)
    search_along(image.values, start, outline.normal, half, STEP_PX, FAINT, place, strength)
    return outline, place, strength


@array_dataclass
class OutlineEdgesTerm(SurfaceTerm):
    """−weight Σ (ℓ/stretch) log p(x): each piece of outline, ℓ long, explains one of the edges on its normal, or none.

    x is how far the piece has moved along the normal of its start, x_k where the edges are, a_k their strengths:
    p(x) = (clutter + Σ a_k exp(−(x − x_k)²/2σ²)) / (clutter + Σ a_k). Pieces and edges are those of the stage's
    start (`edges_near`), so that cost and gradient agree; a wide σ joins the edges, a narrow one chooses among them.
    The Hessian leaves out what would make it negative: weights of the edges over σ².
    """

    observed: Sequence[ObservedEdges]
    """of each camera"""
    sigma_px: float
    weight: float = 1.0
    from_unexplained: bool = False
    """count from what a piece without an edge costs, so that a pose that shows less outline does not seem better"""
    name = "edges"

    def __post_init__(self) -> None:
        if not self.sigma_px > 0:
            raise HandtrackError(
                f"{self.name}: sigma {self.sigma_px:g} px; expected a positive number."
            )

    def add_to(self, bones: BonePoses, sums: Sums) -> float:
        cost, spread = 0.0, (self.sigma_px, CLUTTER, self.from_unexplained)
        for outline, *edges in self.observed:
            camera = outline.camera
            weight = self.weight * outline.length_px / CORRELATION_PX
            local = bones.rescaled_surface(outline.bone, outline.local)
            pieces = outline.bone, local, outline.pixel, outline.normal, weight
            pinhole = camera.matrix, camera.rotation, camera.translation
            cost += edges_sums(bones.frames, pinhole, pieces, tuple(edges), spread, sums)
        return cost
