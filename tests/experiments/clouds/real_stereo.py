"""Benchmark: what the 2004 method loses on a real stereo hand, and whether level lines help disparity.

The hand's recording has no truth but joints that a detector saw in three colour cameras, triangulated: a hand fitted to them stands for
the truth where it is asked which points of a cloud are the hand's. Needs the shared test data (HANDTRACK_DATA).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from handtrack.arrays import D3, D21, Array, Bytes, Floats, H, N, P, W
from handtrack.bench.measuring import data_folder, recording
from handtrack.capture.clouds.disparity import StereoSettings, matches
from handtrack.capture.clouds.point_cloud import PointCloud
from handtrack.capture.images.raw_frames import demosaic, level_line_at
from handtrack.model.articulated import keypoint_names
from handtrack.model.kinematics import BonePoses
from handtrack.model.surfaces.metaballs import MetaballSurface
from handtrack.observation.observation import Keypoints, Observation
from handtrack.session.run import TrackingRun
from handtrack.tracking.frame.result import FrameResult
from handtrack.tracking.search.initialize import fit_keypoints
from handtrack.tracking.sequence import track_frames

NAME = "d405_real_stereo"
NEAR_M = 0.015
"""from the reference hand: joints of two detectors, and flesh of another hand than ours, differ by about half of it"""
_CROP_M = 0.1  # the paper's
_SIGMA_M = 0.005  # of a triangulated joint
_TURNS_DEG = (2.0, -1.5)  # of a pair's cameras about their axes, as hands mount them
WAYS: Mapping[str, tuple[tuple[int, ...], dict[str, bool]]] = {
    "as_the_paper": ((), {}),
    "without_rest": ((2,), {}),
    "without_arm": ((1,), {}),
    "hand_alone": ((1, 2), {}),
    "hand_alone_in_view": ((1, 2), {"whole_surface": False}),
    "hand_alone_in_view_robust": ((1, 2), {"whole_surface": False, "plain_sums": False}),
    "in_view_robust": ((), {"whole_surface": False, "plain_sums": False}),
}
"""which parts of the cloud are taken away by the fitted hand (see `Scene.parts`), and which traits of the method"""


@dataclass(frozen=True, eq=False)
class Scene:
    """The real hand's first frames, and a hand fitted to what a detector saw in each."""

    run: TrackingRun
    first: int
    start: Floats[P]
    frames: range
    joints: Mapping[int, Floats[D21, D3]]
    """the detector's, triangulated [m]"""
    hands: Mapping[int, BonePoses]
    """fitted to them"""

    @classmethod
    def of(cls, frames: int) -> Scene:
        """Return the scene, to be tracked by the 2004 method. Raises HandtrackError where the test data are absent."""
        run = TrackingRun.open(recording(NAME), {"model.fit_size": False, "method": "paper2004"})
        first, start = run.initial()
        wanted = range(first, first + frames)
        with np.load(data_folder() / "sessions" / NAME / "reference_dlt.npz") as file:
            found = dict(zip(file["frame"].tolist(), file["keypoints21"], strict=True))
        joints = {frame: found[frame] for frame in wanted if frame in found}
        hands = {
            frame: run.model.bones(
                fit_keypoints(run.model, Keypoints(keypoint_names(), places, _SIGMA_M))
            )
            for frame, places in joints.items()
        }
        return cls(run, first, start, wanted, joints, hands)

    @property
    def surface(self) -> MetaballSurface:
        """Return the model's surface."""
        return MetaballSurface.of(self.run.model)

    def parts(self, frame: int, points: Floats[N, D3]) -> Array[N]:
        """Return what each point is of: 0 the hand, 1 the arm behind its wrist, 2 anything else."""
        bones = self.hands[frame]
        behind = ((points - bones.position[0]) @ bones.rotation[0])[:, 1] < 0.0
        near = self.surface.distance(bones, points) < NEAR_M
        return np.where(near & ~behind, 0, np.where(behind, 1, 2))

    def cloud_near(self, frame: int) -> Floats[N, D3]:
        """Return the points within the paper's 10 cm of the fitted hand, world [m]."""
        cloud = self.run.observation(frame).cloud
        points = np.zeros((0, 3)) if cloud is None else cloud.points
        return points[self.surface.distance(self.hands[frame], points) < _CROP_M]

    def tracked(self, way: str) -> list[FrameResult]:
        """Return the frames tracked one of WAYS."""
        without, traits = WAYS[way]
        settings = replace(self.run.settings, traits=replace(self.run.settings.traits, **traits))

        def observe(frame: int, bones: BonePoses | None = None) -> Observation:
            seen = self.run.observation(frame, bones)
            if not without or seen.cloud is None or frame not in self.hands:
                return seen
            kept = ~np.isin(self.parts(frame, seen.cloud.points), without)
            return replace(seen, cloud=PointCloud(seen.cloud.points[kept]))

        tracker = replace(self.run.tracker, settings=settings)
        return list(track_frames(tracker, observe, self.first, self.start, self.frames))

    def errors_mm(self, found: Sequence[FrameResult]) -> Floats[N]:
        """Return each frame's median distance of the joints from the detector's [mm]."""
        pairs = [(r.keypoints21, self.joints[r.frame]) for r in found if r.frame in self.joints]
        apart = [np.linalg.norm(a - b, axis=1) for a, b in pairs if a is not None]
        return 1e3 * np.nanmedian(np.array(apart), axis=1)


