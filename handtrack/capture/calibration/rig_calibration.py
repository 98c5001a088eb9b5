"""Board views of several cameras → calibrated rig with a report: lenses, places, joint refinement.

Not all cameras need to see one board: pairs are chained, the pairs with most common views first.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain, combinations, compress, islice, permutations
from typing import Any

import cv2
import numpy as np
from scipy.sparse.csgraph import connected_components

from handtrack.arrays import D2, D3, D4, D6, D9, Array, C, Floats, K, N
from handtrack.capture.calibration.boards import Board, BoardView, CameraViews, Place, choose_views
from handtrack.capture.calibration.bundle_adjustment import (
    LENS,
    Corners,
    free_numbers,
    lens_uncertainty,
    parts,
    refine,
    residuals,
    spread,
)
from handtrack.capture.calibration.formats.imported_rig import five_or_more
from handtrack.errors import HandtrackError
from handtrack.geometry.camera import Camera, CameraRig, camera_matrix
from handtrack.geometry.rotation import rotation_matrix, rotation_vector, turn_between, turned_by

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
    known: Mapping[str, Camera] = field(default_factory=dict)
    """by name, cameras whose lens is kept as it is"""


@dataclass(frozen=True)
class RigCalibration:
    """The rig, and how good it is."""

    rig: CameraRig
    report: dict[str, Any]
    """how good it is, in numbers, lists and texts, for JSON: see `camera_report`, `pair_reports` and `report_text`;
    `contradictions` are of pairs of cameras whose common views do not agree: the rig is not to be used then"""
    T_world_board: dict[int, Floats[D4, D4]]
    """by frame, of shared views"""
    cameras: Sequence[CameraViews]
    """the views used"""
    residuals: tuple[tuple[Floats[N, D2], ...], ...]
    """per camera and view: seen − predicted [px]"""


def calibrate_rig(
    board: Board,
    cameras: Sequence[CameraViews],
    settings: CalibrationSettings = CalibrationSettings(),
) -> RigCalibration:
    """Return the rig that explains the views best.

    Raises HandtrackError for too few views, cameras that share none, a world that is not there.
    """
    warnings: list[str] = []
    chosen = choose_views(cameras, settings.most_views)
    fits = [_fit_lens(board, camera, settings, warnings) for camera in chosen]
    fitted, lenses, rms_alone_px = zip(*fits)
    used, T_camera_world, boards, disagreement = place_cameras(fitted, board)
    corners = _assembled(board, used, list(boards))
    placed = np.stack([*T_camera_world, *boards.values()])
    poses = np.column_stack([rotation_vector(placed[:, :3, :3]), placed[:, :3, 3]])
    start = np.concatenate([*lenses, *poses])
    apart = [pair for pair, off in disagreement.items() if off > _APART]
    free_lens = np.ones((len(used), len(LENS)), dtype=bool)
    free_lens[:, 6:8] = settings.tangential
    free_lens[:, 8] = settings.k3
    free_lens[[camera.name in settings.known for camera in used]] = False
    if apart:
        free_lens[:] = False  # lenses would bend to explain what is not theirs
    free = free_numbers(start, corners, free_lens)
    state, converged = refine(start, corners, free)
    lens, camera, view = parts(state, corners)
    T_world_board = {f: _pose_matrix(p) for (name, f), p in zip(boards, view) if not name}
    T_new_world = _new_world(settings.world, used, camera, T_world_board)
    rig = _rig(used, lens, camera, np.linalg.inv(T_new_world))
    T_world_board = {f: np.asarray(T_new_world @ p, float) for f, p in T_world_board.items()}
    lengths = [len(view.ids) for camera in used for view in camera.views.values()]
    every = residuals(state, corners)
    pieces = iter(np.split(every, np.cumsum(lengths)[:-1]))
    left = tuple(tuple(islice(pieces, len(camera.views))) for camera in used)
    lens_std, skew = lens_uncertainty(state, corners, free)
    told = zip(cameras, used, left, rms_alone_px, lens, lens_std, skew, strict=True)
    reports = [camera_report(*of_camera) for of_camera in told]
    warnings += [*_warnings(board, used, converged), *chain(*map(_camera_warnings, reports))]
    report = {
        "board": board.text,
        "sigma_px": spread(every),
        "cameras": reports,
        "pairs": list(pair_reports(rig, used, disagreement)),
        "warnings": warnings,
        "contradictions": [_contradiction(board, cameras, lenses, pair) for pair in apart],
    }
    return RigCalibration(rig, report, T_world_board, used, left)


def _contradiction(
    board: Board,
    cameras: Sequence[CameraViews],
    lenses: Sequence[Floats[D9]],
    pair: tuple[str, str],
) -> str:
    """Return what to say of two cameras whose common views contradict one another."""
    poses = {
        camera.name: {f: pose_of_view(view, board, lens) for (_, f), view in camera.shared.items()}
        for camera, lens in zip(cameras, lenses)
        if camera.name in pair
    }
    offset = frame_offset(poses[pair[0]], poses[pair[1]], board)
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
    board: Board, camera: CameraViews, settings: CalibrationSettings, warnings: list[str]
) -> tuple[CameraViews, Floats[D9], float]:
    """Return one camera's views with the boards' poses, its lens in the order of LENS and its root mean square error [px], by its own
    views alone, without those that do not fit, of which it is warned.
    """
    known = settings.known.get(camera.name)
    least = 1 if known is not None else _LEAST_VIEWS
    if len(camera.views) < least:
        raise HandtrackError(
            f"camera '{camera.name}': the board was found in {len(camera.views)} of {camera.tried} images; "
            f"at least {least} are needed, in different tilts, and 15 or more are good. Record more, "
            "or give images for the lens alone with --intrinsics."
        )
    fit, errors = _cv2_fit(board, camera, settings)
    limit = max(_WRONG_VIEW * float(np.median(errors)), _WRONG_VIEW_PX)
    good = errors <= limit
    if known is not None or good.all() or good.sum() < _LEAST_VIEWS:
        return fit
    warnings += [
        f"camera '{camera.name}': left out {view.source or f'frame {frame}'}, which misses the "
        f"board by {error:.1f} px (the others {np.median(errors[good]):.2f} px)."
        for ((_, frame), view), error, fine in zip(camera.views.items(), errors, good)
        if not fine
    ]
    fitting = replace(camera, views=dict(compress(camera.views.items(), good)))
    return _cv2_fit(board, fitting, settings)[0]


_FIXED = (
    cv2.CALIB_USE_INTRINSIC_GUESS
    | cv2.CALIB_FIX_FOCAL_LENGTH
    | cv2.CALIB_FIX_PRINCIPAL_POINT
    | cv2.CALIB_FIX_TANGENT_DIST
    | cv2.CALIB_FIX_K1
    | cv2.CALIB_FIX_K2
    | cv2.CALIB_FIX_K3
)


def _cv2_fit(
    board: Board, camera: CameraViews, settings: CalibrationSettings
) -> tuple[tuple[CameraViews, Floats[D9], float], Floats[N]]:
    """Return what `_fit_lens` does, of all views, and each one's error."""
    points = [board.points[view.ids].astype(np.float32) for view in camera.views.values()]
    pixels = [view.pixels.astype(np.float32).reshape(-1, 1, 2) for view in camera.views.values()]
    flags = 0 if settings.k3 else cv2.CALIB_FIX_K3
    flags |= 0 if settings.tangential else cv2.CALIB_ZERO_TANGENT_DIST
    lens, known = (None, None), settings.known.get(camera.name)
    if known is not None:
        lens, flags = _known_lens(camera, known), _FIXED
    try:
        rms_px, matrix, distortions, turns, shifts, *_, errors = cv2.calibrateCameraExtended(
            points,
            pixels,
            camera.size,
            *lens,
            flags=flags,  # type: ignore[call-overload]
        )
    except cv2.error as error:
        raise HandtrackError(
            f"camera '{camera.name}': its lens cannot be determined from {len(points)} views ({error.err}). "
            "They may all be square on to the camera; record tilted ones too."
        ) from None
    poses = (_pose_matrix(np.ravel(pose).astype(float)) for pose in zip(turns, shifts))
    views = {p: replace(v, pose=pose) for (p, v), pose in zip(camera.views.items(), poses)}
    numbers = np.array([*matrix[[0, 1, 0, 1], [0, 1, 2, 2]], *np.ravel(distortions)[:5]])
    return (replace(camera, views=views), numbers, float(rms_px)), np.ravel(errors)


