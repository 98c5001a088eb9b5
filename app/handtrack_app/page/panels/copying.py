"""Copy, paste and mirror in the tab Pose: of the whole pose, or of the finger or limb whose sliders are open."""

from __future__ import annotations

import html
import json
import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import partial
from typing import TYPE_CHECKING
from urllib.parse import quote

import numpy as np
import viser

from handtrack.arrays import D3, Floats, S
from handtrack.files.atomic import replace_text
from handtrack.files.user_folder import user_data_folder
from handtrack.geometry.rotation import rotation_matrix, rotation_vector
from handtrack_app.page.page import Page, put
from handtrack_app.page.panels.pose_words import group_of
from handtrack_app.page.scene.looking import Looking
from handtrack_app.protocol.snapshots import (
    LibrarySnapshot,
    PoseName,
    PoseSnapshot,
    SessionSnapshot,
)

if TYPE_CHECKING:
    from handtrack_app.viser_internals import KeyModifier

COPY, PASTE, MIRROR = "Copy", "Paste", "Mirror"
_NOTHING = "Nothing was copied yet that fits here: show a pose and press Copy first."
_HINT = (
    "Copies the pose you see; pastes its joints into the frame shown, also of another recording. From a left to a right hand it is "
    "mirrored by itself. 'Mirror': left and right, as you see them, change places. Alt C, Alt V, Alt M; with its place: Alt P."
)
_PART_HINT = "Of what has its sliders open: its joints alone, also into another {part}, or where the whole is. Alt Shift C, Alt Shift V."


@dataclass
class CopyPanel:
    """Handles of the rows."""

    page: Page
    looking: Looking
    group: str = ""
    """whose sliders are open"""
    session: SessionSnapshot | None = None
    pose: PoseSnapshot | None = None

    def __post_init__(self) -> None:
        """Add the rows where the page builds now, and the keys."""
        gui, page = self.page.gui, self.page
        with gui.add_folder("Copy, paste, mirror", expand_by_default=False):
            self.whole = gui.add_button_group("Hand", (COPY, PASTE, MIRROR), hint=_HINT)
            self.part = page.buttons(
                "Finger", (COPY, PASTE), lambda name: acts[name](self.group), _PART_HINT
            )
            self.line = gui.add_html("")
        page.words.on(self.whole, label="{Kind}")
        page.words.on(self.part, hint=_PART_HINT)
        acts = {COPY: self.copy, PASTE: self.paste}
        page.on(
            self.whole,
            lambda client, act: self.mirror(client) if act == MIRROR else acts[act](ALL),
        )
        keys: tuple[tuple[str, str | None, KeyModifier | None, Callable[[], None]], ...] = (
            ("Copy the pose", "C", "alt", partial(self.copy, ALL)),
            ("Paste the pose that was copied", "V", "alt", partial(self.paste, ALL)),
            ("Paste it, where it was", "P", "alt", partial(self.paste, ALL, with_place=True)),
            ("Copy the open {part}", "C", "alt+shift", lambda: self.copy(self.group)),
            ("Paste into the open {part}", "V", "alt+shift", lambda: self.paste(self.group)),
        )  # fmt: skip
        for words, key, modifier, act in keys:
            page.key(words, key, act, modifier)
        page.key(
            "Mirror the pose: left and right change places", "M", self.mirror, "alt", by_page=True
        )

    def fit(self, session: SessionSnapshot) -> None:
        """Take a session's model."""
        self.session = session
        self._say()

    def open(self, group: str) -> None:
        """The sliders of a group are open."""
        self.group = group
        put(self.part, label=group)

    def copy(self, part: str) -> None:
        """Copy the pose that is seen, or a group of it."""
        session, pose = self.session, self.pose
        if session is None or pose is None or len(pose.values) != len(session.parameter_names):
            return
        values = dict(zip(session.parameter_names, pose.values.tolist(), strict=True))
        whole = CopiedPose(ALL, session.folder, pose.frame, values)
        own = values if part == ALL else whole.pasted(session.parameter_names, part)
        save_copied(CopiedPose(part, session.folder, pose.frame, own))
        self._say()

    def paste(self, part: str, with_place: bool = False) -> None:
        """Give what was copied to the frame shown, or to a group of it."""
        copied, state = read_copied(), self.page.state
        changes = {} if copied is None else copied.pasted(state.names, part, with_place)
        if changes:
            self.page.edit_pose(changes, "Paste")
        else:
            self.page.notify("info", "Nothing to paste", _NOTHING)
        self._say()

    def mirror(self, client: viser.ClientHandle | None) -> None:
        """Let left and right of the pose change places, as a page sees them."""
        state, pose, axes = self.page.state, self.pose, self.looking.view_axes(client)
        if axes is None or pose is None or not state.values:
            return
        values = np.array(state.values)
        self.page.edit_pose(mirrored(state.names, values, axes[:, 0], pose.middle), "Mirror")

    def _say(self) -> None:
        """Say what was copied."""
        copied, words = read_copied(), ""
        if copied is not None and self.session is not None:
            what = self.session.kind.capitalize() if copied.part == ALL else copied.part
            words = f"Copied: {html.escape(what)} of frame {copied.frame}"
            if copied.session != self.session.folder:
                words += ", another recording"
            words = f"<div style='padding:0 .9em .3em;font-size:.9em;opacity:.75'>{words}</div>"
        put(self.line, content=words)


