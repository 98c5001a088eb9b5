"""Draws docs/figures/papers_*.png. Run: python -m docs.pictures.papers_figures FOLDER; it tracks first, which takes minutes.

The shared test data (HANDTRACK_DATA) are needed. Recordings shown are rendered, and no person is in them; of the real one nothing is
drawn but joints and models.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np

from docs.pictures.dance_picture import fig7
from docs.pictures.model_pictures import segments
from docs.pictures.plotting import pyplot, saved, tight
from handtrack.arrays import D3, Array, H, W
from handtrack.bench.measuring import recording
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.surfaces.surface_mesh import model_mesh
from handtrack.observation.observation import ImageKeypoints
from handtrack.session.run import TrackingRun
from handtrack.simulation.render import pixel_rays, render
from handtrack.terms.images.depth_picture import depth_picture
from handtrack.tracking.frame.result import FrameResult
from handtrack.tracking.sequence import track_frames
from tests.experiments import papers
from tests.experiments.clouds import poor_clouds, real_stereo
from tests.experiments.jumps import dance_appearance, real_person
from tests.experiments.silhouettes import binary_fist
from tests.experiments.silhouettes.balancing import Balancing

PAPER, OURS = "#D55E00", "#0072B2"
_STEREO_SHOWN, _STEREO_CROP = (0, 6, 12, 18), (slice(70, 530), slice(160, 620))
_DANCE_SHOWN = (0, 8, 16, 24)
_PERSON_ROWS = slice(75, 350)  # of a picture of 270 columns
_PART_M = 0.05  # second difference of depth from which two parts lie one behind the other
_REAL_SHOWN = 12
_PARTS = (("hand", "#56B4E9"), ("arm", "#E69F00"), ("anything else", "#999999"))


def draw_errors(folder: Path) -> None:
    """Draw the fist's and the poor clouds' errors, frame by frame."""
    plt = pyplot()
    figure, axes = plt.subplots(1, 3, figsize=(11, 3.2))
    for axis, cameras in zip(axes, (2, 6)):
        for label, colour, settings in (
            ("2007's method", PAPER, {"method": "paper2007"}),
            ("ours", OURS, papers.OURS),
        ):
            axis.plot(papers.fist_errors(cameras, settings), color=colour, label=label)
        axis.axvspan(binary_fist.FIST.start, binary_fist.FIST.stop, color="0.92")
        axis.set(title=f"fist, masks of {cameras} cameras", ylabel="mean joint error [mm]")
    truth, seen = poor_clouds.scene(0)
    for way, colour, label in (
        ("hand26_paper2004", "#E69F00", "2004's, whole hand"),
        ("glove9_paper2004", PAPER, "2004's, glove9"),
        ("hand26_ours", OURS, "ours"),
    ):
        error = poor_clouds.palm_mm(
            way, poor_clouds.track(way, truth, seen, papers.POOR), truth, papers.POOR
        )
        axes[2].plot(error, color=colour, label=label)
    axes[2].set(title="poor clouds of 320 x 240", ylabel="palm's error [mm]")
    for axis in axes:
        axis.set(xlabel="frame", ylim=(0, None))
        axis.legend(frameon=False, fontsize=8)
    saved(tight(figure), folder / "papers_errors.png")


def draw_stereo(folder: Path) -> None:
    """Draw the hand of the synthetic stereo recording with the model's outline: one row a way to track."""
    session = recording("webxr_stereo_768")
    rows = [_stereo_row(session, papers.STEREO[way]) for way in ("paper2004", "ours_cloud_alone")]
    _write(folder / "papers_stereo.png", np.vstack(rows))


