"""What a search lays everywhere before it lets fingers move, and how well it fits: rigid hands in some postures; a frame's cloud and its
silhouettes, each with where a palm may be, how well a shape laid there fits, and what pulls it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property, lru_cache

import numpy as np

from handtrack.arrays import (
    D3,
    D4,
    Array,
    Floats,
    Ints,
    K,
    M,
    N,
    P,
    R,
    S,
    V,
    X,
    Y,
    Z,
    array_dataclass,
    contiguous,
)
from handtrack.capture.clouds.cloud_filters import thinned
from handtrack.geometry.camera import Camera
from handtrack.geometry.rotation import rotation_vector
from handtrack.geometry.triangulation import triangulated
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.metaballs import MetaballSurface, surface_mesh
from handtrack.model.part_mesh import PartMesh
from handtrack.model.pose_library import named_pose
from handtrack.observation.observation import UNKNOWN, CloudView, Silhouette, view_centres
from handtrack.sampling.suppression import apart
from handtrack.terms.clouds import (
    CloudDistanceTerm,
    CloudEmptinessTerm,
    DistanceMap,
    distance_map,
    prepare_cloud,
    visible_from,
)
from handtrack.terms.loss import geman_mcclure
from handtrack.terms.silhouettes import CoverageTerm, prepare
from handtrack.terms.term import ObservationTerm
from handtrack.tracking.search.score_kernels import cloud_scores, silhouette_scores

_POSTURES = ("open", "curl", "fist", "point")
_WRIST_BENDS_DEG = (0.0, -40.0, 40.0)  # of a forearm in view
_MIDDLE = 0.6  # of the way from the wrist to the middle knuckle: the palm's middle
REACH_M = 0.14
"""Around the palm's middle of a mean hand lies the whole hand, its fingers stretched, and some of the forearm."""
PALM_DEEP_M = 0.014
"""from the palm's skin to its middle"""
PIECE_M = 0.03
"""length of a phalanx, along which a model that is not this person's hand errs alike; it is half as broad"""
_NODE_M = 0.006
_POINT_M = 0.012
_LEAST_BALL_M, _BALLS_COVER = 0.003, 1.5  # radii: a ball stands for those with their middle so near


@array_dataclass
class HandShape:
    """A hand in one posture, in its own frame: the root at the origin, not turned."""

    model: ArticulatedModel
    posture: str
    params: Floats[P]
    """solver parameters"""
    reach: float
    """[m] around the palm's middle: points further away say nothing about this hand"""

    @property
    def is_typical(self) -> bool:
        """Whether this is one of the few shapes that tell where a hand may be at all."""
        model = self.model
        joint = dict(zip(model.parameter_names, model.joint_params(self.params), strict=True))
        return self.posture in ("open", "curl") and not joint.get("wrist_flex")

    @cached_property
    def middle(self) -> Floats[D3]:
        """The palm's middle [m]."""
        return palm_middle(self.model, self.params)

    @cached_property
    def mesh(self) -> PartMesh:
        """The surface, each point on its bone."""
        bones = self.model.bones(self.params)
        return surface_mesh(MetaballSurface.of(self.model), bones, _POINT_M)

    @cached_property
    def samples(self) -> tuple[Floats[V, D3], Floats[V, D3], Array[V]]:
        """Points evenly on the surface, within reach [m]; unit normals, outwards; and whether each is on the forearm, which a sleeve may hide
        anywhere.
        """
        vertices, normals = self.mesh.carried(self.model.bones(self.params))
        near = np.linalg.norm(vertices - self.middle, axis=1) < self.reach
        points, outwards = contiguous(vertices[near], normals[near])
        return points, outwards, self.model.is_forearm(self.mesh.bone[near])

    @cached_property
    def area(self) -> float:
        """Of the surface around each of its points [m²]."""
        vertices, _ = self.mesh.carried(self.model.bones(self.params))
        corners = vertices[self.mesh.faces]
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        return 0.5 * float(np.linalg.norm(across, axis=1).sum()) / len(vertices)

    @cached_property
    def field(self) -> tuple[Array[X, Y, Z], Floats[D3], float]:
        """Distance to the surface, inside and outside, float32, on a grid; its first node and spacing [m]."""
        signed, nodes = self._signed
        return np.abs(signed).astype(np.float32), nodes[0, 0, 0], _NODE_M

    @cached_property
    def spheres(self) -> Floats[K, D4]:
        """Centres and radii of balls that fill the inside [m]."""
        signed, nodes = self._signed
        return _balls(nodes.reshape(-1, 3), -signed.ravel())

    @property
    def _signed(self) -> tuple[Floats[X, Y, Z], Floats[X, Y, Z, D3]]:
        """Signed distances to the surface, and the nodes of a grid where they are."""
        points, bones = self.samples[0], self.model.bones(self.params)
        low, high = points.min(axis=0) - 0.03, points.max(axis=0) + 0.03
        axes = [np.arange(low[i], high[i], _NODE_M) for i in range(3)]
        nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        signed = MetaballSurface.of(self.model).distance(bones, nodes.reshape(-1, 3))
        return signed.reshape(*nodes.shape[:2], -1), nodes

    def params_at(self, rotation: Floats[D3, D3], place: Floats[D3]) -> Floats[P]:
        """Return solver parameters with this posture, turned by rotation, its palm's middle at place."""
        joint = self.model.joint_params(self.params)
        joint[3:6] = rotation_vector(rotation)
        joint[:3] = place - rotation @ self.middle
        return self.model.clipped(self.model.solver_params(joint))


