"""Intensity term: the surface's texture of an earlier frame looked for in this frame's image. 2003 paper, section 2."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from handtrack.arrays import D2, D3, Array, Floats, Ints, N, array_dataclass
from handtrack.errors import HandtrackError
from handtrack.geometry.camera import Camera
from handtrack.model.kinematics import BonePoses
from handtrack.model.surfaces.part_mesh import PartMesh
from handtrack.terms.bone_system import Sums
from handtrack.terms.images.depth_picture import DepthPicture
from handtrack.terms.images.image_kernels import texture_sums
from handtrack.terms.images.smooth_image import SmoothImage
from handtrack.terms.loss import Loss, geman_mcclure
from handtrack.terms.term import SurfaceTerm

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
    now = image.look_up(texture.camera.project(bones.to_world(texture.bone, texture.local)))[0]
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