def real_stereo(frames: int = 25) -> dict[str, float | int | str]:
    """Return all figures; frames: of the real hand."""
    return real_hand(frames) | level_lines()


def real_hand(frames: int) -> dict[str, float | int | str]:
    """Return what the cloud near the hand is made of, and errors of the 2004 method with causes taken away one by one."""
    scene = Scene.of(frames)
    figures: dict[str, float | int | str] = {"frames": frames}
    shares, off, counts = [], [], []
    for frame, bones in scene.hands.items():
        points = scene.cloud_near(frame)
        counts.append(len(points))
        shares.append(np.bincount(scene.parts(frame, points), minlength=3) / len(points))
        distance = scene.surface.distance(bones, points)
        off.append(distance[distance < NEAR_M])
    for name, share in zip(("hand", "arm", "rest"), np.mean(shares, axis=0), strict=True):
        figures[f"share_of_{name}_within_10cm"] = float(share)
    figures["points_within_10cm_median"] = float(np.median(counts))
    distance = 1e3 * np.concatenate(off)
    figures["hand_points_off_fitted_hand_median_mm"] = float(np.median(distance))
    fitted = [scene.run.model.keypoints21(bones) for bones in scene.hands.values()]
    apart = np.linalg.norm(np.array(fitted) - np.array(list(scene.joints.values())), axis=2)
    figures["fitted_hand_off_its_joints_median_mm"] = 1e3 * float(np.nanmedian(apart))
    for way in WAYS:
        error = scene.errors_mm(scene.tracked(way))
        figures[f"{way}_median_mm"] = float(np.median(error))
        figures[f"{way}_p90_mm"] = float(np.quantile(error, 0.9))
    return figures


def level_lines() -> dict[str, float | int | str]:
    """Return errors of disparity on pairs with truth: images as they are, cut to mosaics and made colour again, and turned and
    rectified back, each by both interpolations.
    """
    figures: dict[str, float | int | str] = {}
    ways = {"colour": lambda image, side: image}
    for method in ("bilinear", "level_line", "level_line_hue", "library"):
        ways[f"mosaic_{method}"] = lambda image, side, method=method: _seen_raw(image, method)
    for along in (False, True):
        ways[f"rectified_{'level_line' if along else 'bilinear'}"] = (
            lambda image, side, along=along: _turned_back(image, _TURNS_DEG[side], along)
        )
    for name, (left, right, truth) in truth_pairs().items():
        known = np.isfinite(truth)
        least, most = int(truth[known].min()) - 4, int(truth[known].max()) + 4
        for matcher in ("sgbm", "correlation"):
            settings = StereoSettings(method=matcher)
            for way, made in ways.items():
                found, _ = matches(made(left, 0), made(right, 1), least, most, settings)
                off = np.abs(found - truth)[known & np.isfinite(found)]
                label = f"{name}_{matcher}_{way}"
                figures[f"{label}_mean_below_2px"] = float(off[off < 2.0].mean())
                figures[f"{label}_within_1px"] = float((off <= 1.0).sum() / known.sum())
    return figures


def truth_pairs() -> dict[str, tuple[Bytes[H, W, D3], Bytes[H, W, D3], Floats[H, W]]]:
    """Return rectified pairs BGR by name, with the left image's true disparity [px], NaN where it is not known."""
    folder = data_folder() / "stereo_pairs_truth"
    with np.load(folder / "motorcycle_disp.npz") as file:
        motorcycle = file["arr_0"].astype(float)
    aloe = np.array(cv2.imread(str(folder / "aloeGT.png"), cv2.IMREAD_GRAYSCALE), float)
    motorcycle[~np.isfinite(motorcycle)] = np.nan
    aloe[aloe == 0] = np.nan
    files = {"motorcycle": ("left.png", "right.png"), "aloe": ("L.jpg", "R.jpg")}
    images = {
        name: [
            np.asarray(cv2.imread(str(folder / f"{name}{'_' if '.png' in end else ''}{end}")))
            for end in ends
        ]
        for name, ends in files.items()
    }
    truth = {"motorcycle": motorcycle, "aloe": aloe}
    return {name: (images[name][0], images[name][1], truth[name]) for name in files}


def _seen_raw(image: Bytes[H, W, D3], method: str) -> Bytes[H, W, D3]:
    """Return a picture as a sensor behind an RGGB filter has it, made colour again."""
    mosaic = image[..., 1].copy()
    mosaic[::2, ::2] = image[::2, ::2, 2]
    mosaic[1::2, 1::2] = image[1::2, 1::2, 0]
    return demosaic(mosaic, "RGGB", method)


def _turned_back(image: Bytes[H, W, D3], turn_deg: float, along: bool) -> Bytes[H, W, D3]:
    """Return a picture as rectification makes it of one that a turned camera took: read once more at real coordinates."""
    height, width = image.shape[:2]
    turn = cv2.getRotationMatrix2D(((width - 1) / 2, (height - 1) / 2), turn_deg, 1.0)
    border = cv2.BORDER_REPLICATE
    taken = cv2.warpAffine(
        image, turn, (width, height), flags=cv2.INTER_LANCZOS4, borderMode=border
    )
    v, u = np.mgrid[:height, :width].astype(np.float32)
    x, y = ((turn[i, 0] * u + turn[i, 1] * v + turn[i, 2]).astype(np.float32) for i in (0, 1))
    if along:
        return np.round(level_line_at(taken, x, y)).astype(np.uint8)
    return np.asarray(cv2.remap(taken, x, y, cv2.INTER_LINEAR, borderMode=border), np.uint8)
