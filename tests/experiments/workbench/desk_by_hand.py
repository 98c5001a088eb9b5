"""Nine fingers of real frames turned 4 cm wrong, and put right by drags in the cameras' pictures: `python -m tests.experiments.workbench.desk_by_hand`.

The engine runs on threads. What a drag takes hold of is what the page takes at that pixel, and its places come as the page sends them.
Whoever drags is played by the marks set by eye: what is farthest from its mark, in either camera, is dragged there.
Data: desk_two_view of the shared test data (HANDTRACK_DATA).
"""

from __future__ import annotations

import json
import shutil
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from handtrack.arrays import D2, D3, Floats
from handtrack.bench.measuring import data_folder
from handtrack.geometry.camera import Camera
from handtrack.session.session import Session
from handtrack_app.page.scene.grips import hold_at, place_of
from handtrack_app.protocol import (
    GuessesSnapshot,
    Hold,
    Notice,
    PoseSnapshot,
    SessionSnapshot,
)
from tests.app.desk import EngineInThreads, Listener, working
from tests.app.waiting import eventually
from tests.benchmarks.desk_two_view import read_marks

_FRAMES, _FINGERS = (214, 225, 252), ("index", "middle", "ring")
_FIRST, _STOP, _OPEN = 212, 254, 223
"""what is tracked, from a frame that shows the hand open"""
_MOVED_M, _NEAR_PX, _MOST_DRAGS, _PLACES = 0.04, 8.0, 3, 8
_ALONG = (0.0, 0.15, 0.3, 0.5, 0.7)
"""shares of the way from a joint to the one before it, where it is tried to take hold"""
_JOB_S = 1200.0


class Person:
    """Drags in the cameras' pictures."""

    def __init__(self, worker: EngineInThreads, listener: Listener, rig: Any) -> None:
        self.worker, self.listener, self.version = worker, listener, 0
        self.rig, self.flat = rig, {c.name: c.without_distortion() for c in rig}

    @property
    def session(self) -> SessionSnapshot:
        """As the page knows it: a detected forearm changes the model."""
        return next(s for s in reversed(self.listener.seen) if isinstance(s, SessionSnapshot))

    @property
    def pose(self) -> PoseSnapshot:
        """What the page shows."""
        return next(s for s in reversed(self.listener.seen) if isinstance(s, PoseSnapshot))

    def edit(self, name: str, *given: Any, **named: Any) -> None:
        """Have an edit of the frame shown done."""
        self.version += 1
        getattr(self.worker.engine, name)(self.pose.frame, *given, version=self.version, **named)
        eventually(lambda: self.pose.version >= self.version, f"{name} is answered")

    def go(self, frame: int) -> None:
        self.worker.engine.show_frame(frame)
        eventually(lambda: self.pose.frame == frame, f"frame {frame} shows")

    def joint(self, name: str) -> Floats[D3]:
        return self.pose.joints[self.session.joint_names.index(name)]

    def marks(self, camera: str, finger: str) -> dict[str, Floats[D2]]:
        """Return the marks of a finger's joints beyond its knuckle in a camera's undistorted picture [px]."""
        marked = read_marks()[self.pose.frame].get(camera, {})
        return {
            joint: self.rig[camera].undistort_points(np.array([mark[:2]], float))[0]
            for joint, mark in marked.items()
            if joint.startswith(finger) and "_mcp" not in joint
        }

    def errors(self, finger: str) -> dict[tuple[str, str], float]:
        """Return how far a finger's joints are from their marks [px], by camera and joint."""
        return {
            (camera, joint): _apart(flat.project(self.joint(joint)[None])[0], mark)
            for camera, flat in self.flat.items()
            for joint, mark in self.marks(camera, finger).items()
        }

    def put_right(self, finger: str) -> list[str]:
        """Drag what is farthest from its mark until all are near; return what was dragged."""
        done, out_of_reach = list[str](), set[tuple[str, str]]()
        while len(done) < _MOST_DRAGS:
            far = {at: px for at, px in self.errors(finger).items() if px > _NEAR_PX}
            far = {at: px for at, px in far.items() if at not in out_of_reach}
            if not far:
                break
            camera, joint = max(far, key=lambda at: far[at])
            hold = self._drag(camera, joint)
            if hold is None:
                out_of_reach.add((camera, joint))
            else:
                done.append(f"{hold.words} in {camera}")
        return done

    def _drag(self, camera: str, joint: str) -> Hold | None:
        """Drag a joint to its mark, by itself or by its segment; return what was held, None where it is hidden."""
        card = next(one for one in self.session.cameras if one.name == camera)
        flat, place = self.flat[camera], self.joint(joint)
        before = self.joint(self.session.joint_names[self.session.joint_names.index(joint) - 1])
        grips = ((place + share * (before - place)) for share in _ALONG)
        held = next((h for grip in grips if (h := self._held(card, grip, joint))), None)
        if held is None:
            return None
        grip = place_of(held, self.session, self.pose)
        aim = (
            _as_deep(flat, self.marks(camera, joint.split("_", maxsplit=1)[0])[joint], place)
            + grip
            - place
        )
        start, stop = flat.project(np.array([grip, aim]))
        for share in np.linspace(0, 1, _PLACES + 1)[1:]:
            x, y = (start + share * (stop - start)).tolist()
            self.edit("set_pin", camera, (x, y), hold=held, tag=f"drag {self.version // _PLACES}")
        return held

    def _held(self, card: Camera, grip: Floats[D3], joint: str) -> Hold | None:
        """Return what the page takes hold of where a point is seen; None where that is no part of the joint's finger."""
        session, pose = self.session, self.pose
        way = np.einsum("nji,j->ni", pose.rotation, grip - card.centre) / session.radii
        begin = np.einsum("nji,nj->ni", pose.rotation, card.centre - pose.centre) / session.radii
        a, b, c = (way**2).sum(1), (way * begin).sum(1), (begin**2).sum(1) - 1
        root = b * b - a * c
        meets = np.where(root > 0, (-b - np.sqrt(np.maximum(root, 0))) / a, np.inf)
        first = int(np.argmin(meets))
        at = card.centre + meets[first] * (grip - card.centre)
        hold = hold_at(session, pose, card, first, at) if np.isfinite(meets[first]) else None
        finger = joint.split("_", maxsplit=1)[0]
        return hold if hold and (hold.joint or hold.bone).startswith(finger) else None