@lru_cache(maxsize=4)
def hand_shapes(model: ArticulatedModel) -> tuple[HandShape, ...]:
    """Return a shape for each posture, and with a forearm for each of some bends of the wrist."""
    bends = _WRIST_BENDS_DEG if model.has_forearm else (0.0,)
    shapes = []
    for posture in _POSTURES:
        joint = named_pose(model, posture)
        for bend in bends:
            if model.has_forearm:
                joint[model.parameter_names.index("wrist_flex")] = np.deg2rad(bend)
            shapes.append(shape_of(model, joint, posture))
    return tuple(shapes)


def group_middles(points: Floats[N, D3], apart_m: float, most: int | None = None) -> Floats[K, D3]:
    """Return the means of groups of points that lie within `apart_m` of the group's first, the first points' groups first."""
    chosen: list[Floats] = []
    while len(points) and (most is None or len(chosen) < most):
        near = np.linalg.norm(points - points[0], axis=1) < apart_m
        chosen.append(points[near].mean(axis=0))
        points = points[~near]
    return np.array(chosen).reshape(-1, 3)


def palm_middle(model: ArticulatedModel, params: Floats[P]) -> Floats[D3]:
    """Return the palm's middle at solver parameters, world [m]."""
    places = model.joint_positions(model.bones(params))
    wrist, knuckle = (places[model.joint_names.index(n)] for n in ("wrist", "middle_mcp"))
    return wrist + _MIDDLE * (knuckle - wrist)


def shape_of(model: ArticulatedModel, joint: Floats[S], posture: str) -> HandShape:
    """Return the shape of joint parameters, whatever their root; posture: what it is called."""
    joint = joint.copy()
    joint[:6] = 0.0
    params = model.clipped(model.solver_params(joint))
    return HandShape(model, posture, params, REACH_M * model.scale.overall)


def _balls(nodes: Floats, depth: Floats) -> Floats:
    """Return (K, 4) balls that fill the inside, the largest first; nodes (N, 3) at depth (N,) below the surface [m]."""
    inside = depth > _LEAST_BALL_M
    left, room = nodes[inside], depth[inside]
    order = np.argsort(-room, kind="stable")
    left, room = left[order], room[order]
    rows = apart(
        range(len(left)),
        lambda a, rest: np.linalg.norm(left[rest] - left[a], axis=1) > _BALLS_COVER * room[a],
    )
    return np.array([[*left[n], room[n]] for n in rows])


