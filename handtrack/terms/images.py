"""Terms of what images show: brightness carried on the surface, and edges where the model's outline should be."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np

from handtrack.arrays import D2, D3, Array, Floats, H, Ints, K, N, W, array_dataclass
from handtrack.errors import HandtrackError
from handtrack.geometry.camera import Camera
from handtrack.model.kinematics import BonePoses
from handtrack.model.part_mesh import PartMesh
from handtrack.terms.image_kernels import (
    edges_sums,
    fill_triangles,
    look_up_all,
    search_along,
    texture_sums,
)
from handtrack.terms.loss import Loss, geman_mcclure
from handtrack.terms.term import Sums, SurfaceTerm

_REACH = 3.0  # sigmas that a pixel spreads


@array_dataclass
class SmoothImage:
    """Part of an undistorted image after a Gaussian. Beyond the image the border's value goes on."""

    corner: tuple[int, int]
    """column and row of the window's first pixel in the image"""
    values: Array[H, W, D3]
    """float32, 0 … 255"""

    def look_up(self, pixels: Floats[N, D2]) -> Floats[N, D3]:
        """Return values at image points, bilinear."""
        values = np.empty((len(pixels), self.values.shape[2]))
        at = np.ascontiguousarray(pixels - np.array(self.corner, dtype=float))
        look_up_all(self.values, at, values)
        return values


def smooth_image(
    pixels: Array[H, W, D3], sigma_px: float, around: Floats[N, D2], margin_px: float = 0.0
) -> SmoothImage:
    """Return the smoothed part of an image uint8 that holds the points `around`, with a margin."""
    height, width = pixels.shape[:2]
    size = np.array([width, height])
    seen = around[np.isfinite(around).all(axis=1)]
    low, high = np.zeros(2), np.array([2.0, 2.0])
    if len(seen):
        low, high = seen.min(axis=0) - margin_px, seen.max(axis=0) + margin_px
    first = np.clip(np.floor(low), 0, size - 2).astype(np.int64)
    last = np.clip(np.ceil(high) + 1, first + 2, size).astype(np.int64)
    spread = int(np.ceil(_REACH * sigma_px)) + 1
    from_, to = np.maximum(first - spread, 0), np.minimum(last + spread, size)
    part = np.ascontiguousarray(pixels[from_[1] : to[1], from_[0] : to[0]], dtype=np.float32)
    if sigma_px > 0:
        part = cv2.GaussianBlur(part, (0, 0), sigma_px, borderType=cv2.BORDER_REPLICATE)
    x, y = first - from_
    w, h = last - first
    values = np.ascontiguousarray(part[y : y + h, x : x + w])
    return SmoothImage((int(first[0]), int(first[1])), values)


# ---- Depth picture of a model in a camera: at every pixel the nearest face and its distance


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


# ---- Intensity term: the surface's texture of an earlier frame looked for in this frame's image. 2003 paper, section 2


_UNSURE = 4.0  # [grey levels] contrast below which nothing is said about a change of exposure
_MOST_GAIN = 2.0


@array_dataclass
class Texture:
    """Colours of points of the model's surface, as one camera saw them."""

    camera: Camera
    bone: Ints[N]
    local: Floats[N, D3]
    """in the bone's frame [m]"""
    color: Floats[N, D3]
    """0 … 255"""

    def subset(self, keep: Array[N]) -> Texture:
        """Return only the points for which `keep` is True."""
        return replace(self, bone=self.bone[keep], local=self.local[keep], color=self.color[keep])


def texture_points(
    mesh: PartMesh, bones: BonePoses, picture: DepthPicture, spacing_px: int
) -> tuple[Ints[N], Floats[N, D3], Floats[N, D2]]:
    """Return bone, place in its frame and pixel of visible surface points, evenly in the image.

    Parameters
    ----------
    picture
        Of the same mesh at the same pose.
    """
    camera = picture.camera
    half = spacing_px // 2
    row, column = np.nonzero(picture.face[half::spacing_px, half::spacing_px] >= 0)
    row, column = row * spacing_px + half, column * spacing_px + half
    pixel: Floats = np.stack([column, row], axis=1).astype(float) + picture.corner
    flat = (pixel - camera.matrix[:2, 2]) / np.diag(camera.matrix)[:2]
    depth = picture.depth[row, column, None]
    seen = np.concatenate([flat * depth, depth], axis=1)
    world = (seen - camera.translation) @ camera.rotation
    bone = mesh.bone[mesh.faces[picture.face[row, column], 0]]
    local = np.einsum("nji,nj->ni", bones.rotation[bone], world - bones.position[bone])
    return bone, local, pixel


