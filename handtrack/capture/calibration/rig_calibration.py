"""Board views of several cameras → calibrated rig with a report: lenses, places, joint refinement."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import cv2
import numpy as np

from handtrack.arrays import D2, D4, Array, Floats, N
from handtrack.capture.calibration.board_detection import BoardView
from handtrack.capture.calibration.board_views import CameraViews, choose_views
from handtrack.capture.calibration.boards import Board, CharucoBoard
from handtrack.capture.calibration.bundle_adjustment import (
    Corners,
    Refined,
    RigState,
    lens_matrix,
    refine,
)
from handtrack.capture.calibration.calibration_report import (
    CalibrationReport,
    camera_report,
    pair_reports,
)
from handtrack.capture.calibration.rig_graph import (
    Placed,
    frame_offset,
    place_cameras,
    pose_of_view,
)
from handtrack.errors import HandtrackError
from handtrack.geometry.camera import Camera, CameraRig
from handtrack.geometry.rotation import rotation_matrix, rotation_vector

_LEAST_VIEWS = 3
_APART = 0.03  # share of the board's distance; rightly matched views agree to some thousandths
_WRONG_VIEW = 4.0  # times the median error of a camera's views: the view is left out
_WRONG_VIEW_PX = 1.0


@dataclass(frozen=True)
class CalibrationSettings:
    """What is estimated, and from how much."""

    k3: bool = True
    """estimate the third radial coefficient"""
    tangential: bool = True
    """estimate p1 and p2"""
    most_views: int = 40
    """of each camera; more cost time and give little"""
    world: str = ""
    """`camera:NAME` or `board:FRAME`; the first camera if empty"""
    known: CameraRig | None = field(default=None, compare=False)
    """cameras whose lens is kept as it is"""


@dataclass(frozen=True)
class RigCalibration:
    """The rig, and how good it is."""

    rig: CameraRig
    report: CalibrationReport
    T_world_board: dict[int, Floats[D4, D4]]
    """by frame, of shared views"""
    cameras: tuple[CameraViews, ...]
    """the views used"""
    residuals: tuple[tuple[Floats[N, D2], ...], ...]
    """per camera and view, shared ones first: seen − predicted [px]"""


@dataclass(frozen=True)
class _LensFit:
    matrix: Floats
    distortions: Floats
    poses: tuple[Floats, ...]
    """T_camera_board of shared views, then of those for this camera alone."""
    rms_px: float
    dropped: tuple[str, ...]


def calibrate_rig(
    board: Board,
    cameras: Sequence[CameraViews],
    settings: CalibrationSettings = CalibrationSettings(),
) -> RigCalibration:
    """Return the rig that explains the views best.

    Raises HandtrackError for too few views, cameras that share none, a world that is not there.
    """
    _check_world_name(settings.world, cameras)
    fits: list[_LensFit] = []
    chosen: list[CameraViews] = []
    for camera in choose_views(cameras, settings.most_views):
        kept, fit = _fit_lens(board, camera, settings)
        chosen.append(kept)
        fits.append(fit)
    poses = [
        {view.frame: pose for view, pose in zip(camera.shared, fit.poses)}
        for camera, fit in zip(chosen, fits)
    ]
    placed = place_cameras(chosen, poses, board)
    corners, state, frames = _assembled(board, placed, fits)
    apart = [pair for pair, off in placed.disagreement.items() if off > _APART]
    free = _free_lens(chosen, settings)
    if apart:
        free[:] = False  # lenses would bend to explain what is not theirs
    refined = refine(state, corners, free, fixed_camera=0)
    T_world_board = {f: _pose_matrix(refined.state.view[i]) for f, i in frames.items()}
    T_new_world = _new_world(settings.world, chosen, refined.state, T_world_board)
    rig = _rig(chosen, refined.state, T_new_world)
    boards = {f: np.asarray(T_new_world @ pose, float) for f, pose in T_world_board.items()}
    used = placed.cameras
    left = _per_view(used, refined)
    report = _report(board, cameras, used, fits, refined, rig, left, placed)
    told = tuple(_told_apart(board, cameras, fits, pair) for pair in apart)
    report = replace(report, contradictions=told)
    return RigCalibration(rig, report, boards, used, left)


def _told_apart(
    board: Board, cameras: Sequence[CameraViews], fits: Sequence[_LensFit], pair: tuple[str, str]
) -> str:
    """Return what to say of two cameras whose common views contradict one another."""
    poses = [
        {
            view.frame: pose_of_view(view, board, fit.matrix, fit.distortions)
            for view in camera.shared
        }
        for name in pair
        for camera, fit in zip(cameras, fits)
        if camera.name == name
    ]
    offset = frame_offset(poses[0], poses[1], board)
    why = (
        f"with the frames of '{pair[1]}' shifted by {-offset:+d} they agree: renumber them, or cut the video"
        if offset is not None
        else "the cameras may not be synchronised, or one of them moved"
    )
    return (
        f"cameras '{pair[0]}' and '{pair[1]}' do not see the board in the same place in the same frames; "
        f"{why}. Lenses are as each camera alone gives them."
    )


def _fit_lens(
    board: Board, camera: CameraViews, settings: CalibrationSettings
) -> tuple[CameraViews, _LensFit]:
    """Return one camera's lens from its own views, and the views without those that do not fit."""
    known = _known_lens(camera, settings)
    views = (*camera.shared, *camera.alone)
    least = 1 if known is not None else _LEAST_VIEWS
    if len(views) < least:
        raise HandtrackError(
            f"camera '{camera.name}': the board was found in {len(views)} of {camera.tried} images; "
            f"at least {least} are needed, in different tilts, and 15 or more are good. Record more, "
            "or give images for the lens alone with --intrinsics."
        )
    if known is not None:
        return camera, _with_known_lens(board, camera, known)
    fit = _cv2_fit(board, camera, settings)
    errors = _view_errors(board, camera, fit)
    limit = max(_WRONG_VIEW * float(np.median(errors)), _WRONG_VIEW_PX)
    good = errors <= limit
    if good.all() or good.sum() < _LEAST_VIEWS:
        return camera, fit
    kept = _only(camera, good)
    dropped = tuple(
        f"camera '{camera.name}': left out {view.source or f'frame {view.frame}'}, which misses the "
        f"board by {error:.1f} px (the others {np.median(errors[good]):.2f} px)."
        for view, error, fine in zip(views, errors, good)
        if not fine
    )
    return kept, replace(_cv2_fit(board, kept, settings), dropped=dropped)


