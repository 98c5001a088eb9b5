"""Keypoint terms: the model's joints near points in space or in an image, robust."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from handtrack.arrays import D3, D7, Array, B, Floats, Ints, J, K, N
from handtrack.errors import unknown_name
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.kinematics import BonePoses
from handtrack.observation.observation import ImageKeypoints, Keypoints
from handtrack.terms.bone_system import BoneSystem, JointSystem
from handtrack.terms.keypoint_kernels import keypoint_kernel
from handtrack.terms.loss import Loss, Quadratic, compiled_loss
from handtrack.terms.rows import Rows, grown_row, point_row
from handtrack.terms.term_table import TermTable


def _known(model: ArticulatedModel, names: tuple[str, ...], seen: Array) -> Ints:
    for name in names:
        if name not in model.joint_names:
            raise unknown_name("joint", name, model.joint_names, f"the keypoints of {model.name}")
    return np.array(
        [model.joint_names.index(n) for n, s in zip(names, seen, strict=True) if s], int
    )


@dataclass(frozen=True)
class KeypointTerm:
    """Distances of model joints to observed points, in units of the points' sigma.

    A point that is not known (NaN) has no row. The robust loss acts on a point's whole distance.
    """

    model: ArticulatedModel
    observed: Keypoints | ImageKeypoints
    weight: float = 1.0
    loss: Loss = Quadratic()
    name: str = "keypoints"

    def rows(self, bones: BonePoses, growing: bool = False) -> Rows:
        """Return two (image) or three (space) rows a point. growing: with the bones' growth."""
        targets, sigma = _targets(self.observed)
        seen = np.asarray(np.isfinite(targets).all(axis=1))
        joint = _known(self.model, self.observed.names, seen)
        bone = self.model.joint_bone[joint]
        points = bones.to_world(bone, self._points[joint])
        if isinstance(self.observed, Keypoints):
            difference = (points - targets[seen]) / sigma
            directions = np.tile(np.eye(3) / sigma, (len(points), 1, 1))
        else:
            camera = self.observed.camera
            difference = (camera.project(points) - targets[seen]) / sigma
            directions = camera.project_jacobian(points) / sigma
        count, width = difference.shape
        squared = (difference**2).sum(axis=1)
        weight = self.weight * np.repeat(self.loss.weight(squared), width)
        row_of = grown_row if growing else point_row
        twist = row_of(np.repeat(points, width, axis=0), directions.reshape(-1, 3), bones.reference)
        cost = 0.5 * self.weight * float(self.loss.value(squared).sum())
        row = np.arange(count * width)
        return Rows(difference.ravel(), row, np.repeat(bone, width), twist, cost, weight)

    @property
    def is_detected(self) -> bool:
        """Whether a detector saw the points, in an image."""
        return isinstance(self.observed, ImageKeypoints)

    @property
    def _points(self) -> Floats:
        return points_meant(self.model, self.observed)

    def misses(self, bones: BonePoses) -> tuple[Ints[K], Floats[K]]:
        """Return which joints of the model were seen, and how far from them they are, in units of the points' sigma."""
        targets, _ = _targets(self.observed)
        off = np.linalg.norm(self.rows(bones).residual.reshape(-1, targets.shape[1]), axis=1)
        seen = np.asarray(np.isfinite(targets).all(axis=1))
        return _known(self.model, self.observed.names, seen), off

    def cost(self, bones: BonePoses) -> float:
        return self.rows(bones).cost

    def linearize(self, bones: BonePoses) -> BoneSystem:
        return self.rows(bones).bone_system(len(bones.position))

    def linearize_growth(self, bones: BonePoses) -> BoneSystem:
        return self.rows(bones, growing=True).bone_system(len(bones.position))

    def linearize_sized(
        self, bones: BonePoses, jacobian: Floats[B, D7, N], moves: Floats[J, D3, N]
    ) -> JointSystem:
        """Return cost, gradient and Hessian by N unknowns.

        jacobian: what each adds to the bones' twists and growth; moves: and to the points that a detector sees, in the bones'
        frames before they grow [m].
        """
        rows = self.rows(bones, growing=True)
        derivative = np.einsum("kl,kln->kn", rows.twist, jacobian[rows.bone])
        if isinstance(self.observed, ImageKeypoints):
            seen = np.asarray(np.isfinite(self.observed.pixels).all(axis=1))
            joint = np.repeat(_known(self.model, self.observed.names, seen), 2)
            along = np.einsum("ki,kij->kj", rows.twist[:, :3], bones.rotation[rows.bone])
            derivative += np.einsum("kj,kjn->kn", bones.grown(rows.bone, along), moves[joint])
        weighted = derivative * rows.weight[:, None]
        return JointSystem(rows.cost, weighted.T @ rows.residual, weighted.T @ derivative)

    def tables(self) -> list[TermTable] | None:
        """Return one; None for a distorted camera."""
        targets, sigma = _targets(self.observed)
        seen = np.asarray(np.isfinite(targets).all(axis=1))
        joint = _known(self.model, self.observed.names, seen)
        kind, scale = compiled_loss(self.loss, self.name)
        camera = np.zeros((0, 4))
        if isinstance(self.observed, ImageKeypoints):
            if self.observed.camera.is_distorted:
                return None
            camera = self.observed.camera.projection
        return [
            TermTable(
                keypoint_kernel, self.model.joint_bone[joint], self._points[joint], targets[seen], camera,
                np.array([sigma, kind, scale, self.weight]),
            )
        ]  # fmt: skip


def points_meant(model: ArticulatedModel, observed: Keypoints | ImageKeypoints) -> Floats[J, D3]:
    """Return the points of the bones, in their frames [m], that observed joints mean: in images a detector's."""
    return model.seen_point if isinstance(observed, ImageKeypoints) else model.joint_point


def _targets(observed: Keypoints | ImageKeypoints) -> tuple[Floats, float]:
    if isinstance(observed, Keypoints):
        return observed.positions, observed.sigma_m
    return observed.pixels, observed.sigma_px