def still_visible(
    texture: Texture, bones: BonePoses, picture: DepthPicture, tolerance_m: float
) -> Texture:
    """Return the points that can be seen at another pose too. picture: at that pose, of any camera's image."""
    points = bones.to_world(texture.bone, texture.local)
    _, front = picture.at(picture.camera.project(points))
    depth = picture.camera.to_camera(points)[:, 2]
    return texture.subset(np.isfinite(front) & (depth < front + tolerance_m))


def exposed_as(texture: Texture, bones: BonePoses, image: SmoothImage) -> Texture:
    """Return the texture with the gain and offsets that make it as bright and contrasted as the image around `bones`.

    From medians and median deviations, not by matching point to point: a pose that is still off would call it grey.
    """
    if not len(texture.bone):
        return texture
    now = image.look_up(texture.camera.project(bones.to_world(texture.bone, texture.local)))
    middle, middle_now = np.median(texture.color, axis=0), np.median(now, axis=0)
    spread = np.median(np.abs(texture.color - middle)) + _UNSURE
    spread_now = np.median(np.abs(now - middle_now)) + _UNSURE
    gain = np.clip(spread_now / spread, 1.0 / _MOST_GAIN, _MOST_GAIN)
    return replace(texture, color=middle_now + gain * (texture.color - middle))


@array_dataclass
class CarriedTextureTerm(SurfaceTerm):
    """½ weight Σ ρ(|I(π(X)) − T(X)|²/σ²) over surface points X fixed to their bones, all channels of a point together.

    Which points are seen, and the exposure, are those of the stage's start, so that cost and gradient agree.
    """

    observed: Sequence[tuple[Texture, SmoothImage]]
    """of each camera"""
    sigma: float
    """[grey levels] how far a surface point's colour is from what it was"""
    loss: Loss = geman_mcclure(3.0)
    weight: float = 1.0
    from_unexplained: bool = False
    """count from the most that a point costs, so that a pose that shows less of the surface does not seem better"""
    name = "intensity"

    def __post_init__(self) -> None:
        if not self.sigma > 0:
            raise HandtrackError(
                f"{self.name}: sigma {self.sigma:g} grey levels; expected a positive number."
            )
        if self.from_unexplained and not self.loss.has_bound:
            raise HandtrackError(
                f"{self.name}: the loss has no bound to count from; expected geman_mcclure."
            )

    def add_to(self, bones: BonePoses, sums: Sums) -> float:
        worst = self.loss.scale**2 if self.from_unexplained else 0.0
        noise, cost = (self.sigma, self.loss, worst, self.weight), 0.0
        for texture, image in self.observed:
            camera, local = texture.camera, bones.rescaled_surface(texture.bone, texture.local)
            matrix = camera.matrix.copy()
            matrix[:2, 2] -= image.corner
            pinhole = matrix, camera.rotation, camera.translation
            points = texture.bone, local, texture.color
            cost += texture_sums(bones.frames, pinhole, image.values, points, noise, sums)
        return cost


_APART_M = 1e3  # between bones, so that a neighbour is always of the same one


def contradicts(texture: Texture, known: Texture, reach_m: float, tolerance: float) -> Array[N]:
    """Return True where the nearest known point of the same bone, within reach_m, has another
    colour.

    Where nothing is known nothing is contradicted.

    Parameters
    ----------
    tolerance
        [grey levels] between two colours, as a distance over all channels.
    """
    if not len(texture.bone) or not len(known.bone):
        return np.zeros(len(texture.bone), bool)
    from scipy.spatial import KDTree

    tree = KDTree(_with_bone(known))
    found = tree.query(_with_bone(texture), distance_upper_bound=reach_m)
    distance, nearest = np.asarray(found[0]), np.asarray(found[1])
    near = np.isfinite(distance)
    off = np.zeros(len(texture.bone))
    off[near] = np.linalg.norm(texture.color[near] - known.color[nearest[near]], axis=1)
    return off > tolerance


def _with_bone(texture: Texture) -> Array:
    return np.column_stack([texture.local, _APART_M * texture.bone])


# ---- Edge term: image edges lie on the model's predicted outline; robust, normalised, without masks. 2003 paper, section 2


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
