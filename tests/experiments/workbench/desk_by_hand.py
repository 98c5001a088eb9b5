"""The workbench used by mouse and keys alone on desk_two_view, from no first pose to accepted frames; and fingers put right.

Run: python -m tests.experiments.workbench.desk_by_hand run|fingers FOLDER. It prints figures as JSON; FOLDER gets pictures, and the copy that is
worked on. Needs Chromium and HANDTRACK_DATA. Whoever sits before the page is played by the marks set by eye
(`desk_two_view_marks.json`): joints are dragged to where they say, and every mouse gesture and key is counted.
"""

from __future__ import annotations

import json
import shutil
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from handtrack.bench.measuring import data_folder
from handtrack.geometry.camera import CameraRig
from handtrack.session.session import Session
from handtrack_app.page.pins.grips import NEAR_JOINT_M
from handtrack_app.process.child import EnginePlan
from handtrack_app.workbench import Workbench
from tests.app.page.test_browser import PageUnderTest, browsing, stands
from tests.benchmarks.desk_two_view import read_marks
from tests.experiments.workbench.chromium import PROJECT

FIRST, LAST, OPEN = 212, 271, 223
"""the stretch: open hand, fist, open, fist; and a frame of it that shows the hand open"""
_LONG_S = 1500.0
FAR_PX = 8.0
_FINGERS = ("index", "middle", "ring")
_MOVED_M = 0.04