# ---- clouds

_VOXEL_M = 0.008
_MOST = 2000  # points; voxels grow until there are no more
_CELLS_A_SIDE = 1.5  # a plane crosses about 1.5 voxels for each of its faces' area
_MAP_M = 0.005
_CLOUD_PLACE_M = 0.028  # between places where a palm may be
_MOST_CLOUD_PLACES = 60
_CLOUD_SIGMA_BANDS, _ROBUST_SIGMAS = 0.5, 5.0  # of errors, in bands; how many sigmas pull
_FEWEST = 60


@array_dataclass
class CloudScore:
    """One frame's cloud, thinned; made by `cloud_score`."""

    points: Floats[N, D3]
    """world [m]"""
    area: float
    """of the surface around each point [m²]"""
    distances: DistanceMap
    views: tuple[CloudView, ...]

    @cached_property
    def _nodes(self) -> Floats:
        return self.distances.at_nodes()

    @cached_property
    def _ways_to_eyes(self) -> tuple[Floats, Ints]:
        middle = np.median(self.points, axis=0)
        ways = [view_centres(view) - middle for view in self.views]
        start = np.cumsum([0, *map(len, ways)]).astype(np.int64)
        return np.concatenate([*ways, np.zeros((0, 3))]), start

    @cached_property
    def places(self) -> Floats[M, D3]:
        """Where a palm's middle may be, world [m]: all over the cloud, the nearest to the cameras first."""
        ways = self._ways_to_eyes[0]
        directions = ways / np.linalg.norm(ways, axis=1, keepdims=True)
        away = -directions.mean(axis=0) if len(ways) else np.zeros(3)
        near = self.points @ away
        order = np.argsort(near, kind="stable")
        chosen = group_middles(self.points[order], _CLOUD_PLACE_M, _MOST_CLOUD_PLACES)
        return chosen + PALM_DEEP_M * away

    def scores(
        self,
        shape: HandShape,
        rotations: Floats[R, D3, D3],
        places: Floats[M, D3],
        enough: float = 1.0,
    ) -> Floats[R, M]:
        """Return the share of area on which shape and cloud disagree, by rotation and place."""
        points, normals, is_arm = shape.samples
        hand = ~is_arm  # asked for nowhere; where the forearm is seen, `field` explains it
        return cloud_scores(
            (self.points, self.area),
            (self._nodes, self.distances.low, self.distances.spacing),
            self._ways_to_eyes,
            (np.ascontiguousarray(rotations), np.ascontiguousarray(places)),
            (points[hand], normals[hand], shape.area, shape.middle, shape.reach),
            shape.field,
        )

    def terms(
        self,
        shape: HandShape,
        model: ArticulatedModel,
        params: Floats[P],
        band_m: float,
        unbiased: bool,
        palms: Floats[M, D3] | None,
    ) -> list[ObservationTerm]:
        """Return E1 and E2 around a pose of the shape's model, or of that without an arm, with arms as long as band_m: coarse,
        but quick.

        Parameters
        ----------
        unbiased
            As always; distances have no outer side that reaches further than the inner.
        """
        middle = palm_middle(model, params)
        around = middle[None] if palms is None else palms
        away = np.linalg.norm(self.points[:, None] - around, axis=2).min(axis=1)
        near = away < shape.reach
        sigma = _CLOUD_SIGMA_BANDS * band_m
        terms: list[ObservationTerm] = []
        if near.sum() >= _FEWEST // 3:
            cloud = prepare_cloud(self.points[near])
            terms.append(
                CloudDistanceTerm(
                    cloud, MetaballSurface.of(model), sigma, geman_mcclure(_ROBUST_SIGMAS)
                )
            )
        vertices, normals = shape.mesh.carried(model.bones(params))
        seen = np.linalg.norm(vertices - middle, axis=1) < shape.reach
        seen &= visible_from(vertices, normals, self.views) & ~model.is_forearm(shape.mesh.bone)
        terms.append(
            CloudEmptinessTerm(
                self.distances,
                shape.mesh.bone[seen],
                np.ascontiguousarray(shape.mesh.local[seen]),
                sigma,
                slack_m=0.5 * _VOXEL_M,
                loss=geman_mcclure(_ROBUST_SIGMAS),
                weight=shape.area / self.area,
            )
        )
        return terms

    def pieces(self, shape: HandShape, params: Floats[P]) -> float:
        """Return how many pieces of a hand are seen about a pose."""
        middle = palm_middle(shape.model, params)
        near = np.linalg.norm(self.points - middle, axis=1) < shape.reach
        return float(near.sum() * self.area / (0.5 * PIECE_M**2))


