"""The 2D joints that `handtrack new` is given, of one hand or one person in all cameras."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from handtrack.arrays import D3, Floats, N
from handtrack.capture.calibration.formats.given_rig import GivenRig
from handtrack.capture.calibration.formats.settle import LensView
from handtrack.capture.images.openpose import LAYOUTS, is_body
from handtrack.capture.joints.body_points import layout_of
from handtrack.capture.joints.given_joints import GivenJoints, in_pixels, write_joints
from handtrack.capture.joints.joint_names import JOINTS
from handtrack.capture.joints.people import people
from handtrack.capture.joints.read_joints import read_joints
from handtrack.capture.joints.subject import BODY, HAND, Subject
from handtrack.errors import HandtrackError, unknown_name
from handtrack.files.toml_text import read_toml
from handtrack_app.commands.new_session.sources import Recorded
from handtrack_app.commands.terminal.progress import say


@dataclass(frozen=True)
class CameraJoints:
    """The points of a hand or a person in one camera's images."""

    where: str
    family: str
    frames: Mapping[int, Floats[N, D3]]
    side: str
    """right or left; empty where the file does not say it, and of bodies."""
    is_share: bool
    named_layout: str | None
    """the session's keypoint_layout; None: hand_left or hand_right."""
    what: str
    """whose points they are, in words."""
    unknown: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    def layout(self, side: str) -> str:
        """Return the session's keypoint_layout."""
        return self.named_layout or f"hand_{side}"

    def pixels(self, size: tuple[int, int]) -> dict[int, Floats[N, D3]]:
        """Return the points by frame, [px] of images of a size."""
        if not self.is_share:
            return dict(self.frames)
        return {frame: in_pixels(points, size) for frame, points in self.frames.items()}

    def write(self, folder: Path, side: str, size: tuple[int, int]) -> None:
        """Write a file a frame to a new folder, and say what was taken. size: of the camera's images [px]."""
        write_joints(self.pixels(size), self.layout(side), folder)
        left = ", ".join(self.unknown[:8])
        kind = "body" if is_body(LAYOUTS[self.layout(side)]) else "hand"
        more = f"; not a {kind}'s, so left out: {left}" if left else ""
        say(f"{self.where}: {self.family}, {self.what} in {len(self.frames)} frames{more}.")
        for note in self.notes:
            say(f"note: {note}")


@dataclass(frozen=True)
class GivenSubject:
    """What is tracked, and where cameras saw its joints."""

    kind: Subject
    joints: Mapping[str, CameraJoints]

    @property
    def side(self) -> str | None:
        """Which hand it is, where a file says it."""
        return next((found.side for found in self.joints.values() if found.side), None)


def joint_regions(
    subject: GivenSubject, rig: GivenRig
) -> dict[str, tuple[float, float, float, float]]:
    """Return x, y, width, height [px] around all joints of each camera, half as much again on each side, inside its images."""
    sizes = {str(camera.name): camera.size for camera in rig.cameras}
    regions = {}
    for name, joints in subject.joints.items():
        size = sizes.get(name)
        if size is None:
            continue
        points = np.concatenate(list(joints.pixels(size).values()))
        points = points[np.isfinite(points[:, :2]).all(axis=1) & (points[:, 2] > 0), :2]
        if not len(points):
            continue
        low, high = points.min(axis=0), points.max(axis=0)
        margin = 0.5 * float((high - low).max())
        low, high = np.maximum(low - margin, 0), np.minimum(high + margin, np.array(size) - 1.0)
        regions[name] = (*low.tolist(), *(high - low + 1).tolist())
    return regions


def subject_in_views(subject: GivenSubject, views: Mapping[str, LensView]) -> GivenSubject:
    """Return the subject with joints of bent images where the pinhole views of these show them."""
    if not views:
        return subject
    bent = {view.camera for view in views.values()}
    found = {name: joints for name, joints in subject.joints.items() if name not in bent}
    for name, seen in views.items():
        joints = subject.joints.get(seen.camera)
        if joints is not None:
            frames = {f: _in_view(p, seen) for f, p in joints.pixels(seen.lens.size).items()}
            found[name] = replace(joints, frames=frames, is_share=False)
    return replace(subject, joints=found)


def _in_view(points: Floats[N, D3], seen: LensView) -> Floats[N, D3]:
    moved = points.copy()
    moved[:, :2] = seen.view.pixels(seen.lens.rays(points[:, :2]))
    inside = ((moved[:, :2] > -0.5) & (moved[:, :2] < np.array(seen.view.size) - 0.5)).all(axis=1)
    moved[~inside] = [np.nan, np.nan, 0.0]
    return moved


@dataclass(frozen=True)
class Wished:
    """What the user said of joints."""

    side: str | None = None
    kind: Subject | None = None
    """by the model that was named"""
    layout: str | None = None
    person: int | None = None
    """from 1"""
    names: Mapping[str, str] = field(default_factory=dict)
    """our joints of a file's own points"""
    likely_layout: str | None = None
    """as a project's settings say; it decides what joints leave open"""