def _stereo_row(session, values: Mapping[str, object]) -> Array[H, W, D3]:
    run = TrackingRun.open(session, {"model.fit_size": False, **values})
    first, start = run.initial()
    frames = range(first, max(_STEREO_SHOWN) + 1)
    found = list(track_frames(run.tracker, run.observation, first, start, frames))
    camera = session.view("left").camera
    rays, tiles = pixel_rays(camera), []
    for frame in _STEREO_SHOWN:
        params = run.model.transform.solver_params(found[frame - first].parameters)
        flesh = run.model.flesh["metaballs"].posed(run.model.bones(params))
        inside = (render(camera, flesh, rays)[1] > 0).astype(np.uint8)
        image = session.image("left", frame).copy()
        lines, _ = cv2.findContours(inside, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
        cv2.drawContours(image, lines, -1, (0, 160, 255), 3)
        tiles.append(cv2.resize(image[_STEREO_CROP], (240, 240), interpolation=cv2.INTER_AREA))
    return np.hstack(tiles)


def draw_real_stereo(folder: Path) -> None:
    """Draw the cloud of a real hand by what it is of, and where the 2004 method ends with and without the arm; no image."""
    plt = pyplot()
    scene = real_stereo.Scene.of(_REAL_SHOWN + 1)
    frame = scene.first + _REAL_SHOWN
    hand = scene.hands[frame]
    points = scene.cloud_near(frame)
    part = scene.parts(frame, points)
    figure, axes = plt.subplots(1, 2, figsize=(7, 4.2), sharey=True, layout="constrained")
    for axis, (way, title) in zip(
        axes, (("as_the_paper", "all points within 10 cm"), ("without_arm", "without the arm's"))
    ):
        shown = np.ones(len(part), bool) if way == "as_the_paper" else part != 1
        local = 1e3 * (points - hand.position[0]) @ hand.rotation[0]
        for number, (label, colour) in enumerate(_PARTS):
            own = local[shown & (part == number)]
            axis.scatter(own[:, 0], own[:, 1], s=3, color=colour, label=label)
        found = scene.tracked(way)[_REAL_SHOWN]
        bones = scene.run.model.bones(scene.run.model.transform.solver_params(found.parameters))
        for posed, colour, label in ((hand, "0.2", "fitted to a detector's joints"), (bones, PAPER, "2004's method")):  # fmt: skip
            lines = 1e3 * (segments(scene.run.model, posed) - hand.position[0]) @ hand.rotation[0]
            for n, line in enumerate(lines):
                axis.plot(line[:, 0], line[:, 1], color=colour, lw=1.6, label=label if n == 0 else None)  # fmt: skip
        axis.set(title=title, aspect="equal", xlabel="across the palm [mm]")
    axes[0].set(ylabel="along the hand [mm]")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside right upper", frameon=False, markerscale=4)  # fmt: skip
    saved(figure, folder / "papers_real_stereo.png")


def draw_dance(folder: Path) -> None:
    """Draw the dance by the 2003 paper's method, as its Fig. 7."""
    what = dance_appearance.dance(max(_DANCE_SHOWN) + 1)
    found = dance_appearance.track(what, {"method": "paper2003"})
    _write(folder / "papers_dance.png", fig7(what, found, _DANCE_SHOWN))


def draw_person(folder: Path) -> None:
    """Draw the models that follow a real person on black: of the person nothing but the joints that a detector finds."""
    with tempfile.TemporaryDirectory() as name:
        place = Path(name)
        (place / "all").mkdir()
        known = real_person.fitted_by_all(place / "all")
        rows = [person_row(known, known.run.model, known.refined)]
        for way, settings in real_person.SHOWN.items():
            (place / way).mkdir()
            found = real_person.follow(place / way, known, settings, max(_DANCE_SHOWN) + 1)
            rows.append(person_row(known, found.run.model, found.results))
    _write(folder / "papers_person.png", np.vstack(rows))


def person_row(
    known: Balancing, model: ArticulatedModel, results: Sequence[FrameResult]
) -> Array[H, W, D3]:
    """Return the model in some frames on black, its parts outlined, with the joints that the detector finds as green dots."""
    tiles = []
    for frame in _DANCE_SHOWN:
        seen = [
            one
            for one in known.run.observation(frame).keypoints
            if isinstance(one, ImageKeypoints) and one.camera.name == real_person.CAMERA
        ]
        bones = model.bones(model.transform.solver_params(results[frame].parameters))
        face, depth = depth_picture(model_mesh(model), bones, seen[0].camera).in_image()
        inside = face >= 0
        near = np.where(inside, depth, 1e3)
        edge = inside & (np.abs(cv2.Laplacian(near, cv2.CV_64F)) > _PART_M)
        picture = np.zeros((*face.shape, 3), np.uint8)
        picture[inside], picture[edge] = 110, 255
        for one in seen:
            for x, y in (
                one.pixels[np.isfinite(one.pixels).all(axis=1)].round().astype(int).tolist()
            ):
                cv2.circle(picture, (x, y), 14, (80, 220, 80), -1)
        height, width = face.shape
        small = cv2.resize(picture, (270, 270 * height // width), interpolation=cv2.INTER_AREA)
        tiles.append(small[_PERSON_ROWS])
    return np.hstack(tiles)


def _write(path: Path, image: Array[H, W, D3]) -> None:
    """Write an image BGR with a palette: a quarter of the bytes."""
    pyplot()  # matplotlib brings Pillow
    from PIL import Image

    Image.fromarray(image[..., ::-1]).quantize(64).save(path, optimize=True)


if __name__ == "__main__":
    for draw in (draw_errors, draw_stereo, draw_real_stereo, draw_dance, draw_person):
        draw(Path(sys.argv[1]))