def cloud_score(
    points: Floats[N, D3], views: tuple[CloudView, ...], seed: int = 0
) -> CloudScore | None:
    """Return a cloud, world [m], made ready for the search; None where it is too small for a hand.

    Parameters
    ----------
    seed
        Decides which of a cell's points stands for it.
    """
    points = points[np.isfinite(points).all(axis=1)]
    if not len(points):
        return None
    voxel = _VOXEL_M
    kept = points[thinned(points, voxel, seed=seed)]
    while len(kept) > _MOST:
        voxel *= 1.2
        kept = points[thinned(points, voxel, seed=seed)]
    if len(kept) < _FEWEST:
        return None
    low, high = kept.min(axis=0) - REACH_M, kept.max(axis=0) + REACH_M
    distances = distance_map(points, low, high, max(_MAP_M, 0.6 * voxel), most_voxels=1_500_000)
    return CloudScore(np.ascontiguousarray(kept), voxel**2 / _CELLS_A_SIDE, distances, views)


# ---- silhouettes

_REACH_M = 0.4  # of the box around where the lines of sight meet: a hand and some arm
_SIDE_M = 0.01  # of a cell; twice that in the coarse grid, whose cells are halved
HAND_AREA_M2 = 0.012
"""of an open hand's outline: tells how deep it is where one camera alone sees it"""
_DEPTHS = (0.6, 1.6)


def visual_hull(silhouettes: Sequence[Silhouette]) -> tuple[Floats[N, D3], Floats[N]]:
    """Return cells of a centimetre that project into every silhouette that could see them, and how far inside their hull each lies, about [m];
    none where they disagree.

    A camera that a cell lies outside of says nothing about it; at least two must see it, or the only one there is.
    """
    from scipy.ndimage import distance_transform_edt

    seen = [s for s in silhouettes if (s.mask > 0.5).any()]
    if not seen:
        return np.zeros((0, 3)), np.zeros(0)
    outside: list[Floats] = [
        np.asarray(distance_transform_edt((s.mask <= 0.5) & (s.mask >= 0))) for s in seen
    ]
    cameras = [s.camera for s in seen]
    middle = _meeting_point(seen)
    coarse_m = 2.0 * _SIDE_M
    axis = np.arange(-_REACH_M, _REACH_M + 0.5 * coarse_m, coarse_m)
    grid = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3) + middle
    if len(seen) == 1:
        far = np.linalg.norm(middle - cameras[0].centre)
        depth = cameras[0].to_camera(grid)[:, 2]
        grid = grid[(depth > _DEPTHS[0] * far) & (depth < _DEPTHS[1] * far)]
    coarse = grid[_inside(grid, cameras, outside, 0.87 * coarse_m)]
    halves = 0.5 * _SIDE_M * np.stack(np.meshgrid(*[[-1.0, 1.0]] * 3, indexing="ij"), -1)
    fine = (coarse[:, None] + halves.reshape(-1, 3)).reshape(-1, 3)
    fine = fine[_inside(fine, cameras, outside, 0.5 * _SIDE_M)]
    return fine, _depth(fine)