def _known_lens(camera: CameraViews, known: Camera) -> tuple[Array[D3, D3], Array[K]]:
    """Return a known lens's matrix and k1 k2 p1 p2 k3. Raises HandtrackError where it is not of these images, or has others."""
    if known.size != camera.size:
        raise HandtrackError(
            f"camera '{camera.name}': its known lens is for {known.size[0]} x {known.size[1]}, the "
            f"images are {camera.size[0]} x {camera.size[1]}."
        )
    distortions = five_or_more(known.distortions)
    if len(distortions) > 5:
        raise HandtrackError(
            f"camera '{camera.name}': its known lens has {len(known.distortions)} distortion "
            "coefficients; expected k1 k2 p1 p2 k3. Calibrate the lens anew."
        )
    return known.matrix.copy(), distortions


def _assembled(board: Board, cameras: Sequence[CameraViews], boards: list[Place]) -> Corners:
    """Return all corners in one list, views numbered as `boards` has them."""
    number = {placed: v for v, placed in enumerate(boards)}
    seen = [
        (c, number[place], view)
        for c, camera in enumerate(cameras)
        for place, view in camera.views.items()
    ]
    count = [len(view.ids) for _, _, view in seen]
    camera, number_of_view = np.repeat([(c, v) for c, v, _ in seen], count, axis=0).T
    points = np.concatenate([board.points[view.ids] for _, _, view in seen])
    return Corners(camera, number_of_view, points, np.concatenate([v.pixels for _, _, v in seen]))


