"""The bundled recording: somebody else's hand, textured, filmed by noisy cameras, cut out raggedly.

Write it anew: python -m tests.experiments.another_hand MAKEHUMAN FOLDER. MAKEHUMAN: the git folder of a copy of MakeHuman's repository (CC0).
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from pathlib import Path

import av
import cv2
import numpy as np
from scipy.spatial import KDTree

from handtrack import Camera
from handtrack.arrays import Array, Floats
from handtrack.model.kinematics import BonePoses
from handtrack.model.part_mesh import PartMesh, vertex_normals
from handtrack.simulation.simulate import simulated_rig
from tests.experiments.honesty import motions
from tests.experiments.honesty.meshes import HandMesh
from tests.experiments.honesty.people import as_person, somebody
from tests.experiments.honesty.recordings import FPS, about, describe, moved
from tests.experiments.mean_hand.makehuman import Base, Recipe
from tests.experiments.scenes.textured_mesh import Pattern, cluttered_background, textured_picture

FRAMES, SIZE, SEED = 100, (640, 480), 1
WHO = Recipe(
    "male_young_minmuscle_averageweight_asian",
    (
        ("macrodetails/asian-male-young", 1.0),
        ("macrodetails/universal-male-young-minmuscle-averageweight", 1.0),
    ),
)
"""nobody of whom the mean hand was made"""
_ARM_M = 0.30
_SKIN, _MOTTLED = np.array([205.0, 150, 120]), 0.25
_DESK = np.array([200.0, 195, 190])
_QUALITY = "20"
"""of H.264: of the noise about a third is left"""
_NOISE = 3.0
"""[grey levels] of the cameras' sensors"""
_EDGES_PX = ((1.0, 3.0), (1.5, 12.0))
"""how far a mask's outline is off, and over how many pixels alike"""
_LASTS = 0.8
"""correlation of these errors from frame to frame"""


@dataclass
class Fraying:
    """A segmentation's errors: alike along the outline, and from frame to frame."""

    rng: np.random.Generator
    fields: list[Floats] | None = None

    def __call__(self, mask: Array) -> Array:
        new = [cv2.GaussianBlur(self.rng.normal(size=mask.shape), (0, 0), far) for _, far in _EDGES_PX]  # fmt: skip
        new = [field / field.std() for field in new]
        if self.fields is not None:
            new = [_LASTS * a + np.sqrt(1 - _LASTS**2) * b for a, b in zip(self.fields, new, strict=True)]  # fmt: skip
        self.fields = new
        error = sum(px * field for (px, _), field in zip(_EDGES_PX, new, strict=True))
        signed = cv2.distanceTransform(mask, cv2.DIST_L2, 5) - cv2.distanceTransform(255 - mask, cv2.DIST_L2, 5)  # fmt: skip
        return np.where(signed + error > 0, 255, 0).astype(np.uint8)


def write_recording(folder: Path, makehuman: Path) -> None:
    """Write the session: videos, ragged masks, calibration, truth, and a first pose's points with noise."""
    rng = np.random.default_rng(SEED)
    rest = as_person(Base.read(makehuman).hand(WHO, _ARM_M), somebody(rng))
    hand = moved(rest, motions.moving("fist", FRAMES, rng), "fist", rng)
    rig = simulated_rig(3, SIZE, 0.5)
    pattern = Pattern.random(1, rng, 0.02)
    pattern = replace(pattern, base=_SKIN[None], swing=_MOTTLED * pattern.swing)
    folder.mkdir(parents=True)
    for camera in rig:
        (folder / "masks" / camera.name).mkdir(parents=True)
        room = (0.25 * cluttered_background(SIZE, rng) + 0.75 * _DESK).astype(np.uint8)
        fray = Fraying(rng)
        video = av.open(str(folder / f"{camera.name}.mp4"), "w")
        stream = video.add_stream("libx264", rate=int(FPS), options={"crf": _QUALITY})
        stream.width, stream.height = SIZE
        for frame, vertices in enumerate(hand.vertices):
            image, share = _picture(camera, rest, vertices, pattern, room)
            mask = fray(np.where(share > 0.5, 255, 0).astype(np.uint8))
            file = f"{folder}/masks/{camera.name}/{frame:06d}.png"
            cv2.imwrite(file, mask, [cv2.IMWRITE_PNG_COMPRESSION, 9, cv2.IMWRITE_PNG_BILEVEL, 1])
            noisy = image + rng.normal(scale=_NOISE, size=image.shape)
            pixels = np.clip(noisy, 0, 255).astype(np.uint8)
            video.mux(stream.encode(av.VideoFrame.from_ndarray(pixels)))
        video.mux(stream.encode())
        video.close()
    describe(folder, rig, hand.keypoints, about(hand.keypoints[0], rng))


def _picture(
    camera: Camera, rest: HandMesh, vertices: Floats, pattern: Pattern, room: Array
) -> tuple[Array, Array]:
    """Return what a camera sees, and the share of each pixel that is hand: the skin's pattern stays where it is on the hand."""
    normals = vertex_normals(vertices, rest.triangles)
    mesh = PartMesh(np.zeros(len(vertices), int), vertices, normals, rest.triangles)
    still = BonePoses(np.zeros(3), np.eye(3)[None], np.zeros((1, 3)))
    near = KDTree(vertices)

    def paint(bone, points):
        far, at = near.query(points, 3)
        share = 1.0 / (far + 1e-6)
        own = rest.vertices[at] * share[..., None]
        return pattern(bone, own.sum(axis=1) / share.sum(axis=1, keepdims=True))

    return textured_picture(camera, mesh, still, paint, room)


if __name__ == "__main__":
    write_recording(Path(sys.argv[2]), Path(sys.argv[1]))