def _inside(
    points: Floats, cameras: Sequence[Camera], outside: Sequence[Floats], margin_m: float
) -> Array:
    """Return (N,) whether points lie within margin_m of all silhouettes that can see them."""
    keep, views = np.ones(len(points), bool), np.zeros(len(points), int)
    for camera, far in zip(cameras, outside, strict=True):
        depth = camera.to_camera(points)[:, 2]
        pixel = np.rint(np.nan_to_num(camera.project(points), nan=-1.0)).astype(int)
        width, height = camera.size
        within = (depth > 0) & (pixel >= 0).all(axis=1)
        within &= (pixel[:, 0] < width) & (pixel[:, 1] < height)
        margin = margin_m * float(camera.matrix[0, 0]) / np.maximum(depth, 1e-6)
        column, row = np.clip(pixel[:, 0], 0, width - 1), np.clip(pixel[:, 1], 0, height - 1)
        keep &= ~within | (far[row, column] <= margin)
        views += within
    return keep & (views >= min(2, len(cameras)))


def _meeting_point(seen: Sequence[Silhouette]) -> Floats:
    """Return (3,) the point nearest to the lines of sight of the silhouettes' middles, world [m]; NaN where they look along one line.

    With one camera, the point on its line at which the silhouette has a hand's area.
    """
    shown = [np.argwhere(silhouette.mask > 0.5)[:, ::-1] for silhouette in seen]
    middles = np.array([np.median(pixels, axis=0) for pixels in shown])
    cameras = [silhouette.camera for silhouette in seen]
    if len(seen) > 1:
        return triangulated(cameras, middles[:, None], 0.0)[0]
    per_rad = cameras[0].matrix[0, 0] * cameras[0].matrix[1, 1]
    depth = np.sqrt(HAND_AREA_M2 * per_rad / len(shown[0]))
    return cameras[0].centre + cameras[0].rays(middles[0]) * depth


def _depth(centres: Floats) -> Floats:
    from scipy.ndimage import distance_transform_edt

    if not len(centres):
        return np.zeros(0)
    low = centres.min(axis=0) - _SIDE_M
    cell = np.rint((centres - low) / _SIDE_M).astype(int)
    filled = np.zeros(tuple(cell.max(axis=0) + 2), bool)
    filled[tuple(cell.T)] = True
    return np.asarray(distance_transform_edt(filled))[tuple(cell.T)] * _SIDE_M - 0.5 * _SIDE_M


_PIXEL_M = 0.0035  # of the reduced pictures, at the hand's distance
_SAMPLES = 130  # mask pixels of a camera that are looked at in a score, within a hand's reach
_STEP_PX = 2
_MOST_SCORED = 4  # cameras
_PLACE_M, _MOST_PLACES = 0.025, 100
# of outline errors, in bands; along how much outline they stay the same
_SIGMA_BANDS, _CORRELATED_M = (0.35, 0.010)
_WIDE_PIXELS = 2.0
_LEAST_VISIBLE = 0.25  # share of a box that counts as the whole