# ---- A pose, or a part of one, that was copied: kept as a file of the user's, so that another recording's page can
# paste it


ALL = "all"
"""what is copied of a whole pose; else one of the groups of sliders"""
_FILE = "copied_pose.json"
_MOST_M = 100.0  # nobody's hand is further from the world's origin; angles are far smaller


@dataclass(frozen=True)
class CopiedPose:
    """Joint parameters by name, and where they are from."""

    part: str
    """`ALL`, or a group: a finger, a limb"""
    session: str
    """the folder that the frame is of"""
    frame: int
    parameters: dict[str, float]
    """[m, rad]"""

    def pasted(self, names: Sequence[str], part: str, with_place: bool = False) -> dict[str, float]:
        """Return what it gives to a model of these parameters; empty where it has nothing that fits.

        part: `ALL`, or the group that is to get it: of a whole pose the same group's, of another finger's or the other side's
        limb joint by joint. with_place: where the hand is and how it is turned, too.
        """
        if part == ALL:
            return {
                name: value
                for name, value in self.parameters.items()
                if name in names and (with_place or not name.startswith("root_"))
            }
        source = part if self.part == ALL else self.part
        own = {name: value for name, value in self.parameters.items() if group_of(name) == source}
        given = {name.replace(_stem(source), _stem(part), 1): value for name, value in own.items()}
        return {n: value for n, value in given.items() if n in names and group_of(n) == part}


def _stem(group: str) -> str:
    """Return what the parameters of a group begin with; of a body's limbs, their side."""
    return group.lower().split()[0] + "_"


def save_copied(copied: CopiedPose) -> None:
    """Write it to the user's folder. Raises OSError."""
    user_data_folder().mkdir(parents=True, exist_ok=True)
    replace_text(user_data_folder() / _FILE, json.dumps({"format": 1, **asdict(copied)}) + "\n")


def read_copied() -> CopiedPose | None:
    """Return what was copied last, on whatever page; None where nothing was, or the file is not to be read."""
    with suppress(OSError, ValueError, TypeError, KeyError, AttributeError):
        said = json.loads((user_data_folder() / _FILE).read_text("utf-8"))
        values = {str(name): float(value) for name, value in said["parameters"].items()}
        if all(math.isfinite(v) and abs(v) < _MOST_M for v in values.values()):
            return CopiedPose(str(said["part"]), str(said["session"]), int(said["frame"]), values)
    return None


# ---- A pose as in a mirror: left and right, as they are seen, change places


_ACROSS = np.diag([-1.0, 1.0, 1.0])
"""of a hand's and a body's own axes: x goes from side to side"""
_SIGNED = ("lean", "twist")
"""motions of the trunk to one side; limbs have them away from the middle, alike on both sides"""


