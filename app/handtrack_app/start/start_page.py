"""The start page: open one of the last recordings or another, or make one from videos and a calibration, and check it."""

from __future__ import annotations

import html
import logging
import threading
from collections import deque
from collections.abc import Callable
from functools import partial
from pathlib import Path

import viser

from handtrack.detector.weights import DOWNLOAD_MB, has_weights
from handtrack.errors import HandtrackError
from handtrack.session.layout import SESSION_FILE
from handtrack_app.door.access import open_door
from handtrack_app.page.style import dress
from handtrack_app.protocol.palette import BRAND
from handtrack_app.start.found_files import FoundFiles, find_files
from handtrack_app.start.program import Program
from handtrack_app.start.recent import recent_sessions
from handtrack_app.start.rig_view import first_image, show_rig

log = logging.getLogger(__name__)
_AS_FOUND = "joints, where there are some"
_MASKS = {
    _AS_FOUND: None,
    "joints": "seeded",
    "skin colour": "skin_ycrcb",
    "background": "background_median",
    "none": "none",
}
_TRACKED: dict[str, tuple[str, ...]] = {
    "as it is seen": (),
    "a right hand": ("--side", "right"),
    "a left hand": ("--side", "left"),
    "a body": ("--model", "body34"),
}
_LENSES: dict[str, tuple[str, ...]] = {
    "as the calibration says": (),
    "four coefficients are k1 k2 p1 p2": ("--lens", "plain"),
}
"""words → what `new` is told"""
_LINES = 14
"""of a command are shown"""