@array_dataclass
class SilhouetteScore:
    """One frame's silhouettes, reduced; made by `silhouette_score`."""

    whole: tuple[Silhouette, ...]

    @cached_property
    def hull(self) -> tuple[Floats[N, D3], Floats[N]]:
        """Cells of what all show, world [m], and how far inside it each lies, about [m]."""
        return visual_hull(self.whole)

    @cached_property
    def small(self) -> list[Silhouette]:
        """The silhouettes at about 3.5 mm a pixel at the hand's distance."""
        middle = self.hull[0].mean(axis=0)
        return [_reduced(silhouette, middle) for silhouette in self.whole]

    @cached_property
    def places(self) -> Floats[M, D3]:
        """Where a palm's middle may be, world [m]: within the hull, its thickest parts first."""
        cells, depth = self.hull
        deep = depth > 0.5 * min(PALM_DEEP_M, float(depth.max(initial=0.0)))
        cells = cells[deep][np.argsort(-depth[deep], kind="stable")]
        # balls of that radius cannot cover more: a mask of the whole image would take for ever from small ones
        volume = int(deep.sum()) * _SIDE_M**3
        apart = max(_PLACE_M, (3 * volume / (4 * np.pi * _MOST_PLACES)) ** (1 / 3))
        chosen = group_middles(cells, apart)
        while len(chosen) > _MOST_PLACES:
            apart *= 1.15
            chosen = group_middles(cells, apart)
        return chosen

    @cached_property
    def _scored(self) -> tuple[Silhouette, ...]:
        """Return the silhouettes that scores look at: of many, those whose lines of sight differ most."""
        middle = self.hull[0].mean(axis=0)
        directions = np.stack([s.camera.centre - middle for s in self.small])
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        chosen = [0]
        while len(chosen) < min(_MOST_SCORED, len(self.small)):
            # seen from behind, an outline is the same
            similarity = np.abs(directions @ directions[chosen].T).max(axis=1)
            similarity[chosen] = np.inf
            chosen.append(int(np.argmin(similarity)))
        return tuple(self.small[i] for i in sorted(chosen))

    @cached_property
    def _pictures(self) -> tuple[Array, Ints]:
        """Return distances to the masks (C, H, W) [px] and how many columns and rows of each count (C, 2)."""
        from scipy.ndimage import distance_transform_edt

        far = [
            np.where(s.known, np.asarray(distance_transform_edt(s.mask <= 0.5)), 0.0)[
                ::_STEP_PX, ::_STEP_PX
            ]
            for s in self._scored
        ]
        sizes = np.array([[f.shape[1], f.shape[0]] for f in far], np.int64)
        whole = np.zeros((len(far), sizes[:, 1].max(), sizes[:, 0].max()), np.float32)
        for i, f in enumerate(far):
            whole[i, : f.shape[0], : f.shape[1]] = f
        return whole, sizes

    @cached_property
    def _samples(self) -> tuple[Floats, Ints, Floats]:
        """Return evenly spread mask pixels (N, 2) of all cameras, where each camera's begin, and their areas (C,) [px²]."""
        chosen, areas = [], []
        for silhouette in self._scored:
            row, column = np.nonzero((silhouette.mask > 0.5) & silhouette.known)
            hand = HAND_AREA_M2 / _PIXEL_M**2  # samples are that dense, however much arm there is
            every = max(1, round(np.sqrt(hand / _SAMPLES)))
            kept = (row % every == 0) & (column % every == 0)
            chosen.append(np.stack([column[kept], row[kept]], axis=1).astype(float))
            areas.append(float(every**2))
        start = np.cumsum([0, *map(len, chosen)]).astype(np.int64)
        return np.concatenate(chosen), start, np.array(areas)

    def scores(
        self,
        shape: HandShape,
        rotations: Floats[R, D3, D3],
        places: Floats[M, D3],
        enough: float = 1.0,
    ) -> Floats[R, M]:
        """Return the share of area on which shape and masks disagree, by rotation and place."""
        cameras, (points, normals, _) = [s.camera for s in self._scored], shape.samples
        return silhouette_scores(
            (np.stack([c.projection for c in cameras]), np.array([c.focal_px for c in cameras])),
            (*self._pictures, _STEP_PX),
            self._samples,
            (np.ascontiguousarray(rotations), np.ascontiguousarray(places)),
            (points, normals, shape.area, shape.middle, shape.reach),
            shape.spheres,
            enough,
        )

    def terms(
        self,
        shape: HandShape,
        model: ArticulatedModel,
        params: Floats[P],
        band_m: float,
        unbiased: bool,
        palms: Floats[M, D3] | None,
    ) -> list[ObservationTerm]:
        """Return coverage with a band around a pose of the shape's model, or of that without an arm: on small pictures where
        it is wide.

        Parameters
        ----------
        unbiased
            The antisymmetric ramp; in the wide one a model rests inside its mask, a finger by a
            millimetre at 4 mm.
        """
        bones, middle = model.bones(params), palm_middle(model, params)
        near, bands, weights = [], [], []
        for silhouette in self.small if band_m > _WIDE_PIXELS * _PIXEL_M else self.whole:
            boxed = _boxed(silhouette, middle[None] if palms is None else palms, shape.reach)
            if boxed is None:
                continue
            metre = float(silhouette.camera.pixels_per_m_at(middle))
            band = max(band_m * metre, 1.0)
            sigma = _SIGMA_BANDS * band_m * metre
            near.append(prepare(boxed))
            bands.append(band)
            # what is out of sight is taken to fit as badly as what is seen of the same hand
            seen = (boxed.valid[:, 1] - boxed.valid[:, 0]).sum() / (2 * shape.reach * metre) ** 2
            unseen = 1.0 / np.clip(seen, _LEAST_VISIBLE, 1.0)
            weights.append(unseen * 2 * band / (_CORRELATED_M * metre * sigma**2))
        if not near:
            return []
        return [CoverageTerm(near, model.ellipsoids["fine"], bands, bones, unbiased, weights)]

    def pieces(self, shape: HandShape, params: Floats[P]) -> float:
        """Return how many pieces of a hand's outline are seen about a pose."""
        middle, count = palm_middle(shape.model, params), 0.0
        for silhouette in self.whole:
            boxed = _boxed(silhouette, middle[None], shape.reach)
            if boxed is not None:
                metre = float(silhouette.camera.pixels_per_m_at(middle))
                count += boxed.outline_px / (metre * PIECE_M)
        return count


