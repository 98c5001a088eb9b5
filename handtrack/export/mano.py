"""MANO exchange: a user's own model file (never bundled) fitted to a tracked hand, and its output as keypoints.

Romero, Tzionas and Black, "Embodied hands", 2017: v = W(T(β) + B_P(θ), J(β), θ), linear blend skinning of a template that
shape β and pose θ correct. Keypoints are the 16 joints that J regresses and five vertices at the fingertips.
"""

from __future__ import annotations

import codecs
import pickle
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from handtrack.arrays import (
    D3,
    D16,
    D21,
    Array,
    Axes,
    F,
    Floats,
    Ints,
    K,
    N,
    V,
    array_dataclass,
    evenly_spread,
)
from handtrack.capture.images.openpose import FINGERS
from handtrack.errors import HandtrackError
from handtrack.export.table import ResultsTable
from handtrack.files.npz_files import read_arrays
from handtrack.files.text_files import check_file, first_bytes
from handtrack.geometry.rotation import rotation_matrix
from handtrack.model.articulated import keypoint_names
from handtrack.model.metaballs import MetaballSurface
from handtrack.session.tables import write_arrays

JOINTS = 16
_FINGERS = ("index", "middle", "little", "ring", "thumb")  # in MANO's order of joints
_TIPS = {"thumb": 744, "index": 320, "middle": 443, "ring": 554, "little": 671}
"""vertices of MANO's 778 at the fingertips, as its authors' programs take them"""
_VERTICES = 778
_JOINT_SIGMA_M = 0.003  # how far MANO's joints lie from ours: other definitions of the same joints
_SURFACE_SIGMA_M = 0.004  # the same of its skin
_OUTLIER = 3.0  # standard deviations beyond which a distance pulls no more: its pose is wrong there, not its shape
_POSE_SIGMA_RAD = 1.0  # of each joint's turn: holds what the points leave open
_SHAPE_FRAMES = 12
_SHAPE_ROUNDS = 3
_STEPS = 12
_DIFFERENCE = 1e-5