class StartPage:
    """Serves the page until a recording is chosen."""

    def __init__(self, host: str, port: int, token: str | None = None, told: str = "") -> None:
        self.door = open_door(host, port, token=token)
        self.chosen: Path | None = None
        self._ended = threading.Event()
        self._program: Program | None = None
        self._found: FoundFiles | None = None
        self._said: deque[str] = deque(maxlen=_LINES)
        gui = self.door.server.gui
        gui.configure_theme(
            dark_mode=True,
            show_logo=False,
            show_share_button=False,
            control_width="large",
            brand_color=BRAND,
        )
        dress(self.door.server)
        gui.add_html(_head("Recordings", "Open one, or make one from videos and a calibration."))
        with gui.add_folder("Open"):
            self._add_recent(gui)
            self.path = gui.add_text("Folder", "", hint="Of a session: it holds session.toml.")
            opened = gui.add_button("Open this folder", icon=viser.Icon.FOLDER_OPEN)
        with gui.add_folder("Make one from videos"):
            self._add_maker(gui)
        with gui.add_folder("Check"):
            gui.add_html(
                _small(
                    "Looks at the folder above: files, cameras, masks, joints and the first pose; changes nothing."
                )
            )
            check = gui.add_button("Check this folder", icon=viser.Icon.STETHOSCOPE)
        self.output = gui.add_html("")
        self.cancel = gui.add_button("Cancel", icon=viser.Icon.X, visible=False)
        gui.main_panel.dock_right()
        gui.main_panel.set_width(560)
        self._on(opened, lambda: self.open(Path(self.path.value.strip()).expanduser()))
        self._on(check, self.check)
        self._on(self.cancel, self._cancel)
        if told:
            self._said.append(told)
            self._show("That could not be opened:")

    def wait(self) -> Path | None:
        """Return the session's folder, once it is chosen."""
        self._ended.wait()
        return self.chosen

    def stop(self) -> None:
        """End the page and what runs."""
        self._cancel()
        self.door.close()

    def open(self, folder: Path) -> None:
        """Leave the page for a session. Raises HandtrackError for a folder that is none."""
        if not (folder / SESSION_FILE).is_file():
            raise HandtrackError(
                f"{folder}: no {SESSION_FILE} in it, so it is no session. Give a session's folder, or make one from videos below."
            )
        self.chosen = folder
        self.output.content = _head("Opening …", str(folder))
        self._ended.set()

    def look(self) -> None:
        """Find the videos and the calibration of a folder, and show how they belong together."""
        given = [one.strip() for one in self.calibration.value.split(";")]
        folder = Path(self.folder.value.strip()).expanduser()
        self.make.visible = self.out.visible = False
        found = self._found = find_files(folder, [Path(one).expanduser() for one in given if one])
        if not found.calibrations:
            raise HandtrackError(
                f"{folder}: {len(found.videos)} videos, but no calibration. Give its file above; or make one: `handtrack board`, film it, "
                "`handtrack calibrate`."
            )
        self.calibration.value = "; ".join(map(str, found.calibrations))
        if not self.out.value.strip():
            self.out.value = str(folder.parent / f"{folder.name}_handtrack")
        rows = "".join(
            f"<tr><td><b>{html.escape(name)}</b></td><td>{html.escape(str(path))}</td></tr>"
            for name, path in found.videos.items()
        )
        unused = "".join(
            f"<div class='handtrack-warning'><b>Not used:</b> {html.escape(path.name)}, of no camera of the calibration</div>"
            for path in found.unused
        )
        family = found.given.family if found.given else ""
        if found.project is not None:
            family = f"a Pose2Sim project, with the cameras' 2D joints; {family}"
        self.found.content = (
            f"<div style='padding:.2em .9em;font-size:.8em'><table>{rows}</table>{unused}"
            f"<div style='opacity:.7'>{html.escape(family)}</div></div>"
        )
        self._show_rig(found)
        if found.unused and len(found.videos) == 1:
            raise HandtrackError(
                f"{folder}: the calibration has one camera alone ({next(iter(found.videos))}), but there are "
                f"{1 + len(found.unused)} videos. Give the calibration of all cameras above: one file, or one a camera with semicolons between."
            )
        self.make.visible = self.out.visible = True

    def _show_rig(self, found: FoundFiles) -> None:
        """Draw the cameras, where their names and sizes are known."""
        images = {
            name: first_image(path, f"the video of {name}") for name, path in found.videos.items()
        }
        seen = {name: image for name, image in images.items() if image is not None}
        given = found.given
        if given is None or any(camera.name is None for camera in given.cameras):
            return
        if all(camera.size for camera in given.cameras):
            show_rig(self.door.server, given.rig(1.0), seen)

    def make_session(self) -> None:
        """Make the session from what was found."""
        found = self._found
        if found is None or not found.calibrations:
            raise HandtrackError("first look into a folder with videos and a calibration.")
        out = Path(self.out.value.strip()).expanduser()
        args = ["new", "--out", str(out)]
        for calibration in found.calibrations:
            args += ["--calibration", str(calibration)]
        if found.project is not None:
            args += ["--project", str(found.project)]
        for name, path in found.videos.items() if found.project is None else ():
            args += ["--video", f"{name}={path}"]
        masks = _MASKS[self.masks.value]
        args += [] if masks is None else ["--masks", masks]
        args += _TRACKED[self.tracked.value]
        unit = self.unit.value.strip()
        args += [f"--world-unit-m={unit}"] if unit else []
        args += _LENSES[self.lens.value]
        for option, box in (
            ("--scaled", self.scaled),
            ("--link", self.link),
            ("--track", self.track),
        ):
            args += [option] if box.value else []
        self._run(args, partial(self.open, out))

    def fetch_detector(self) -> None:
        """Fetch the detector's networks; then there is no more to fetch."""
        self._run(["detector", "install"], lambda: setattr(self.fetch, "visible", False))

    def check(self) -> None:
        """Let the doctor look at the folder."""
        self._run(["doctor", self.path.value.strip()], None)

    def _add_recent(self, gui: viser.GuiApi) -> None:
        for folder in recent_sessions()[:6]:
            button = gui.add_button(
                folder.name, icon=viser.Icon.HISTORY, color="gray", hint=str(folder)
            )
            self._on(button, partial(self.open, folder))

    def _add_maker(self, gui: viser.GuiApi) -> None:
        self.folder = gui.add_text(
            "Folder", "", hint="With a video a camera, and the calibration if it is there, too."
        )
        self.calibration = gui.add_text(
            "Calibration",
            "",
            hint="Its file, if it lies elsewhere; of one file a camera all, with semicolons between: Anipose, OpenCV, Kalibr, COLMAP, MATLAB, Qualisys, JSON, NPZ …",
        )
        self._on(gui.add_button("Look into it", icon=viser.Icon.SEARCH), self.look)
        self.found = gui.add_html("")
        self.tracked = gui.add_dropdown(
            "Tracked", tuple(_TRACKED),
            hint="As it is seen: a body where the 2D joints are a body's; else a hand, right or left as the hand detector sees it "
            "where it is installed, else right.",
        )  # fmt: skip
        self.unit = gui.add_text(
            "Unit in metres",
            "",
            hint="Of the calibration's lengths: 1 for metres, 0.001 for millimetres, the side of a square for a board "
            "counted in squares. Empty: as its form says, or as fits what is tracked.",
        )
        self.lens = gui.add_dropdown(
            "Lens",
            tuple(_LENSES),
            hint="Four distortion coefficients may also be a fisheye's, which is not supported. Needed where the file does not say.",
        )
        self.masks = gui.add_dropdown(
            "Masks by",
            tuple(_MASKS),
            hint="How the hand or body is told from the rest of the image; to be changed later.",
        )
        self.scaled = gui.add_checkbox(
            "Videos are scaled",
            False,
            hint="They are of another size than the calibration's images, of equal shape.",
        )
        self.link = gui.add_checkbox(
            "No copies",
            False,
            hint="The videos stay where they are: the session is yours alone, on this machine.",
        )
        self.track = gui.add_checkbox(
            "Track it, too",
            False,
            hint="Finds the hand in the images, where the hand detector is installed, or the body by its 2D joints, and tracks all frames.",
        )
        self.fetch = gui.add_button(
            f"Get the hand detector ({DOWNLOAD_MB} MB)", icon=viser.Icon.DOWNLOAD, color="gray", visible=not has_weights(),
            hint="Fetches the two networks that find a hand in images, once for all recordings. Google's, Apache License 2.0.",
        )  # fmt: skip
        self._on(self.fetch, self.fetch_detector)
        self.out = gui.add_text("Make it in", "", visible=False)
        self.make = gui.add_button("Make it and open", icon=viser.Icon.WAND, visible=False)
        self._on(self.make, self.make_session)

    def _run(self, args: list[str], then: Callable[[], None] | None) -> None:
        """Run a command; show what it says, and go on where it ended well."""
        if self._program is not None:
            raise HandtrackError("something runs already: wait for it, or cancel it.")
        self._said.clear()
        self.cancel.visible = True
        self._show("Running …")

        def tell(line: str) -> None:
            self._said.append(line)
            self._show("Running …")

        def end(code: int) -> None:
            self._program = None
            self.cancel.visible = False
            self._show(
                "Done." if code == 0 else "It was refused:" if code == 2 else "It ended early:"
            )
            if code == 0 and then is not None:
                self._tried(then)

        self._program = Program(args, tell, end)

    def _show(self, title: str) -> None:
        lines = "".join(
            f"<div style='margin-top:.3em'>{html.escape(line)}</div>" for line in self._said
        )
        self.output.content = f"<div style='padding:.4em .9em;font-size:.85em;line-height:1.45;overflow-wrap:anywhere'><b>{title}</b>{lines}</div>"

    def _cancel(self) -> None:
        if self._program is not None:
            self._program.cancel()

    def _on(self, button: viser.GuiButtonHandle, act: Callable[[], None]) -> None:
        button.on_click(lambda _: self._tried(act))

    def _tried(self, act: Callable[[], None]) -> None:
        try:
            act()
        except HandtrackError as error:
            self._said.clear()
            self._said.append(str(error))
            self._show("That is not possible:")
        except Exception as error:
            log.exception("callback failed")
            self._said.append(f"{type(error).__name__}: {error}")
            self._show("That did not work:")


def _head(title: str, text: str) -> str:
    return (
        "<div style='padding:.3em .9em .5em;line-height:1.5'>"
        f"<div style='font-size:1.15em;font-weight:600'>{html.escape(title)}</div>"
        f"<div style='opacity:.7;font-size:.85em;overflow-wrap:anywhere'>{html.escape(text)}</div></div>"
    )


def _small(text: str) -> str:
    return (
        f"<div style='padding:.1em .9em .3em;font-size:.8em;opacity:.7'>{html.escape(text)}</div>"
    )