def silhouette_score(silhouettes: Sequence[Silhouette]) -> SilhouetteScore | None:
    """Return silhouettes made ready for the search; None where they outline nothing, or nothing in common."""
    seen = [s for s in silhouettes if (s.mask > 0.5).any() and not s.fills_image]
    score = SilhouetteScore(tuple(seen))
    return score if len(score.hull[0]) else None


def _reduced(silhouette: Silhouette, middle: Floats) -> Silhouette:
    """Return the silhouette with several pixels merged into one, about _PIXEL_M large at `middle` (3,)."""
    camera = silhouette.camera
    merged = min(max(1, round(_PIXEL_M * float(camera.pixels_per_m_at(middle)))), *camera.size)
    if merged == 1:
        return silhouette
    width, height = camera.size[0] // merged, camera.size[1] // merged
    cut = silhouette.mask[: height * merged, : width * merged]
    blocks = cut.reshape(height, merged, width, merged)
    mask = blocks.mean(axis=(1, 3), dtype=np.float32)
    mask[(blocks < 0).any(axis=(1, 3))] = UNKNOWN
    spans = silhouette.valid[: height * merged].reshape(height, merged, 2)
    valid = np.stack(
        [-(-spans[..., 0].max(axis=1) // merged), spans[..., 1].min(axis=1) // merged], 1
    )
    valid[valid[:, 0] >= valid[:, 1]] = 0
    matrix = camera.matrix / merged
    matrix[:2, 2] = (camera.matrix[:2, 2] + 0.5) / merged - 0.5  # whole numbers are pixel centres
    matrix[2, 2] = 1.0
    small = replace(camera, size=(width, height), matrix=matrix)
    return Silhouette(small, np.ascontiguousarray(mask), np.minimum(valid, width).astype(np.int32))


def _boxed(silhouette: Silhouette, palms: Floats[M, D3], reach: float) -> Silhouette | None:
    """Return the silhouette with only a box around hands at these palms that counts; None where that is out of sight."""
    camera = silhouette.camera
    depth = camera.to_camera(palms)[:, 2:]
    if depth.min() < 0.05:
        return None
    half = reach * camera.focal_px / depth
    left, top = (camera.project(palms) - half).min(axis=0)
    right, bottom = (camera.project(palms) + half).max(axis=0)
    rows = np.arange(camera.size[1])
    low = np.maximum(silhouette.valid[:, 0], np.ceil(left))
    high = np.minimum(silhouette.valid[:, 1], np.floor(right) + 1)
    seen = (top <= rows) & (rows <= bottom) & (low < high)
    if not seen.any():
        return None
    valid = np.where(seen[:, None], np.stack([low, high], axis=1), 0).astype(np.int32)
    return Silhouette(camera, silhouette.mask, valid)