def _only(camera: CameraViews, good: Array) -> CameraViews:
    count = len(camera.shared)
    shared = tuple(view for view, fine in zip(camera.shared, good[:count]) if fine)
    alone = tuple(view for view, fine in zip(camera.alone, good[count:]) if fine)
    return replace(camera, shared=shared, alone=alone)


def _cv2_fit(board: Board, camera: CameraViews, settings: CalibrationSettings) -> _LensFit:
    views = (*camera.shared, *camera.alone)
    points = [board.points[view.ids].astype(np.float32) for view in views]
    pixels = [view.pixels.astype(np.float32).reshape(-1, 1, 2) for view in views]
    flags = 0 if settings.k3 else cv2.CALIB_FIX_K3
    flags |= 0 if settings.tangential else cv2.CALIB_ZERO_TANGENT_DIST
    try:
        rms, matrix, distortions, turns, shifts = cv2.calibrateCamera(
            points,
            pixels,
            camera.size,
            None,
            None,
            flags=flags,  # type: ignore[call-overload]
        )
    except cv2.error as error:
        raise HandtrackError(
            f"camera '{camera.name}': its lens cannot be told from {len(views)} views ({error.err}). "
            "They may all be square on to the camera; record tilted ones too."
        ) from None
    found = np.zeros(5)
    found[: min(5, distortions.size)] = np.ravel(distortions)[:5]
    poses = tuple(
        _pose_matrix(np.concatenate([np.ravel(turn), np.ravel(shift)]).astype(float))
        for turn, shift in zip(turns, shifts)
    )
    return _LensFit(np.array(matrix, dtype=float), found, poses, float(rms), ())