@array_dataclass
class ManoModel:
    """The numbers of a MANO file."""

    template: Floats[V, D3]
    """[m]"""
    shape_directions: Floats[V, D3, K]
    """[m] for each β"""
    pose_directions: Floats[V, D3, N]
    """[m] for each entry of the 15 joints' R − 1"""
    regressor: Floats[D16, V]
    weights: Floats[V, D16]
    parent: Ints[D16]
    """−1 of the wrist"""

    @classmethod
    def read(cls, path: Path) -> ManoModel:
        """Return the model of MANO_RIGHT.pkl, MANO_LEFT.pkl, or an .npz with their arrays. Raises HandtrackError."""
        tree = _tree(path)
        names = (
            "v_template",
            "shapedirs",
            "posedirs",
            "J_regressor",
            "weights",
            "kintree_table",
        )
        missing = [name for name in names if name not in tree]
        if missing:
            raise HandtrackError(
                f"{path}: no MANO model: {', '.join(missing)} missing; there are {', '.join(map(str, tree))[:200]}."
            )
        template, shapes, poses, regressor, weights, tree_table = (
            _dense(tree[name]) for name in names
        )
        if template.shape != (_VERTICES, 3) or weights.shape != (_VERTICES, JOINTS):
            raise HandtrackError(
                f"{path}: a template of {template.shape} and weights of {weights.shape}; expected MANO's {_VERTICES} vertices "
                f"and {JOINTS} joints."
            )
        parent = tree_table[0].astype(np.int64)
        parent[0] = -1
        return cls(template, shapes, poses, regressor, weights, parent)

    def shaped(self, betas: Floats[K]) -> tuple[Floats[V, D3], Floats[D16, D3]]:
        """Return the vertices and joints [m] of a shape in the zero pose. Fewer numbers than it has leave the others 0."""
        vertices = self.template + self.shape_directions[..., : len(betas)] @ betas
        return vertices, self.regressor @ vertices

    def posed(
        self,
        betas: Floats[K],
        pose: Floats[N, D16, D3],
        place: Floats[N, D3],
        vertices: Ints[K] | None = None,
    ) -> tuple[Floats[N, D16, D3], Floats[N, K, D3]]:
        """Return joints and chosen vertices [m], all where none are chosen, in N poses.

        Parameters
        ----------
        pose
            Rotation vectors [rad], the wrist's in the world, the others in their parent's frame
            (MANO's full pose, its mean pose added).
        place
            [m], what is added to all, MANO's `transl`.
        """
        chosen = np.arange(_VERTICES) if vertices is None else vertices
        skin, joints = self.shaped(betas)
        turns = rotation_matrix(pose)
        features = (turns[:, 1:] - np.eye(3)).reshape(len(pose), -1)
        points = skin[chosen] + np.einsum("vdk,nk->nvd", self.pose_directions[chosen], features)
        rotation, position = np.empty_like(turns), np.empty((len(pose), JOINTS, 3))
        for j, above in enumerate(self.parent):
            if above < 0:
                rotation[:, j], position[:, j] = turns[:, j], joints[j]
                continue
            rotation[:, j] = rotation[:, above] @ turns[:, j]
            position[:, j] = position[:, above] + rotation[:, above] @ (joints[j] - joints[above])
        local = points[:, :, None] - joints  # (N, K, 16, 3)
        moved = np.einsum("njab,nkjb->nkja", rotation, local) + position[:, None]
        skinned = np.einsum("kj,nkja->nka", self.weights[chosen], moved)
        return position + place[:, None], skinned + place[:, None]

    def keypoints21(
        self, betas: Floats[K], pose: Floats[N, D16, D3], place: Floats[N, D3]
    ) -> Floats[N, D21, D3]:
        """Return the 21 keypoints [m] in OpenPose's order, as `init.json` takes them: a start from another program's output."""
        tips = np.array([_TIPS[finger] for finger in _FINGERS])
        joints, ends = self.posed(betas, pose, place, tips)
        points = {"wrist": joints[:, 0]}
        for f, finger in enumerate(_FINGERS):
            own = *joints.swapaxes(0, 1)[1 + 3 * f :][:3], ends[:, f]
            points |= {f"{finger}_{part}": own[k] for k, part in enumerate(FINGERS[finger])}
        return np.stack([points[name] for name in keypoint_names()], axis=1)


def fit_mano(model: ManoModel, table: ResultsTable) -> dict[str, Array[*Axes]]:
    """Return MANO's shape and poses that are nearest to a hand's keypoints, the shape also to its surface.

    By MANO's names, without a mean pose (`flat_hand_mean=True`) [rad, m]: `betas`, `global_orient`, `hand_pose` (F, 45), `transl`;
    and `keypoint_error_m` (F,), how far its keypoints are from ours on average.

    Each frame is a small least-squares problem of 51 numbers, from the frame before. The shape is found from up to twelve
    frames, by keypoints and by how far MANO's skin is from the tracked surface there, in turns with their poses.  Lost frames are fitted to the estimate that they hold. Raises HandtrackError for what is no hand.
    """
    track = table.track
    if track.keypoints21 is None:
        raise HandtrackError(f"{table.source}: the model '{track.model}' is no hand; MANO is.")
    wanted = np.asarray(track.keypoints21)
    betas = np.zeros(min(10, model.shape_directions.shape[2]))
    chosen = np.array(evenly_spread(len(wanted), _SHAPE_FRAMES))
    surface = MetaballSurface.of(table.model)
    for _ in range(_SHAPE_ROUNDS):
        poses = _poses(model, betas, wanted[chosen])
        betas = _shape(model, betas, poses, wanted[chosen], surface, table, chosen)
    pose, place = _poses(model, betas, wanted)
    error = np.linalg.norm(model.keypoints21(betas, pose, place) - wanted, axis=2).mean(axis=1)
    return {
        "betas": betas,
        "global_orient": pose[:, 0],
        "hand_pose": pose[:, 1:].reshape(len(pose), -1),
        "transl": place,
        "keypoint_error_m": error,
    }