def _apart(a: Floats[D2], b: Floats[D2]) -> float:
    return float(np.linalg.norm(a - b))


def _as_deep(camera: Camera, pixel: Floats[D2], other: Floats[D3]) -> Floats[D3]:
    """Return the point that a pixel shows as deep as another."""
    (ray,), ahead = camera.rays(pixel[None]), camera.rotation[2]
    return camera.centre + ray * float((other - camera.centre) @ ahead) / float(ray @ ahead)


def fingers(person: Person) -> dict[str, Any]:
    """Turn fingers wrong at their knuckles, and put each right; return what it took."""
    figures = dict[str, Any]()
    for frame in _FRAMES:
        person.go(frame)
        tracked = person.pose.values
        for finger in _FINGERS:
            stood = max(person.errors(finger).values())
            tip, before = f"{finger}_tip", person.joint(f"{finger}_tip").copy()
            length = np.linalg.norm(before - person.joint(f"{finger}_mcp"))
            turned = 2 * np.arcsin(min(_MOVED_M / 2 / length, 1.0))
            name = f"{finger}_mcp_flex"
            bent = tracked[person.session.parameter_names.index(name)]
            wrong = bent + (turned if bent + turned < 1.5 else -turned)
            values = dict(zip(person.session.parameter_names, tracked, strict=True)) | {name: wrong}
            person.edit("set_pose", tuple(float(v) for v in values.values()))
            row = {
                "moved_mm": 1e3 * float(np.linalg.norm(person.joint(tip) - before)),
                "tracked_px": stood,
                "wrong_px": max(person.errors(finger).values()),
                "drags": person.put_right(finger),
                "right_px": max(person.errors(finger).values()),
            }
            figures[f"{frame} {finger}"] = row
            print(frame, finger, json.dumps(row), flush=True)
            person.edit("drop_pins", None)
            person.edit("forget_pose")
    return figures


def main() -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "desk"
        shutil.copytree(data_folder() / "sessions" / "desk_two_view", folder)
        for path in (folder, *folder.rglob("*")):
            path.chmod(0o755)
        (folder / "init.json").unlink()
        worker, listener = working(folder)
        try:
            person = Person(worker, listener, Session.open(folder).rig)
            person.go(_OPEN)
            worker.engine.find_hand(_OPEN)
            listener.wait(GuessesSnapshot, timeout=_JOB_S)
            person.edit("take_guess", 0)  # as the page does
            worker.engine.track(_FIRST, _STOP, _OPEN)
            listener.wait(Notice, lambda one: one.title == "Tracking finished", timeout=_JOB_S)
            eventually(lambda: not worker.busy, "tracking ends", _JOB_S)
            figures = fingers(person)
        finally:
            worker.stop()
    within = [len(one["drags"]) for one in figures.values() if one["right_px"] <= _NEAR_PX]
    print(f"{len(within)} of {len(figures)} right, drags {sorted(within)}")


if __name__ == "__main__":
    main()