def mirrored(
    names: Sequence[str], values: Floats[S], right: Floats[D3], middle: Floats[D3]
) -> dict[str, float]:
    """Return joint parameters by name of the mirror image in the plane through a point.

    values: [m, rad]. right: unit vector to the viewer's right, world; the plane is upright to it. middle: world [m]. A hand keeps
    its fingers' values, which on the other side's hand would be the image's; of a body the limbs change sides.
    """
    mirror = np.eye(3) - 2.0 * np.outer(right, right)
    root = dict(zip(names, values.tolist(), strict=True))
    place = middle + mirror @ (values[:3] - middle)
    turn = rotation_vector(mirror @ rotation_matrix(values[3:6]) @ _ACROSS)
    found = dict(zip(names[:6], [*place.tolist(), *turn.tolist()], strict=True))
    for name in names[6:]:
        side, _, rest = name.partition("_")
        other = {"left": "right", "right": "left"}.get(side)
        if other is not None:
            found[f"{other}_{rest}"] = root[name]
        else:
            trunk = side in ("spine", "neck") and name.endswith(_SIGNED)
            found[name] = -root[name] if trunk else root[name]
    return found


# ---- The pose library by picture: a window of one page's with a button for each pose


_GRID = """
.mantine-Modal-content:has(.handtrack-poses) { flex: 0 0 min(46em, 94vw) !important; }
*:has(> div > .handtrack-poses) { display: grid; grid-template-columns: repeat(9, minmax(0, 1fr)); gap: 4px; }
div:has(> .handtrack-poses) ~ div > div { padding-inline: 0 !important; }
*:has(> div > .handtrack-poses) > div:is(:has(.handtrack-wide), :last-child) { grid-column: 1 / -1; }
div:has(> .handtrack-poses) ~ div { padding: 0 !important; }
div:has(> .handtrack-poses) ~ div:not(:last-child) .mantine-Button-root { height: 92px !important; padding: 0 !important;
  background-color: rgba(128, 128, 128, .16); background-repeat: no-repeat; background-position: 50% 4px; background-size: min(66px, 96%) auto;
  color: inherit; border: 0; }
div:has(> .handtrack-poses) ~ div:not(:last-child) .mantine-Button-root:hover { background-color: rgba(128, 128, 128, .4); }
div:has(> .handtrack-poses) ~ div:not(:last-child) .mantine-Button-inner { align-items: flex-end; padding-bottom: 3px; }
div:has(> .handtrack-poses) ~ div:not(:last-child) .mantine-Button-label { height: auto; font-size: .9em; }
"""
_GROUP = "<div class='handtrack-wide' style='font-weight:600;padding-top:.3em'>{}</div>"
_PICTURE = 'div:has(> .handtrack-poses) ~ div:nth-child({place}) .mantine-Button-root {{ background-image: url("data:image/svg+xml,{svg}"); }}'


def show_library(page: Page, take: Callable[[str], None], library: LibrarySnapshot) -> None:
    """Show the pictures that came to the page that asked for them. take: a pose was chosen, by its name."""
    client = page.server.get_clients().get(library.client_id)
    if client is None or not library.poses:
        return
    rows: list[str | PoseName] = []
    for group in dict.fromkeys(pose.group for pose in library.poses):
        rows += [group, *(pose for pose in library.poses if pose.group == group)]

    def choose(name: str) -> None:
        page.close_dialog(client)
        take(name)

    with page.dialog(client, "Choose a pose"):
        style = "".join(
            _PICTURE.format(place=place, svg=quote(row.picture))
            for place, row in enumerate(rows, start=2)  # this text is the window's first part
            if isinstance(row, PoseName)
        )
        client.gui.add_html(
            f"<style>{_GRID}{style}</style><b class='handtrack-poses handtrack-wide'></b>"
        )
        for row in rows:
            if isinstance(row, PoseName):
                button = client.gui.add_button(row.short, hint=row.title)
                button.on_click(lambda _, name=row.name: choose(name))
            else:
                client.gui.add_html(_GROUP.format(html.escape(row)))