def write(path: Path, table: ResultsTable) -> None:
    """Write `betas`, `global_orient`, `hand_pose` (45 numbers, flat_hand_mean=True), `transl` [rad, m] by frame, and how far the
    fitted keypoints are from ours. The model file is `table.mano`. Raises HandtrackError without one, or where it is of the
    other hand.
    """
    if table.mano is None:
        raise HandtrackError(
            "--to mano needs a MANO model, which its licence keeps from being bundled: --mano MANO_RIGHT.pkl, from its own site."
        )
    side = next((s for s in ("left", "right") if s in table.mano.name.lower()), table.track.side)
    if side != table.track.side:
        raise HandtrackError(
            f"--mano {table.mano}: a {side} hand's model; a {table.track.side} hand was tracked."
        )
    arrays: dict[str, Array] = {
        "frame": table.track.frame,
        "time_s": table.track.time_s,
        **fit_mano(ManoModel.read(table.mano), table),
        "flat_hand_mean": np.array(True),
        "side": np.array(table.track.side),
    }
    write_arrays(path, arrays)


def _poses(
    model: ManoModel, betas: Floats[K], wanted: Floats[F, D21, D3]
) -> tuple[Floats[F, D16, D3], Floats[F, D3]]:
    from scipy.spatial.transform import Rotation

    poses, places = [], []
    state = np.zeros(3 * JOINTS + 3)
    for i, points in enumerate(wanted):
        if i == 0:
            rest = model.keypoints21(betas, np.zeros((1, JOINTS, 3)), np.zeros((1, 3)))[0]
            # the turn about the wrist and the shift that bring it nearest (Kabsch)
            turn: Any = Rotation.align_vectors(points - points.mean(0), rest - rest.mean(0))[0]
            moved = turn.apply(rest - rest[0]) + rest[0]
            state[:3], state[-3:] = turn.as_rotvec(), (points - moved).mean(axis=0)
        state = _fitted(model, betas, state, points)
        poses.append(state[:-3].reshape(JOINTS, 3))
        places.append(state[-3:])
    return np.array(poses), np.array(places)


def _fitted(
    model: ManoModel, betas: Floats[K], state: Floats[N], wanted: Floats[D21, D3]
) -> Floats[N]:
    """Return the pose and place of one frame."""

    def residuals(states: Floats[N, K]) -> Floats[N, K]:
        points = model.keypoints21(
            betas, states[:, :-3].reshape(len(states), JOINTS, 3), states[:, -3:]
        )
        near = ((points - wanted) / _JOINT_SIGMA_M).reshape(len(states), -1)
        return np.concatenate([near, states[:, 3:-3] / _POSE_SIGMA_RAD], axis=1)

    return _least_squares(residuals, state)


def _least_squares(
    residuals: Callable[[Floats[N, K]], Floats[N, K]], state: Floats[K]
) -> Floats[K]:
    """Return where the squares of residuals, a row a state, are least: by Levenberg and Marquardt's steps, derivatives by differences."""
    from scipy.optimize import least_squares

    def jacobian(at: Floats[K]) -> Floats[N, K]:
        steps = at + _DIFFERENCE * np.eye(len(at))
        return (residuals(steps) - residuals(at[None])).T / _DIFFERENCE

    found: Any = least_squares(
        lambda at: residuals(at[None])[0],
        state,
        jacobian,  # pyright: ignore[reportArgumentType]
        method="lm",
        ftol=1e-6,
        max_nfev=_STEPS,
    )
    return found.x