def given_subject(recorded: Mapping[str, Recorded], wished: Wished) -> GivenSubject:
    """Return what is tracked, with its joints by camera. Raises HandtrackError where that is open, or cameras differ in it."""
    if wished.layout is not None and wished.layout not in LAYOUTS:
        raise unknown_name("layout of joints", wished.layout, tuple(LAYOUTS), "--layout")
    given = {
        name: (f"--keypoints {name}={cam.keypoints}", cam.keypoints)
        for name, cam in recorded.items()
        if cam.keypoints is not None
    }
    read = {n: (w, read_joints(text, w, wished.names, n)) for n, (w, text) in given.items()}
    kind = _kind(wished, read)
    _check_wished(wished, kind, read)
    found = {
        name: _person(one, where, wished) if kind is BODY else _hand(one, where, wished.side)
        for name, (where, one) in read.items()
    }
    sides = {joints.side: joints for joints in found.values() if joints.side}
    if len(sides) > 1:
        first, second = sides.values()
        raise HandtrackError(
            f"{second.where}: a {second.side} hand, but {first.where} has a {first.side} one; say which with --side."
        )
    return GivenSubject(kind, found)


def names_of_table(path: Path) -> dict[str, str]:
    """Return our joints by a file's own names, from a table of lines such as `index_tip = "D2_tip"`; empty texts say nothing.

    Raises HandtrackError for a key that is no joint of a hand, and for two joints of one name.
    """
    names: dict[str, str] = {}
    for joint, theirs in read_toml(path, "a table of names").items():
        if joint not in JOINTS:
            raise unknown_name("joint", joint, JOINTS, str(path))
        if not isinstance(theirs, str) or theirs in names:
            raise HandtrackError(
                f"{path}: {joint} = {theirs!r}; expected the name of one of the file's points, each at most once."
            )
        if theirs:
            names[theirs] = joint
    return names


def table_to_fill_in(points: Sequence[str]) -> str:
    """Return a table of names without names, with a file's points beside it."""
    lines = [f"# Points of the file: {', '.join(points)}", "# Leave what it lacks empty."]
    return "\n".join([*lines, *(f'{joint} = ""' for joint in JOINTS)]) + "\n"


def _kind(wished: Wished, read: Mapping[str, tuple[str, GivenJoints]]) -> Subject:
    """Return whether a hand or a body is tracked: as the user says, else what the files have alone."""
    if wished.kind is not None:
        return wished.kind
    if wished.layout is not None:
        return BODY if is_body(LAYOUTS[wished.layout]) else HAND
    if wished.side is not None:
        return HAND
    if wished.person is not None:
        return BODY
    by_kind = {
        HAND: [where for where, one in read.values() if one.has_hand or one.bodies is None],
        BODY: [where for where, one in read.values() if one.bodies is not None],
    }
    if by_kind[HAND] and by_kind[BODY]:
        first = by_kind[BODY][0]
        others = "" if first in by_kind[HAND] else f", and {by_kind[HAND][0]} hands"
        raise HandtrackError(
            f"{first} has bodies{others or ' and hands'}; say what is to be tracked: --model body34 for the body, --model hand26 "
            "for the hand (or --side right)."
        )
    return BODY if by_kind[BODY] else HAND


def _check_wished(wished: Wished, kind: Subject, read: Mapping[str, object]) -> None:
    """Raise HandtrackError for words that do not belong to what is tracked, or to joints that are not given."""
    for option, value in (("--layout", wished.layout), ("--person", wished.person)):
        if value is not None and not read:
            raise HandtrackError(f"{option} {value} is about joints, but no --keypoints are given.")
    if kind is HAND and wished.person is not None:
        raise HandtrackError(
            f"--person {wished.person} is about bodies; a hand is chosen with --side."
        )
    if wished.layout is not None and is_body(LAYOUTS[wished.layout]) != (kind is BODY):
        raise HandtrackError(
            f"--layout {wished.layout} is not of a {kind.word}, which is to be tracked."
        )


def _hand(given: GivenJoints, where: str, side: str | None) -> CameraJoints:
    chosen, frames = given.hand(side, where)
    return CameraJoints(
        where, given.family, frames, chosen, given.is_share, given.layout, "a hand", given.unknown, given.notes
    )  # fmt: skip


def _person(given: GivenJoints, where: str, wished: Wished) -> CameraJoints:
    bodies = given.bodies
    if bodies is None:
        raise HandtrackError(f"{where}: no body in any frame.")
    layout = layout_of(bodies, wished.layout, where, wished.likely_layout)
    everybody = people(bodies.frames)
    number = wished.person or 1
    if number > len(everybody):
        raise HandtrackError(
            f"--person {number}: {where} has {_people(len(everybody))}; expected at most {len(everybody)}."
        )
    what = f"a body ({layout})"
    if len(everybody) > 1:
        who = "the tallest who stays" if wished.person is None else f"person {number}"
        others = ", ".join(str(len(p)) for p in everybody[:4] if p is not everybody[number - 1])
        what += f", {who}"
        note = f"{where}: {len(everybody)} people; others are in {others} frames (--person chooses one)."
    else:
        note = ""
    return CameraJoints(
        where, given.family, everybody[number - 1], "", bodies.is_share, layout, what, bodies.unknown, (note,) if note else ()
    )  # fmt: skip


def _people(count: int) -> str:
    return "one person" if count == 1 else f"{count} people"
