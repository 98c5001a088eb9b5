"""The pins of a frame as the page draws them."""

from __future__ import annotations

import numpy as np

from handtrack.model.kinematics import BonePoses
from handtrack.terms.keypoints import pinned_places
from handtrack_app.engine.document import Document
from handtrack_app.protocol.snapshots import PinCard


def pin_cards(document: Document, frame: int, bones: BonePoses) -> tuple[PinCard, ...]:
    """Return the pins of a frame beside the pose of these bones; those of places that the model lacks are left out."""
    model, session = document.model, document.run.session
    names = model.joint_names, model.skeleton.bone_names
    pins = [pin for pin in session.pins.of(frame) if pin.is_on(*names)]
    if not pins:
        return ()
    places = bones.to_world(*pinned_places(model, pins))
    found = []
    for n, pin in enumerate(pins):
        place = places[n]
        camera = session.rig[pin.camera].without_distortion()
        ray = camera.rays(np.array([pin.pixel]))[0]
        meant = camera.centre + ray * max(float((place - camera.centre) @ ray), 0.0)
        off = float(np.linalg.norm(camera.project(places[n : n + 1])[0] - pin.pixel))
        x, y, z = map(float, np.asarray(place))
        i, j, k = map(float, np.asarray(meant))
        words = words_of(pin.joint or pin.bone)
        found.append(PinCard(pin.camera, words, pin.pixel, (x, y, z), (i, j, k), off))
    return tuple(found)


def words_of(name: str) -> str:
    """Return a joint or bone in words."""
    return name.replace("_", " ")
