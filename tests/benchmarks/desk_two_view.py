"""How far a track of desk_two_view is from marks set and outlines drawn by eye: pixels per landmark, overlap of the hand.

Run: python -m tests.benchmarks.desk_two_view POSES.npz [SESSION] [--json], or with `-` in place of the poses for the masks alone.
Without SESSION, whose masks are compared, it is the one found through HANDTRACK_DATA. With --json, the figures of all frames together.
"""

import json
import sys
from pathlib import Path

import cv2
import numpy as np

from handtrack import Camera, Session, TrackResult, read_npz
from handtrack.bench.measuring import data_folder
from handtrack.capture.masks.segmentation import mask_method_table
from handtrack.simulation.render import pixel_rays, render
from handtrack.tracking.frame.result import model_of

MARKS = Path(__file__).with_name("desk_two_view_marks.json")
OUTLINES = Path(__file__).with_name("desk_two_view_outlines.json")
_SUBPIXEL_BITS = 4


def read_marks() -> dict[int, dict[str, dict]]:
    """Return marks by frame and camera: landmark → (x, y, confidence), and `wrist_cut` → two points."""
    frames = json.loads(MARKS.read_text())["frames"]
    return {int(frame): views for frame, views in frames.items()}


def read_outlines() -> dict[int, dict[str, np.ndarray]]:
    """Return polygons (N, 2) [px] by frame and camera; the first and last point are the wrist cut."""
    frames = json.loads(OUTLINES.read_text())["frames"]
    return {
        int(frame): {camera: np.array(points) for camera, points in views.items()}
        for frame, views in frames.items()
    }


def drawn(polygon: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Return the pixels (H, W) bool within a polygon; size: width, height."""
    image = np.zeros(size[::-1], np.uint8)
    points = np.rint(polygon * 2**_SUBPIXEL_BITS).astype(np.int32)
    cv2.fillPoly(image, [points], 1, shift=_SUBPIXEL_BITS)
    return image > 0


def drawn_overlap(seen: np.ndarray, polygon: np.ndarray, known: np.ndarray | None = None) -> float:
    """Return the IoU of pixels (H, W) bool with the hand drawn by eye, both cut at the wrist; of `known` pixels only."""
    height, width = seen.shape
    ends, middle = polygon[[0, -1]].tolist(), polygon.mean(axis=0)
    counts = np.ones_like(seen) if known is None else known
    truth = hand_side(drawn(polygon, (width, height)) & counts, ends, middle)
    found = hand_side(seen & counts, ends, middle)
    return float((truth & found).sum() / (truth | found).sum())


def compare_masks(session: Session, known_only: bool = False) -> dict[tuple[int, str], float]:
    """Return the IoU of the session's masks with the outlines drawn by eye, by frame and camera.

    Pixels of which nobody knows count as background, or not at all: known_only.
    """
    found = {}
    for frame, views in read_outlines().items():
        for name, polygon in views.items():
            mask, unknown = session.mask(name, frame), session.view(name).unknown
            if mask is not None:
                known = mask != unknown
                hand = (mask > 0) & known
                found[frame, name] = drawn_overlap(hand, polygon, known if known_only else None)
    return found


def mask_figures(session: Session) -> dict[str, object]:
    """Return the masks' mean IoU with the outlines drawn by eye, and where they commit themselves; by their method's name."""
    masks = session.file.cameras[0].masks
    name = "files" if isinstance(masks, str | None) else mask_method_table(masks)["method"]
    return {
        f"{name}_iou{words}": float(np.mean(list(compare_masks(session, known_only).values())))
        for words, known_only in (("", False), ("_known", True))
    }


def hand_side(mask: np.ndarray, cut: list, inside: np.ndarray) -> np.ndarray:
    """Return the part of a mask on that side of the wrist cut where the point `inside` lies."""
    a, b = np.asarray(cut, dtype=float)
    v, u = np.mgrid[: mask.shape[0], : mask.shape[1]]
    normal = np.array([-(b - a)[1], (b - a)[0]])
    side = (u - a[0]) * normal[0] + (v - a[1]) * normal[1]
    return mask & (side * float((inside - a) @ normal) > 0)


def every_pixels_rays(camera: Camera) -> np.ndarray:
    """Return directions of all pixels (H, W, 3), between those of every second: undoing a lens takes long."""
    coarse = camera.scaled((camera.size[0] // 2, camera.size[1] // 2))
    return cv2.resize(pixel_rays(coarse), camera.size)


def compare(track: TrackResult, session: Session) -> dict[str, object]:
    """Return errors (pixels) of landmarks and overlaps (IoU) of the hand, of all frames together."""
    model = model_of(track)
    hand = model.ellipsoids["fine"]
    if model.has_forearm:
        hand = hand.subset(hand.bone != model.skeleton.bone("forearm"))
    rays = {camera.name: every_pixels_rays(camera) for camera in session.rig.cameras}
    errors, overlaps, outlined = [], [], []
    marked, drawn_by_eye = read_marks(), read_outlines()
    for result in track.frames():
        frame, bones = result.frame, model.bones(model.transform.solver_params(result.parameters))
        for name, polygon in drawn_by_eye.get(frame, {}).items():
            flesh = model.ellipsoids["fine"].posed(
                bones
            )  # with its forearm: both are cut at the wrist
            seen = render(session.rig[name], flesh, rays[name])[0] >= 0
            outlined.append(drawn_overlap(seen, polygon))
        views = marked.get(frame, {})
        for camera in session.rig.cameras:
            marks = dict(views.get(camera.name, {}))
            cut = marks.pop("wrist_cut", None)
            for name, (x, y, *_) in marks.items():
                seen = camera.project(result.joint_positions[track.joint_names.index(name)])
                errors.append(float(np.hypot(*(seen - (x, y)))))
            mask, unknown = session.mask(camera.name, frame), session.view(camera.name).unknown
            if cut is None or mask is None or not marks:
                continue
            middle = np.median([m[:2] for m in marks.values()], axis=0)
            observed = hand_side((mask > 0) & (mask != unknown), cut, middle)
            front, *_ = render(camera, hand.posed(bones), rays[camera.name])
            predicted = hand_side(front >= 0, cut, middle)
            overlaps.append((observed & predicted).sum() / max((observed | predicted).sum(), 1))
    return {
        "landmarks": len(errors),
        "median_px": float(np.median(errors)),
        "p90_px": float(np.percentile(errors, 90)),
        "within_20_px": float(np.mean(np.array(errors) <= 20)),
        "iou_mean": float(np.mean(overlaps)),
        "iou_median": float(np.median(overlaps)),
        "iou_least": float(np.min(overlaps)),
        "drawn_iou_mean": float(np.mean(outlined or [np.nan])),
        "drawn_iou_least": float(np.min(outlined or [np.nan])),
    }


def main() -> None:
    poses, *other = (word for word in sys.argv[1:] if word != "--json")
    session = Session.open(other[0] if other else data_folder() / "sessions" / "desk_two_view")
    figures = mask_figures(session) if poses == "-" else compare(read_npz(Path(poses)), session)
    print(json.dumps(figures))


if __name__ == "__main__":
    main()