class Person:
    """Mouse and keys before the page, counted."""

    def __init__(self, bench: Workbench, view: PageUnderTest, rig: CameraRig, out: Path) -> None:
        self.bench, self.view, self.out = bench, view, out
        self.flat = {camera.name: camera.without_distortion() for camera in rig}
        self.rig = rig
        self.actions = self.drags = 0
        self.taken: dict[str, int] = {}

    # ---- gestures

    def key(self, name: str) -> None:
        self.actions += 1
        self.view.page.keyboard.press(name)

    def press(self, name: str) -> None:
        self.actions += 1
        self.view.press(name)

    def tab(self, name: str) -> None:
        self.actions += 1
        self.view.show_tab(name)

    def drag(self, start: np.ndarray, stop: np.ndarray) -> None:
        self.actions, self.drags = self.actions + 1, self.drags + 1
        self.view.drag((float(start[0]), float(start[1])), (float(stop[0]), float(stop[1])))

    def go(self, frame: int) -> None:
        """Click on the timeline, and step from there."""
        if self.bench.state.frame != frame:
            lanes = self.view.page.locator(".handtrack-timeline svg")
            self.until(lanes.bounding_box, "the lanes are there")  # they are sent anew
            box = lanes.bounding_box()
            strip = self.bench.layout.timeline
            place = strip.window.place(frame) / 1000 * box["width"]
            self.actions += 1
            self.view.page.mouse.click(box["x"] + place, box["y"] + 20)
            time.sleep(1.0)
        while (here := self.bench.state.frame) != frame:
            self.key("n" if here < frame else "b")
            self.until(lambda here=here: self.bench.state.frame != here, "a step")
        self.until(lambda: self.pose.frame == frame, f"frame {frame} shows")

    # ---- looking

    @property
    def pose(self) -> Any:
        pose = self.bench.stage.pose
        assert pose is not None
        return pose

    def until(self, test: Callable[[], Any], what: str, timeout: float = 60.0) -> None:
        """Wait; the browser goes on meanwhile."""
        until = time.monotonic() + timeout
        while not test():
            assert time.monotonic() < until, f"{what}: not within {timeout:g} s"
            self.view.page.wait_for_timeout(30)

    def idle(self, begun: str) -> float:
        """Wait until a job has begun and ended; return how long it took [s]."""
        progress = self.bench.layout.tracking
        began = time.monotonic()
        self.until(lambda: progress.progress.state != "idle", f"{begun} begins")
        self.until(lambda: progress.progress.state == "idle", f"{begun} ends", _LONG_S)
        return time.monotonic() - began

    def through(self, camera: str) -> None:
        names = [card.name for card in self.bench.stage.session.cameras]  # type: ignore[union-attr]
        views = self.bench.stage.looking.views
        (client,) = self.bench.server.get_clients()
        view = views.of(client)
        if view is None or view.card.name != camera:
            self.key(str(names.index(camera) + 1))
        self.until(lambda: (v := views.of(client)) and v.card.name == camera, "it looks through")
        self.until(lambda: stands(self.bench), "it stands in the camera")
        self.still()

    def still(self) -> None:
        """Wait until the page's own camera has come to rest."""
        before = None
        for _ in range(100):
            now = self.on_page(self.pose.middle).round(2).tolist()
            if now == before:
                return
            before = now
            self.view.page.wait_for_timeout(150)

    def picture(self, name: str) -> None:
        self.view.page.screenshot(path=self.out / f"{name}.png")

    def joint(self, name: str) -> np.ndarray:
        return self.pose.joints[self.bench.stage.session.joint_names.index(name)]  # type: ignore[union-attr]

    def on_page(self, point: np.ndarray) -> np.ndarray:
        return np.array(self.view.page.evaluate(PROJECT, ["/hand", point.tolist()]))

    # ---- marks

    def marks(self, frame: int, camera: str, only: str = "") -> dict[str, np.ndarray]:
        """Return marks of joints in a camera's undistorted picture [px]."""
        given = {k: v for k, v in read_marks()[frame].get(camera, {}).items() if k != "wrist_cut"}
        return {
            joint: self.rig[camera].undistort_points(np.array([mark[:2]], float))[0]
            for joint, mark in given.items()
            if joint.startswith(only)
        }

    def off(self, frame: int, camera: str, only: str = "") -> dict[str, float]:
        """Return how far the joints of the pose shown are from their marks [px]."""
        return {
            joint: float(np.linalg.norm(self.flat[camera].project(self.joint(joint)[None])[0] - at))
            for joint, at in self.marks(frame, camera, only).items()
        }

    def all_off(self, frame: int, only: str = "") -> list[float]:
        return [v for camera in self.flat for v in self.off(frame, camera, only).values()]

    def pull(self, frame: int, camera: str, joint: str) -> bool:
        """Drag a joint to its mark in a camera; return whether it was that joint that was taken hold of."""
        self.through(camera)
        mark, place = self.marks(frame, camera)[joint], self.joint(joint)
        flat = self.flat[camera]
        depth = float((place - flat.centre) @ flat.rotation[2])
        ray = flat.rays(mark[None])[0]
        aim = flat.centre + ray * depth / float(ray @ flat.rotation[2])
        grip = self.seen_place(joint, flat.centre)
        if grip is None:
            return False
        start = self.on_page(grip)
        if np.linalg.norm(grip - place) > NEAR_JOINT_M:  # the segment is held, not the joint
            aim = aim + grip - place
        pins = {(pin.camera, pin.words): pin.pixel for pin in self.pose.pins}
        self.drag(start, self.on_page(aim))
        self.view.page.wait_for_timeout(600)
        new = [pin for pin in self.pose.pins if pins.get((pin.camera, pin.words)) != pin.pixel]
        if len(new) == 1 and new[0].words.split()[0] == joint.split("_", maxsplit=1)[0]:
            return True
        print(f"frame {frame} {camera}: wanted {joint}, held {[p.words for p in new]}", flush=True)
        if new:
            self.key("Backspace")
            self.view.page.wait_for_timeout(600)
        return False

    def seen_place(self, joint: str, eye: np.ndarray) -> np.ndarray | None:
        """Return a place at a joint, or on the segment before it, where nothing else of the hand stands before it; None for none."""
        session, pose, finger = self.bench.stage.session, self.pose, joint.split("_", maxsplit=1)[0]
        assert session is not None
        names = session.joint_names
        place, before = self.joint(joint), pose.joints[max(names.index(joint) - 1, 0)]
        for share in (0.15, 0.3, 0.5, 0.0, 0.7) if joint.endswith("_tip") else (0.0, 0.2, 0.4, 0.6):
            grip = place + share * (before - place)
            way = grip - eye
            turned = np.einsum("eji,ej->ei", pose.rotation, eye - pose.centre) / session.radii
            along = np.einsum("eji,j->ei", pose.rotation, way) / session.radii
            a, b = (along**2).sum(1), (along * turned).sum(1)
            root = b * b - a * ((turned**2).sum(1) - 1)
            meets = np.where(root > 0, (-b - np.sqrt(np.maximum(root, 0))) / a, np.inf)
            front = session.bone_names[int(session.ellipsoid_bone[int(np.argmin(meets))])]
            if np.isfinite(meets).any() and front.startswith(finger):
                return grip
        return None

    def put_right(self, frame: int, most: int, only: str = "") -> int:
        """Drag what is farthest from its mark until all are near, or so many drags are done; return the drags.

        only: the finger whose middle joint and tip are dragged; else all joints.
        """
        missed, count = set[tuple[str, str]](), self.drags
        while self.drags < count + most:
            far = [
                (off, camera, joint)
                for camera in self.flat
                for joint, off in self.off(frame, camera, only).items()
                if off > FAR_PX and (camera, joint) not in missed and not (only and "_mcp" in joint)
            ]
            if not far:
                break
            _, camera, joint = max(far)
            if not self.pull(frame, camera, joint):
                missed.add((camera, joint))
        return self.drags - count