def _known_lens(camera: CameraViews, settings: CalibrationSettings) -> Camera | None:
    known = settings.known
    return known[camera.name] if known is not None and camera.name in known else None


def _with_known_lens(board: Board, camera: CameraViews, known: Camera) -> _LensFit:
    if known.size != camera.size:
        raise HandtrackError(
            f"camera '{camera.name}': its known lens is for {known.size[0]} x {known.size[1]}, the "
            f"images are {camera.size[0]} x {camera.size[1]}."
        )
    if np.any(known.distortions[5:]):
        raise HandtrackError(
            f"camera '{camera.name}': its known lens has {len(known.distortions)} distortion "
            "coefficients; expected k1 k2 p1 p2 k3. Calibrate the lens anew."
        )
    distortions = np.zeros(5)
    distortions[: min(5, len(known.distortions))] = known.distortions[:5]
    views = (*camera.shared, *camera.alone)
    poses = tuple(pose_of_view(view, board, known.matrix, distortions) for view in views)
    fit = _LensFit(np.array(known.matrix), distortions, poses, 0.0, ())
    return replace(fit, rms_px=float(np.sqrt(np.mean(_view_errors(board, camera, fit) ** 2))))


def _view_errors(board: Board, camera: CameraViews, fit: _LensFit) -> Floats:
    """Return the root mean square distance of each view's corners [px]."""
    found = []
    for view, pose in zip((*camera.shared, *camera.alone), fit.poses):
        turn, _ = cv2.Rodrigues(pose[:3, :3])
        pixels, _ = cv2.projectPoints(
            board.points[view.ids], turn, pose[:3, 3], fit.matrix, fit.distortions
        )
        off = view.pixels - np.array(pixels, dtype=float).reshape(-1, 2)
        found.append(float(np.sqrt((off**2).sum(axis=1).mean())))
    return np.array(found)


def _free_lens(cameras: Sequence[CameraViews], settings: CalibrationSettings) -> Array:
    free = np.ones((len(cameras), 9), dtype=bool)
    free[:, 6:8] &= settings.tangential
    free[:, 8] &= settings.k3
    for row, camera in zip(free, cameras):
        if _known_lens(camera, settings) is not None:
            row[:] = False
    return free


def _assembled(
    board: Board, placed: Placed, fits: Sequence[_LensFit]
) -> tuple[Corners, RigState, dict[int, int]]:
    """Return all corners in one list, the start of the refinement, and the view index by frame."""
    frames = {frame: i for i, frame in enumerate(sorted(placed.T_world_board))}
    view_poses = [placed.T_world_board[frame] for frame in frames]
    parts: list[tuple[int, int, BoardView]] = []
    for c, (camera, fit) in enumerate(zip(placed.cameras, fits, strict=True)):
        parts += [(c, frames[view.frame], view) for view in camera.shared]
        world = np.linalg.inv(placed.T_camera_world[c])
        for view, pose in zip(camera.alone, fit.poses[len(camera.shared) :], strict=True):
            parts.append((c, len(view_poses), view))
            view_poses.append(world @ pose)
    count = [len(view.ids) for _, _, view in parts]
    corners = Corners(
        camera=np.repeat([c for c, _, _ in parts], count).astype(np.int64),
        view=np.repeat([v for _, v, _ in parts], count).astype(np.int64),
        board=np.concatenate([board.points[view.ids] for _, _, view in parts]),
        pixels=np.concatenate([view.pixels for _, _, view in parts]),
    )
    lens = [[*fit.matrix[[0, 1, 0, 1], [0, 1, 2, 2]], *fit.distortions] for fit in fits]
    state = RigState(
        np.array(lens),
        np.stack([_pose_vector(pose) for pose in placed.T_camera_world]),
        np.stack([_pose_vector(pose) for pose in view_poses]),
    )
    return corners, state, frames


def _per_view(cameras: Sequence[CameraViews], refined: Refined) -> tuple[tuple[Floats, ...], ...]:
    lengths = [[len(view.ids) for view in (*camera.shared, *camera.alone)] for camera in cameras]
    parts = np.split(refined.residuals, np.cumsum([n for own in lengths for n in own])[:-1])
    found, at = [], 0
    for own in lengths:
        found.append(tuple(parts[at : at + len(own)]))
        at += len(own)
    return tuple(found)