def _shape(
    model: ManoModel,
    betas: Floats[K],
    poses: tuple[Floats[F, D16, D3], Floats[F, D3]],
    wanted: Floats[F, D21, D3],
    surface: MetaballSurface,
    table: ResultsTable,
    rows: Ints[N],
) -> Floats[K]:
    """Return the shape by the distances between keypoints, by those of the skin to the tracked surface in some poses, and by its
    population (β ~ N(0, 1)).
    """
    solver = [table.model.transform.solver_params(table.track.parameters[row]) for row in rows]
    bones = [table.model.bones(params) for params in solver]
    some = np.arange(0, _VERTICES, 5)
    length = _lengths(wanted).mean(axis=0)
    share = np.sqrt(len(length) / (len(rows) * len(some)))  # neighbours on a skin say the same

    def residuals(states: Floats[N, K]) -> Floats[N, K]:
        found = []
        for state in states:
            _, skin = model.posed(state, *poses, some)
            far = [
                surface.distance(b, points) / _SURFACE_SIGMA_M
                for b, points in zip(bones, skin, strict=True)
            ]
            near = share * np.clip(np.concatenate(far), -_OUTLIER, _OUTLIER)
            own = _lengths(model.keypoints21(state, poses[0][:1], poses[1][:1]))[0]
            found.append(np.concatenate([(own - length) / _JOINT_SIGMA_M, near]))
        return np.concatenate([np.array(found), states], axis=1)

    return _least_squares(residuals, betas)


def _lengths(keypoints: Floats[N, D21, D3]) -> Floats[N, K]:
    """Return the distances [m] from each of 21 keypoints to the one before it in its finger, or to the wrist: no pose moves them."""
    before = [0 if k % 4 == 1 else k - 1 for k in range(1, 21)]
    return np.linalg.norm(keypoints[:, 1:] - keypoints[:, before], axis=2)


def _tree(path: Path) -> dict[str, Any]:
    check_file(path, "a MANO model")
    if first_bytes(path)[:4] == b"PK\3\4":
        return read_arrays(path)
    try:
        with path.open("rb") as file:
            tree = _Arrays(file, encoding="latin1").load()
    except Exception as error:  # a damaged pickle raises whatever it likes
        raise HandtrackError(
            f"{path}: not readable as a MANO model ({type(error).__name__}: {error})."
        ) from None
    if not isinstance(tree, dict):
        raise HandtrackError(f"{path}: {type(tree).__name__}; expected MANO's table of arrays.")
    return tree


class _Arrays(pickle.Unpickler):
    """Reads arrays and sparse matrices, and nothing that could run."""

    def find_class(self, module: str, name: str) -> Any:
        root = module.split(".", maxsplit=1)[0]
        if root == "chumpy":
            return SimpleNamespace  # whose numbers are in its state
        if (module, name) == ("_codecs", "encode"):  # how Python 3 writes bytes for Python 2
            return codecs.encode
        if root == "scipy" and name in ("csc_matrix", "csr_matrix"):
            import scipy.sparse

            return getattr(scipy.sparse, name)
        if (module, name) in (("copy_reg", "_reconstructor"), ("copyreg", "_reconstructor")):
            return lambda kind, *_: kind.__new__(kind)
        if (module, name) in (("__builtin__", "object"), ("builtins", "object")):
            return object
        if root == "numpy" and name in ("_reconstruct", "ndarray", "dtype", "scalar"):
            return super().find_class(module, name)
        raise pickle.UnpicklingError(f"it asks for {module}.{name}")


def _dense(value: Any) -> Array[*Axes]:
    """Return an array of numbers from an array, a sparse matrix or a chumpy one."""
    if isinstance(value, SimpleNamespace):
        inner = getattr(value, "x", getattr(value, "a", None))
        if inner is None:
            raise HandtrackError(
                "a MANO array of an unknown kind; save the model as .npz with NumPy."
            )
        return _dense(inner)
    if hasattr(value, "toarray"):
        value = value.toarray()
    return np.asarray(value, dtype=float)