def run(person: Person) -> dict[str, Any]:
    """From no first pose to all frames of the stretch accepted."""
    bench, view, figures = person.bench, person.view, dict[str, Any]()
    began = time.monotonic()
    begin(person, figures)
    person.picture("tracked")
    review = bench.layout.review
    figures["worth_a_look"] = [f"{s.first}–{s.last} {s.brief}" for s in review.stretches]
    before_corrections = person.actions
    corrected = {}
    for frame in [f for f in read_marks() if FIRST <= f <= LAST]:
        count = person.actions
        person.go(frame)
        before = person.all_off(frame)
        started = time.monotonic()
        drags = person.put_right(frame, 6)
        person.view.page.mouse.move(640, 300)
        person.key("Shift+Y")
        person.until(lambda frame=frame: frame in (review.strip.accepted if review.strip else ()), "accepted")  # fmt: skip
        person.picture(f"corrected_{frame}")
        corrected[frame] = {
            "actions": person.actions - count,
            "drags": drags,
            "seconds": time.monotonic() - started,
            "median_px": [float(np.median(before)), float(np.median(person.all_off(frame)))],
            "most_px": [max(before), max(person.all_off(frame))],
        }
        print(frame, corrected[frame], flush=True)
    figures["corrected"] = corrected
    figures["actions_to_correct"] = person.actions - before_corrections
    view.show_tab("Track")
    person.press("Refine")
    figures["refined_s"] = person.idle("refining")
    accept_all(person, range(FIRST, LAST + 1), figures)
    person.key("Shift+V")
    person.picture("accepted")
    figures["actions"] = person.actions
    figures["seconds"] = time.monotonic() - began
    return figures


def accept_all(person: Person, wanted: range, figures: dict[str, Any]) -> None:
    """Accept the good frames at once, and the others by key, a stretch at a time."""
    review, before = person.bench.layout.review, person.actions
    known = len(review.strip.accepted) if review.strip else 0
    person.tab("Review")
    person.actions += 1
    person.view.row("Accept").get_by_text("All confident", exact=True).click()
    person.until(lambda: review.strip is not None and len(review.strip.accepted) > known, "good ones")  # fmt: skip
    figures["good"] = len(review.strip.accepted) if review.strip else 0
    while (strip := review.strip) is not None and not set(wanted) <= strip.accepted:
        left = len(strip.accepted)
        if not review.stretches:
            break
        person.key("Shift+Z")
        person.view.page.wait_for_timeout(500)
        person.key("Shift+Y")
        person.until(lambda left=left: review.strip is not None and len(review.strip.accepted) > left, "accepted")  # fmt: skip
    figures["actions_to_review"] = person.actions - before
    figures["accepted"] = len(review.strip.accepted.intersection(wanted)) if review.strip else 0
    figures["of_frames"] = len(wanted)


def begin(person: Person, figures: dict[str, Any]) -> None:
    """Find the hand, and track the stretch."""
    view = person.view
    person.go(OPEN)
    view.page.get_by_role("button", name="this frame", exact=True).wait_for()
    person.press("this frame")
    figures["found_s"] = person.idle("the search")
    person.until(lambda: person.pose.origin == "found", "it is taken")
    person.picture("found")
    person.press("Save as first-frame pose")
    person.tab("Track")
    person.go(FIRST)
    person.press("from here")
    person.go(LAST)
    person.press("to here")
    person.press("Track range")
    figures["tracked_s"] = person.idle("tracking")
    figures["actions_to_track"] = person.actions