def _rig(
    cameras: Sequence[CameraViews],
    lenses: Floats[C, D9],
    poses: Floats[C, D6],
    T_world_new: Floats[D4, D4],
) -> CameraRig:
    made = []
    for seen, lens, pose in zip(cameras, lenses, poses, strict=True):
        rotation, shift = np.hsplit((_pose_matrix(pose) @ T_world_new)[:3], [3])
        matrix = camera_matrix(*lens[:4])
        made.append(Camera(seen.name, seen.size, matrix, lens[4:], rotation, shift[:, 0]))
    return CameraRig(tuple(made))


def _new_world(
    world: str,
    cameras: Sequence[CameraViews],
    poses: Floats[C, D6],
    T_world_board: dict[int, Floats],
) -> Floats:
    """Return T_new_world (4, 4). On a board z points out of the print: up, where it lies on a table."""
    kind, _, name = world.partition(":")
    names = [camera.name for camera in cameras]
    if kind == "board" and name.isdecimal() and int(name) in T_world_board:
        out_of_print = np.diag([1.0, -1.0, -1.0, 1.0])
        return out_of_print @ np.linalg.inv(T_world_board[int(name)])
    if world and (kind != "camera" or name not in names):
        raise HandtrackError(
            f"--world {world}: expected camera:NAME (of {', '.join(names)}) or board:FRAME, of the frames in "
            f"which the board was found those chosen ({', '.join(map(str, T_world_board))})."
        )
    return _pose_matrix(poses[names.index(name) if name else 0])


def _warnings(board: Board, cameras: Sequence[CameraViews], converged: bool) -> Iterator[str]:
    if len(board.turns) > 1 and len(cameras) > 1:
        yield (
            f"the board {board.text} looks the same after {'a quarter' if len(board.turns) > 2 else 'half a'} "
            "turn; its orientation is taken from the majority of common views, which needs a board that moves. A board with one even and one odd count (such as 9x6) is safe."
        )
    if not converged:
        yield ("the refinement stopped before it had converged; treat the numbers with care.")
    if board.dictionary and board.rows % 2 == 0:
        yield (
            "ChArUco boards with an even number of rows were printed otherwise by OpenCV before 4.6; "
            "if few corners were found, print the board anew with `handtrack calibrate --out board.pdf`."
        )


def _pose_matrix(pose: Floats) -> Floats:
    return _transform(rotation_matrix(pose[:3]), pose[3:])


def _transform(rotation: Array[D3, D3], translation: Array[D3]) -> Floats[D4, D4]:
    matrix = np.eye(4)
    matrix[:3] = np.column_stack([rotation, translation])
    return matrix


# ---- where cameras stand relative to one another, from boards that two of them saw in the same frame


_MOST_OFFSET = 60  # frames
_TURN_M = 1.0  # a degree of disagreement counts as much as 1.7 % of the distance to the board