def _rig(cameras: Sequence[CameraViews], state: RigState, T_new_world: Floats) -> CameraRig:
    made = []
    world = np.linalg.inv(T_new_world)
    for camera, lens, pose in zip(cameras, state.lens, state.camera, strict=True):
        T_camera_new = _pose_matrix(pose) @ world
        made.append(
            Camera(
                camera.name,
                camera.size,
                lens_matrix(lens),
                lens[4:],
                T_camera_new[:3, :3],
                T_camera_new[:3, 3],
            )
        )
    return CameraRig(tuple(made))


def _check_world_name(world: str, cameras: Sequence[CameraViews]) -> None:
    kind, _, name = world.partition(":")
    names = [camera.name for camera in cameras]
    frames = {view.frame for camera in cameras for view in camera.shared}
    if world == "" or (kind == "camera" and name in names):
        return
    if kind == "board" and name.isdecimal() and int(name) in frames:
        return
    shown = ", ".join(map(str, sorted(frames)[:12]))
    raise HandtrackError(
        f"--world {world}: expected camera:NAME (of {', '.join(names)}) or board:FRAME, a frame in "
        f"which the board was found ({shown}{' …' if len(frames) > 12 else ''})."
    )


def _new_world(
    world: str, cameras: Sequence[CameraViews], state: RigState, T_world_board: dict[int, Floats]
) -> Floats:
    """Return T_new_world (4, 4). On a board z points out of the print: up, where it lies on a table."""
    kind, _, name = world.partition(":")
    if kind == "camera":
        index = [camera.name for camera in cameras].index(name)
        return _pose_matrix(state.camera[index])
    if kind == "board":
        if int(name) not in T_world_board:
            frames = ", ".join(map(str, sorted(T_world_board)))
            raise HandtrackError(
                f"--world {world}: that view was not among those chosen; choose one of {frames}."
            )
        out_of_print = np.diag([1.0, -1.0, -1.0, 1.0])
        return out_of_print @ np.linalg.inv(T_world_board[int(name)])
    return _pose_matrix(state.camera[0])


def _report(
    board: Board,
    given: Sequence[CameraViews],
    used: Sequence[CameraViews],
    fits: Sequence[_LensFit],
    refined: Refined,
    rig: CameraRig,
    left: tuple[tuple[Floats, ...], ...],
    placed: Placed,
) -> CalibrationReport:
    cameras = tuple(
        camera_report(rig.cameras[c], given[c], used[c], left[c], fits[c].rms_px, refined, c)
        for c in range(len(used))
    )
    warnings = [text for fit in fits for text in fit.dropped]
    if len(board.turns) > 1 and len(used) > 1:
        warnings.append(
            f"the board {board.text} looks the same after {'a quarter' if len(board.turns) > 2 else 'half a'} "
            "turn; which way round it was is settled by what most common views agree on, which needs "
            "a board that moves. A board with one even and one odd count (such as 9x6) is safe."
        )
    if not refined.converged:
        warnings.append(
            "the refinement stopped before it had settled; treat the numbers with care."
        )
    if isinstance(board, CharucoBoard) and board.rows % 2 == 0:
        warnings.append(
            "ChArUco boards with an even number of rows were printed otherwise by OpenCV before 4.6; "
            "if few corners were found, print the board anew with `handtrack board`."
        )
    return CalibrationReport(
        board=board.text,
        sigma_px=refined.sigma_px,
        cameras=cameras,
        pairs=pair_reports(rig, used, placed.disagreement),
        warnings=tuple(warnings),
    )


def _pose_matrix(pose: Floats) -> Floats:
    matrix = np.eye(4)
    matrix[:3, :3] = rotation_matrix(pose[:3])
    matrix[:3, 3] = pose[3:]
    return matrix


def _pose_vector(matrix: Floats) -> Floats:
    return np.concatenate([rotation_vector(matrix[:3, :3]), matrix[:3, 3]])