def fingers(person: Person) -> dict[str, Any]:
    """Turn fingers 4 cm wrong at their knuckles, and put them right again by drags in the cameras' pictures."""
    bench, view, found = person.bench, person.view, dict[str, Any]()
    if not (strip := bench.layout.timeline.strip) or strip.status[OPEN] < 0:
        begin(person, found)
    for frame in (214, 225, 252):
        person.go(frame)
        for finger in _FINGERS:
            marks = person.all_off(frame, finger)
            if len(marks) < 4:
                continue
            stood = {j: person.joint(j).copy() for j in _joints(finger)}
            length = np.linalg.norm(stood[f"{finger}_tip"] - stood[f"{finger}_mcp"])
            turned = 2 * np.arcsin(min(_MOVED_M / 2 / length, 1.0))
            bent = bench.state.value_of(f"{finger}_mcp_flex")
            bench.page.edit_pose(
                {f"{finger}_mcp_flex": bent + (turned if bent + turned < 1.5 else -turned)}, "wrong"
            )
            tip = f"{finger}_tip"
            person.until(lambda tip=tip, stood=stood: np.linalg.norm(person.joint(tip) - stood[tip]) > 0.03, "moved")  # fmt: skip
            moved = float(np.linalg.norm(person.joint(tip) - stood[tip]))
            wrong = max(person.all_off(frame, finger))
            person.through("cam0")
            began, count = time.monotonic(), person.actions
            drags = person.put_right(frame, 3, finger)
            view.page.wait_for_timeout(300)
            apart = [
                float(np.linalg.norm(flat.project(person.joint(j)[None])[0] - flat.project(p[None])[0]))
                for flat in person.flat.values() for j, p in stood.items()
            ]  # fmt: skip
            off = [
                v
                for c in person.flat
                for j, v in person.off(frame, c, finger).items()
                if "_mcp" not in j
            ]
            knuckle = [
                v for c in person.flat for v in person.off(frame, c, f"{finger}_mcp").values()
            ]
            person.picture(f"finger_{frame}_{finger}")
            found[f"{frame} {finger}"] = {
                "moved_mm": 1e3 * moved, "marks": len(off), "tracked_px": max(marks), "wrong_px": wrong, "right_px": max(off), "knuckle_px": max(knuckle, default=0.0),
                "from_before_px": max(apart), "drags": drags, "actions": person.actions - count,
                "seconds": time.monotonic() - began,
            }  # fmt: skip
            print(frame, finger, found[f"{frame} {finger}"], flush=True)
            while bench.state.frame == frame and person.pose.origin in ("pinned", "set"):
                version = bench.state.version
                view.page.keyboard.press("Control+z")
                person.until(lambda v=version: bench.state.version > v, "undone")
                view.page.wait_for_timeout(400)
    return found


def _joints(finger: str) -> tuple[str, ...]:
    return tuple(f"{finger}_{part}" for part in ("mcp", "pip", "dip", "tip"))


def main(what: str, folder: str) -> None:
    out = Path(folder)
    out.mkdir(parents=True, exist_ok=True)
    copy = out / "desk"
    if not (what == "fingers" and copy.exists()):  # what is tracked already serves again
        shutil.rmtree(copy, ignore_errors=True)
        shutil.copytree(data_folder() / "sessions" / "desk_two_view", copy)
        for path in (copy, *copy.rglob("*")):
            path.chmod(0o755)
        (copy / "init.json").unlink()
    rig = Session.open(copy).rig
    bench = Workbench(copy, port=0, plan=EnginePlan(copy))
    with browsing(bench, dpr=0.5, size=(1280, 800)) as view:
        person = Person(bench, view, rig, out)
        person.until(lambda: bench.layout.tracking.progress.state == "idle", "ready")
        person.view.page.wait_for_timeout(3000)
        print(json.dumps({"run": run, "fingers": fingers}[what](person), indent=1), flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