def pose_of_view(view: BoardView, board: Board, lens: Floats[D9]) -> Floats[D4, D4]:
    """Return T_camera_board of one view, the better of a plane's two poses."""
    points, by = board.points[view.ids], (camera_matrix(*lens[:4]), lens[4:])
    is_found, turn, shift = cv2.solvePnP(points, view.pixels, *by, flags=cv2.SOLVEPNP_IPPE)
    if is_found:
        turn, shift = cv2.solvePnPRefineLM(points, view.pixels, *by, turn, shift)
    else:
        _, turn, shift = cv2.solvePnP(points, view.pixels, *by)
    return _transform(cv2.Rodrigues(turn)[0], np.ravel(shift))


def common_places(a: CameraViews, b: CameraViews) -> list[Place]:
    """Return the frames in which both cameras saw the board, ascending."""
    return sorted(a.views.keys() & b.views.keys())


def place_cameras(
    cameras: Sequence[CameraViews], board: Board
) -> tuple[
    list[CameraViews],
    Floats[C, D4, D4],
    dict[Place, Floats[D4, D4]],
    dict[tuple[str, str], float],
]:
    """Return all cameras in the first one's frame: their views, of a board that looks alike when turned renumbered to agree;
    T_camera_world; T_world_board, shared views first, by frame; and by which median share of the board's distance common views
    disagree about a pair.

    Raises HandtrackError naming the groups of cameras that share no view.
    """
    pairs = permutations(range(len(cameras)), 2)
    edges = {(i, j): common_places(cameras[i], cameras[j]) for i, j in pairs}
    _require_connected(cameras, edges)
    turns = _turn_transforms(board)
    poses = [{place: v.pose for place, v in c.views.items()} for c in cameras]
    placed: dict[int, Floats] = {0: np.eye(4)}
    boards = dict(poses[0])
    renumbered = [*cameras]
    disagreement: dict[tuple[str, str], float] = {}
    while len(placed) < len(cameras):
        near, new = max(
            ((i, j) for i, j in edges if i in placed and j not in placed),
            key=lambda pair: (len(edges[pair]), -pair[1]),
        )
        common = edges[near, new]
        T_new_near, off = _agreed(
            [poses[new][p] for p in common], [poses[near][p] for p in common], turns
        )
        disagreement[cameras[near].name, cameras[new].name] = off
        placed[new] = T_new_near @ placed[near]
        expected = {place: placed[new] @ pose for place, pose in boards.items()}
        renumbered[new] = _renumbered(cameras[new], expected, turns, board)
        for place, view in renumbered[new].views.items():
            poses[new][place] = view.pose
            boards.setdefault(place, np.linalg.inv(placed[new]) @ view.pose)
    T_camera_world = np.stack([placed[i] for i in range(len(cameras))])
    return renumbered, T_camera_world, dict(sorted(boards.items())), disagreement


def frame_offset(
    a: dict[int, Floats[D4, D4]], b: dict[int, Floats[D4, D4]], board: Board
) -> int | None:
    """Return by how many frames the second camera seems to be late, None when no shift explains it.

    With frames rightly matched, all views agree on the cameras' places.

    Parameters
    ----------
    a, b
        T_camera_board by frame.
    """
    turns = _turn_transforms(board)
    found: dict[int, float] = {}
    for offset in range(-_MOST_OFFSET, _MOST_OFFSET + 1):
        frames = [frame for frame in a if frame + offset in b][:60]
        if len(frames) >= 5:
            news, nears = [b[f + offset] for f in frames], [a[f] for f in frames]
            found[offset] = _agreed(news, nears, turns)[1]
    best = min(found, key=lambda offset: found[offset], default=0)
    return best if best != 0 and found[best] < 0.3 * found.get(0, np.inf) else None


def _require_connected(
    cameras: Sequence[CameraViews], edges: dict[tuple[int, int], list[Place]]
) -> None:
    shared = np.zeros((len(cameras),) * 2, dtype=bool)
    for pair, common in edges.items():
        shared[pair] = bool(common)
    count, group = connected_components(shared, directed=False)
    if count > 1:
        names = [
            ", ".join(f"'{camera.name}'" for camera, g in zip(cameras, group) if g == one)
            for one in range(count)
        ]
        raise HandtrackError(
            f"the cameras fall into groups that share no view of the board: {' | '.join(names)}. "
            "Frames are matched by number (a video's frame, the last digits of a file's name). Show "
            "the board so that at least one camera of each group sees it together with one of "
            "another, and check that file numbers agree."
        )


