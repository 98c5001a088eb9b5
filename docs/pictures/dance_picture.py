"""Draw the dance as the 2003 paper's Fig. 7: images, the model over them, and the pose from above.

Run: python -m docs.pictures.dance_picture FILE.png; it tracks first, which takes minutes.
"""

from __future__ import annotations

import sys
from pathlib import Path

import cv2
import numpy as np

from handtrack.arrays import D3, Array, Floats, H, Ints, W
from handtrack.geometry.camera import Camera
from handtrack.model.kinematics import BonePoses
from handtrack.model.surfaces.surface_mesh import model_mesh
from handtrack.terms.images.depth_picture import depth_picture
from tests.experiments.jumps.dance_appearance import WAYS, Dance, DanceTrack, dance, track
from tests.experiments.scenes.textured_mesh import textured_picture

SHOWN = (0, 20, 40, 60, 80, 99)
"""frames in the picture"""
_CROP = (slice(40, 470), slice(200, 440))
_SIZE = (160, 286)  # of one picture of a row, as it is saved
_ABOVE_PX = 300
_PLAIN = np.array([150.0, 160.0, 175.0])
_OUTLINE = (255, 255, 255)


def fig7(what: Dance, found: DanceTrack, shown: tuple[int, ...] = SHOWN) -> Array[H, W, D3]:
    """Return the picture uint8 BGR: four rows, the last one the truth from above for comparison."""
    columns = []
    by_frame = {result.frame: result for result in found.results}
    for frame in shown:
        params = what.model.transform.solver_params(by_frame[frame].parameters)
        bones = what.model.bones(params)
        image = what.images[frame]
        front = [
            cv2.resize(p[_CROP], _SIZE, interpolation=cv2.INTER_AREA)
            for p in (image, overlay(what, bones, image))
        ]
        above = [seen_from_above(what, b) for b in (bones, what.bones(frame))]
        columns.append(np.vstack([*front, *above]))
    return np.hstack(columns)


def overlay(what: Dance, bones: BonePoses, image: Array[H, W, D3]) -> Array[H, W, D3]:
    """Return the image with the model's parts outlined, what is around them darkened."""
    face, depth = depth_picture(model_mesh(what.model), bones, what.camera).in_image()
    inside = face >= 0
    drawn = np.where(inside[..., None], image, image // 3)
    near = np.where(inside, depth, 1e3)
    step = np.abs(cv2.Laplacian(near, cv2.CV_64F)) > 0.25
    drawn[step & inside] = _OUTLINE
    return drawn.astype(np.uint8)


def seen_from_above(what: Dance, bones: BonePoses) -> Array[H, W, D3]:
    """Return a plain picture of the model by a camera that looks straight down on it."""
    middle = bones.position[0]
    rotation = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
    matrix = np.array([[420.0, 0, _ABOVE_PX / 2], [0, 420, _ABOVE_PX / 2], [0, 0, 1]])
    place = np.array([middle[0], middle[1] + 2.6, middle[2]])
    camera = Camera(
        "above", (_ABOVE_PX, _ABOVE_PX), matrix, np.zeros(5), rotation, -rotation @ place
    )
    white = np.full((_ABOVE_PX, _ABOVE_PX, 3), 255, np.uint8)
    picture, _ = textured_picture(camera, model_mesh(what.model), bones, _plain, white)
    return cv2.resize(picture, (_SIZE[0], _SIZE[0]), interpolation=cv2.INTER_AREA)


def _plain(bone: Ints, local: Floats) -> Floats:
    return np.tile(_PLAIN, (len(bone), 1))


if __name__ == "__main__":
    scene = dance()
    cv2.imwrite(str(Path(sys.argv[1])), fig7(scene, track(scene, WAYS["memory_8"])))