def _turn_transforms(board: Board) -> list[Floats]:
    """Return T_board_turned (4, 4) of each way the board looks the same."""
    found = []
    for turn in board.turns:
        seen, real = board.points, board.points[turn]
        middle = board.points.mean(axis=0)
        rotation = turn_between(seen - middle, real - middle)
        found.append(_transform(rotation, middle - rotation @ middle))
    return found


def _agreed(news: list[Floats], nears: list[Floats], turns: list[Floats]) -> tuple[Floats, float]:
    """Return T_new_near on which most common views agree, and their median disagreement.

    Each view proposes one per way the board looks the same; wrong ones move with the board, the right
    ones agree.
    """
    proposals = np.stack(
        [[a @ turn @ np.linalg.inv(b) for turn in turns] for a, b in zip(news, nears, strict=True)]
    )  # (V, S, 4, 4)
    distance = float(np.median([np.linalg.norm(b[:3, 3]) for b in [*news, *nears]]))
    candidates = proposals.reshape(-1, 4, 4)
    apart = [
        float(np.median(_disagreements(one, proposals, distance).min(axis=1))) for one in candidates
    ]
    best = int(np.argmin(apart))
    return candidates[best], apart[best]


def _disagreements(pose: Floats, others: Floats, distance: float) -> Floats:
    """Return how far poses (..., 4, 4) are from one, as a share of the distance to the board."""
    angle = turned_by(pose[:3, :3], others[..., :3, :3])
    shift = np.linalg.norm(others[..., :3, 3] - pose[:3, 3], axis=-1) / distance
    return _TURN_M * angle + shift


def _renumbered(
    camera: CameraViews, expected: Mapping[Place, Floats], turns: list[Floats], board: Board
) -> CameraViews:
    """Return the camera's views numbered as the boards already placed are expected; poses are turned along."""
    views = dict[Place, BoardView]()
    for place, view in camera.views.items():
        there = expected.get(place)
        if there is not None:
            poses = view.pose @ np.stack(turns)
            distance = float(np.linalg.norm(there[:3, 3]))
            best = int(_disagreements(there, poses, distance).argmin())
            ids = np.argsort(board.turns[best])[view.ids]
            view = replace(view, ids=ids, pose=poses[best])
        views[place] = view
    return replace(camera, views=views)


# ---- what a calibration is worth, in numbers and plain words


_GRID = (8, 6)  # cells of the image in which corners are counted
_WORST = 3


def report_text(report: dict[str, Any]) -> str:
    """Return a calibration's report as lines for a terminal."""
    lines = [
        f"board {report['board']}; corners scatter by {report['sigma_px']:.3f} px in each direction",
        "",
        "camera          images  found  used   rms px   alone   covered  worst views",
    ]
    for camera in report["cameras"]:
        worst = sorted(camera["views"], key=lambda view: -view["rms_px"])[:_WORST]
        shown = ", ".join(f"{_short(view)} {view['rms_px']:.2f}" for view in worst)
        lines.append(
            f"{camera['name']:15s} {camera['images']:6d} {camera['found']:6d} {camera['used']:5d}  {camera['rms_px']:7.3f} "
            f"{camera['rms_alone_px']:7.3f}  {100 * camera['coverage']:6.0f} %  {shown}"
        )
    for camera in report["cameras"]:
        numbers = [
            f"{name} {value:.5g}" + (f" ±{std:.2g}" if std else " fixed")
            for (name, value), std in zip(camera["lens"].items(), camera["lens_std"].values())
        ]
        lines += [
            "",
            f"{camera['name']}: " + "  ".join(numbers[:4]),
            "   " + "  ".join(numbers[4:]),
            f"   skew that would fit: {camera['skew_px']:.2f} ±{camera['skew_std_px']:.2f} px (held at 0)",
        ]
    if report["pairs"]:
        lines += ["", "pair                            baseline mm   angle °   common views"]
    lines += [
        f"{' – '.join(pair['names']):30s}  {1e3 * pair['baseline_m']:11.2f} {pair['angle_deg']:9.2f} {pair['common_views']:14d}"
        for pair in report["pairs"]
    ]
    notes = [f"note: {note}" for note in (*report["contradictions"], *report["warnings"])]
    return "\n".join([*lines, *([""] if notes else []), *notes])


def camera_report(
    given: CameraViews,
    used: CameraViews,
    left: Sequence[Floats[N, D2]],
    rms_alone_px: float,
    lens: Floats[D9],
    lens_std: Floats[D9],
    skew: Floats[D2],
) -> dict[str, Any]:
    """Return one camera's lens and how well its views fit.

    `rms_px` is of all corners after the joint refinement, `rms_alone_px` of its lens fitted alone:
    much smaller means that cameras disagree. `coverage` is the share of the image's cells in which
    there is a corner. Of `lens_std`, 0 is held fixed; `skew_px` would fit, but is held at 0. A view
    that is `alone` is for the lens, not shared with other cameras.

    Parameters
    ----------
    left
        Residuals of each view.
    """
    views = used.views
    pixels = np.concatenate([view.pixels for view in views.values()])
    cell = np.floor(pixels / np.array(used.size) * _GRID).astype(int)
    covered = {tuple(c) for c in cell if (c >= 0).all() and (c < _GRID).all()}
    return {
        "name": used.name,
        "images": given.tried,
        "found": len(given.views),
        "used": len(views),
        "rms_px": _rms(np.concatenate(left)),
        "rms_alone_px": rms_alone_px,
        "coverage": len(covered) / (_GRID[0] * _GRID[1]),
        "lens": dict(zip(LENS, lens.tolist())),
        "lens_std": dict(zip(LENS, lens_std.tolist())),
        **dict(zip(("skew_px", "skew_std_px"), skew.tolist())),
        "views": [
            {
                "frame": frame,
                "source": view.source,
                "rms_px": _rms(off),
                "max_px": float(np.linalg.norm(off, axis=1).max()),
                "alone": bool(of_lens),
            }
            for ((of_lens, frame), view), off in zip(views.items(), left, strict=True)
        ],
    }


def pair_reports(
    rig: CameraRig, used: Sequence[CameraViews], disagreement: dict[tuple[str, str], float]
) -> Iterator[dict[str, Any]]:
    """Yield all pairs that share a view, or that placed a camera: their distance, and the angle between their directions."""
    for (a, b), (seen_a, seen_b) in zip(combinations(rig, 2), combinations(used, 2), strict=True):
        common = len(common_places(seen_a, seen_b))
        if common or {(a.name, b.name), (b.name, a.name)} & set(disagreement):
            turn = rotation_vector(b.rotation @ a.rotation.T)
            yield {
                "names": (a.name, b.name),
                "baseline_m": float(np.linalg.norm(a.centre - b.centre)),
                "angle_deg": float(np.rad2deg(np.linalg.norm(turn))),
                "common_views": common,
            }


def _rms(off: Floats) -> float:
    return float(np.sqrt((off**2).sum(axis=1).mean()))


def _short(view: dict[str, Any]) -> str:
    name = view["source"].replace("\\", "/").rsplit("/", 1)[-1]
    return name if name and ", frame" not in name else f"frame {view['frame']}"


def _camera_warnings(camera: dict[str, Any]) -> Iterator[str]:
    who = f"camera '{camera['name']}'"
    if camera["rms_px"] > max(3 * camera["rms_alone_px"], 1.0):
        yield (
            f"{who} fits by {camera['rms_alone_px']:.2f} px alone but by {camera['rms_px']:.2f} px together with "
            "the others: frames may not be synchronised, or a camera moved between views."
        )
        return  # what else the numbers say follows from that
    if camera["rms_px"] > 1.0:
        yield (
            f"{who} misses corners by {camera['rms_px']:.2f} px (below 0.5 is usual): blurred or moving "
            "boards, a board that is not flat, or a lens that needs more than k1 k2 p1 p2 k3."
        )
    if camera["used"] < 10:
        yield (f"{who} has {camera['used']} views; 15 or more, in different tilts, are better.")
    if camera["coverage"] < 0.5:
        yield (
            f"{who}: corners cover {100 * camera['coverage']:.0f} % of the image; its distortion is a guess elsewhere."
        )
    sure = camera["lens_std"]["fx"] / camera["lens"]["fx"]
    if sure > 0.01:
        yield (
            f"{who}: its focal length is known to {100 * sure:.1f} % only; tilt the board more (30° to 45°)."
        )
    if abs(camera["skew_px"]) > max(4 * camera["skew_std_px"], 1.0):
        yield (
            f"{who}: a skew of {camera['skew_px']:.2f} px would fit better, but skew is not modelled (OpenCV "
            "ignores it, and so would everything after). A warped board or print scaled unevenly looks the same."
        )
