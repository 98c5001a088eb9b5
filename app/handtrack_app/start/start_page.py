"""The start page: open a recording, or make one from videos and a calibration, and check it."""

from __future__ import annotations

import html
import logging
import os
import re
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import cv2
import numpy as np
import viser

from handtrack.arrays import D2, D3, Bytes, Floats, H, N, W
from handtrack.capture.calibration.formats.imported_rig import ImportedRig
from handtrack.capture.calibration.formats.read_calibration import named, read_calibration
from handtrack.capture.joints.pose2sim import is_pose2sim, read_pose2sim
from handtrack.detector.weights import DOWNLOAD_MB, has_weights
from handtrack.errors import HandtrackError
from handtrack.session.bundled import bundled_names, bundled_session
from handtrack.session.layout import SESSION_FILE
from handtrack.session.session import Session
from handtrack_app.access.address import choose_port, host_warning
from handtrack_app.access.web_server import (
    LARGEST_FILE,
    WebServer,
    show_in_browser,
    start_web_server,
)
from handtrack_app.log import LOG_FILE, logging_to
from handtrack_app.page.html import card, dress, escaped, picture, pictures, table, text
from handtrack_app.page.page import put
from handtrack_app.page.panels.view import colours, welcome
from handtrack_app.start.recent import recent_sessions
from handtrack_app.viser_internals import id_of, run_javascript

log = logging.getLogger(__name__)
_MASKS: dict[str, tuple[str, ...]] = {
    "from keypoints if available": (),
    "from keypoints": ("--masks", "seeded"),
    "skin colour": ("--masks", "skin_ycrcb"),
    "background": ("--masks", "background_median"),
    "none": ("--masks", "none"),
}
_TRACKED: dict[str, tuple[str, ...]] = {
    "detect": (),
    "right hand": ("--side", "right"),
    "left hand": ("--side", "left"),
    "body": ("--model", "body34"),
}
_LENSES: dict[str, tuple[str, ...]] = {
    "as in the calibration": (),
    "four coefficients are k1 k2 p1 p2": ("--lens", "plain"),
}
"""words → what `new` is told"""
_RECENT, _FOLDERS = 6, 60
"""that are shown"""


class StartPage:
    """Serves the page until a recording is chosen."""

    def __init__(self, host: str, port: int, token: str | None = None, message: str = "") -> None:
        self.web = start_web_server(host, port, token=token)
        self.chosen: Path | None = None
        self._ended = threading.Event()
        self._drawing = ThreadPoolExecutor(2)
        """waited for at the end: Python ends what still runs, and within a decoder that aborts the program"""
        self._program: Program | None = None
        self._files: InputFiles | None = None
        self._entries: list[viser.GuiButtonHandle] = []
        self._uploads = TemporaryDirectory(prefix="handtrack-")
        self._uploading = threading.Lock()
        self._taken: list[Path] = []
        """calibrations that were uploaded"""
        self._out = Path()
        """the session that an import made which ended early"""
        gui = self.web.server.gui
        colours(gui)
        dress(self.web.server)
        # the colours that its browser remembers, else the system's
        self.web.server.on_client_connect(
            lambda client: welcome(client, lambda taste: colours(client.gui, taste.colours))
        )
        self.output = gui.add_html("")
        self.bar = gui.add_progress_bar(0.0, visible=False)
        self.pictures = gui.add_html("", visible=False)
        self.cancel = self._button("Cancel", self._cancel, icon=viser.Icon.X, visible=False)
        self.open_done = self._button(
            "Open what is done", lambda: self.open(self._out), icon=viser.Icon.FOLDER_OPEN, color=None, visible=False
        )  # fmt: skip
        with gui.add_folder("Open a recording") as self.opening:
            self._add_cards(gui)
        with gui.add_folder("Folder on this machine") as self.browsing:
            self.folder = gui.add_text(
                "Folder", "", hint="A session folder, or a folder with a video for each camera."
            )
            gui.add_html("<div class='handtrack-queue'></div>")
        with gui.add_folder("Import videos") as self.making:
            self._add_maker(gui)
        gui.main_panel.dock_right()
        gui.main_panel.set_width(560)
        self.folder.on_update(lambda event: self._tried(self._typed) if event.client else None)
        put(self.making, visible=False)
        self._list(next((folder.parent for folder in recent_sessions()), Path.home()))
        if message:
            self._notify("That could not be opened:", message)

    def wait(self) -> Path | None:
        """Return the session's folder, once it is chosen."""
        self._ended.wait()
        return self.chosen

    def stop(self) -> None:
        """End the page and what runs."""
        self._cancel()
        self._ended.set()
        self._drawing.shutdown(cancel_futures=True)
        self.web.close()
        self._uploads.cleanup()

    def open(self, folder: Path) -> None:
        """Leave the page for a session. Raises HandtrackError for a folder that is none."""
        if not (folder / SESSION_FILE).is_file():
            raise HandtrackError(
                f"{folder}: there is no {SESSION_FILE} in it, so it is no session."
            )
        self.chosen = folder
        self._notify("Opening …", str(folder))
        self._ended.set()

    # ---- recordings

    def _add_cards(self, gui: viser.GuiApi) -> None:
        """Add a card for each recording that was opened last, and for each example; their pictures come by and by."""
        recent = recent_sessions()[:_RECENT]
        cards = [(folder.name, str(folder.parent), partial(Path, folder)) for folder in recent]
        cards += [(name, "Example", partial(bundled_session, name)) for name in bundled_names()]
        shown = list[tuple[viser.GuiHtmlHandle, Callable[[], Path], str, str]]()
        for name, where, find in cards:
            one = gui.add_html(card(name, (where,)))
            self._button(f"Open {name}", lambda find=find: self.open(find()))
            shown.append((one, find, name, where))
        self._drawing.submit(self._draw_cards, shown)

    def _draw_cards(
        self, cards: Iterable[tuple[viser.GuiHtmlHandle, Callable[[], Path], str, str]]
    ) -> None:
        for shown, find, name, where in cards:
            with suppress(HandtrackError, OSError):
                session = Session.open(find())
                session.check_frames()
                words = f"{len(session.views)} cameras, {session.frame_count} frames"
                images = (view.image(session.frame_range[0]) for view in session.views)
                image = next((one for one in images if one is not None), None)
                if self._ended.is_set():
                    return
                shown.content = card(name, (where, words), "" if image is None else _picture(image))

    # ---- folders

    def _typed(self) -> None:
        check_folder(self._folder)
        self._go(self._folder)

    @property
    def _folder(self) -> Path:
        return Path(self.folder.value.strip()).expanduser()

    def _go(self, folder: Path) -> None:
        """Show a folder, and what can be made of what lies in it."""
        self._notify("")
        put(self.making, visible=False)
        self._files = None
        self._list(folder)
        has_joints = is_pose2sim(folder)
        if has_joints or any(path.suffix.lower() in VIDEOS for path in folder.glob("*")):
            self._offer_tracking(has_joints)
            self.calibration.value = self.out.value = ""
            self._taken = []
            self.look()

    def _list(self, folder: Path) -> None:
        """List the folders and calibrations in a folder, as buttons that lead there."""
        self.folder.value = str(folder)
        for entry in self._entries:
            entry.remove()
        self._entries = []
        try:
            inside = sorted(p for p in folder.iterdir() if not p.name.startswith("."))
        except OSError as error:
            inside = []
            self._notify("That folder cannot be read:", str(error.strerror))
        folders = [path for path in inside if path.is_dir()]
        icon = viser.Icon
        rows: list[tuple[str, viser.IconName, Callable[[], None]]] = []
        if (folder / SESSION_FILE).is_file():
            rows.append(("Open this session", icon.HAND_STOP, partial(self.open, folder)))
            rows.append(("Check this session", icon.STETHOSCOPE, partial(self.check, folder)))
        rows.append(("Up", icon.ARROW_UP, partial(self._go, folder.parent)))
        rows += [
            (one.name, icon.HAND_STOP if (one / SESSION_FILE).is_file() else icon.FOLDER, partial(self._go, one))
            for one in folders[:_FOLDERS]
        ]  # fmt: skip
        with self.browsing:
            for label, which, act in rows:
                self._entries.append(self._button(label, act, icon=which))

    # ---- importing

    def look(self) -> None:
        """Find the videos and the calibration of a folder, and show how they belong together."""
        given = [one.strip() for one in self.calibration.value.split(";")]
        folder = self._folder
        put(self.making, visible=True)
        put(self.make, visible=False)
        result = self._files = find_files(folder, [Path(one).expanduser() for one in given if one])
        self.listed.content = _cameras(result)
        if not result.calibrations:
            raise HandtrackError(
                f"{folder}: {len(result.videos)} videos, but no calibration. Give its file below; or make one: print a board, film it, "
                "`handtrack calibrate`."
            )
        self.calibration.value = "; ".join(map(str, result.calibrations))
        if not self.out.value.strip():
            self.out.value = str(folder.parent / f"{folder.name}_handtrack")
        if result.unused and len(result.videos) == 1:
            raise HandtrackError(
                f"{folder}: the calibration has one camera alone ({next(iter(result.videos))}), but there are "
                f"{1 + len(result.unused)} videos. Give the calibration of all cameras: one file, or one for each camera with semicolons between."
            )
        put(self.make, visible=True)

    def take_calibration(self, name: str, content: bytes) -> None:
        """Use an uploaded calibration: alone where it has several cameras, else with those of the other cameras that were uploaded before."""
        path = Path(self._uploads.name) / Path(name.replace(";", "_")).name
        with self._uploading:
            path.write_bytes(content)
            several = len(read_calibration([path]).cameras) > 1
            known = [one for one in self._taken if one != path]
            if several or any(len(read_calibration([one]).cameras) > 1 for one in known):
                known = []
            self._taken = [*known, path]
            self.calibration.value = "; ".join(map(str, self._taken))
            self._notify("")
            self.look()  # it writes the field, too

    def _uploaded(self, number: int, name: str, content: bytes | None) -> None:
        if content is not None:
            self._tried(partial(self.take_calibration, name, content))
            return
        self._notify(f"{name} is too large.", f"At most {LARGEST_FILE // 1024} kB can be uploaded. Give the path of the file instead.")  # fmt: skip
        if (client := self.web.server.get_clients().get(number)) is not None:
            run_javascript(client, "location.reload()")  # it waits for the file to be taken

    def make_session(self) -> None:
        """Make the session from what was found."""
        result = self._files
        if result is None or not result.calibrations:
            raise HandtrackError("choose a folder with videos and a calibration first.")
        out = Path(self.out.value.strip()).expanduser()
        args = ["new", "--out", str(out)]
        for calibration in result.calibrations:
            args += ["--calibration", str(calibration)]
        if result.project is not None:
            args += ["--project", str(result.project)]
        for name, path in result.videos.items() if result.project is None else ():
            args += ["--video", f"{name}={path}"]
        args += (
            *_MASKS[self.masks.value],
            *_TRACKED[self.tracked.value],
            *_LENSES[self.lens.value],
        )
        if unit := self.unit.value.strip():
            args.append(f"--world-unit-m={unit}")
        options = {"--scaled": self.scaled, "--link": self.link, "--track": self.track}
        args += [option for option, box in options.items() if box.value]
        self._run(f"Importing {out.name}", args, partial(self.open, out), out)

    def _offer_tracking(self, has_joints: bool) -> None:
        """Track after import where something tells the subject's joints: the files, or the detector, which is offered else."""
        self.track.value = has_joints or has_weights()
        put(self.fetch, visible=not self.track.value)

    def check(self, folder: Path) -> None:
        """Let the doctor look at a session."""
        self._run(f"Checking {folder.name}", ["doctor", str(folder)], None)

    def _add_maker(self, gui: viser.GuiApi) -> None:
        self.listed = gui.add_html("")
        self.calibration = gui.add_text(
            "Calibration",
            "",
            hint="Its file, if it is elsewhere; several files, one per camera, separated by semicolons: Anipose, OpenCV, Kalibr, COLMAP, MATLAB, Qualisys, JSON, NPZ …",
        )
        self.calibration.on_update(lambda event: self._tried(self.look) if event.client else None)
        self.upload = gui.add_upload_button(
            "Upload calibration", icon=viser.Icon.UPLOAD, color="gray", mime_type=",".join(CALIBRATIONS),
            hint=f"From the computer that shows this page, at most {LARGEST_FILE // 1024} kB; several files, one per camera, one after the other.",
        )  # fmt: skip
        self.web.messages.files[id_of(self.upload)] = self._uploaded
        self.track = gui.add_checkbox(
            "Track after import",
            False,
            hint="Finds the hand in the images, if the hand detector is installed, or the body from its 2D joints, and tracks all frames.",
        )
        after = partial(self._offer_tracking, False)  # there is no more to fetch
        fetch = partial(self._run, "Fetching the hand detector", ["detector", "install"], after)
        self.fetch = self._button(
            f"Get the hand detector ({DOWNLOAD_MB} MB)", fetch, icon=viser.Icon.DOWNLOAD,
            hint="Fetches the two networks that find a hand in images, once for all recordings. Google's, Apache License 2.0.",
        )  # fmt: skip
        self.make = self._button(
            "Import", self.make_session, icon=viser.Icon.WAND, color=None, visible=False
        )
        with gui.add_folder("More", expand_by_default=False):
            self.out = gui.add_text("Output folder", "")
            self.tracked = gui.add_dropdown(
                "Subject", tuple(_TRACKED),
                hint="Detect: a body if the 2D joints are a body's, otherwise a hand: right or left as the hand detector reports, "
                "right if it is not installed.",
            )  # fmt: skip
            self.unit = gui.add_text(
                "Unit in metres",
                "",
                hint="Unit of the calibration's lengths: 1 for metres, 0.001 for millimetres, the side of a square for a board "
                "counted in squares. Empty: taken from its format, or inferred from the subject's size.",
            )
            self.lens = gui.add_dropdown(
                "Lens",
                tuple(_LENSES),
                hint="Four distortion coefficients may also be a fisheye's, which is not supported. Needed if the file does not specify it.",
            )
            self.masks = gui.add_dropdown(
                "Segmentation", tuple(_MASKS), hint="How the subject is separated from the background; can be changed later.",
            )  # fmt: skip
            self.scaled = gui.add_checkbox(
                "Videos are scaled",
                False,
                hint="They have the calibration images' aspect ratio, but another size.",
            )
            self.link = gui.add_checkbox(
                "Link videos (no copy)",
                False,
                hint="The videos stay where they are; the session works on this machine only.",
            )

    # ---- what runs

    def _run(
        self, title: str, args: list[str], then: Callable[[], None] | None, out: Path | None = None
    ) -> None:
        """Run a command in place of the form. out: the session that it makes, which is offered if it ends early."""
        if self._program is not None:
            raise HandtrackError("a command is running: wait for it, or cancel it.")
        progress = ImportProgress(title)
        self._show_running(True)
        put(self.open_done, visible=False)
        put(self.pictures, visible=False)
        self.output.content = progress.words()

        def report(line: str) -> None:
            if progress.hear(line) and out is not None:
                self._drawing.submit(self._show_joints, out)
            self.output.content = progress.words()
            put(
                self.bar,
                animated=progress.share is None,
                value=100 * (1.0 if progress.share is None else progress.share),
            )

        def end(code: int) -> None:
            self._program = None
            self._show_running(False)
            progress.title = "Done." if code == 0 else "It was refused:" if code == 2 else "It stopped early:"  # fmt: skip
            said = [line.replace("--world-unit-m", "'Unit in metres' under 'More'") for line in progress.lines]  # fmt: skip
            self.output.content = text(f"<b>{progress.title}</b>", faint=False) + "".join(map(escaped, said))  # fmt: skip
            if code == 0 and then is not None:
                self._tried(then)
            elif out is not None and (out / SESSION_FILE).is_file():
                self._out = out
                put(self.open_done, visible=True)

        self._program = Program(args, report, end)

    def _show_running(self, on: bool) -> None:
        put(self.cancel, visible=on)
        put(self.bar, visible=on)
        for form in (self.opening, self.browsing, self.making):
            put(form, visible=not on and (form is not self.making or self._files is not None))

    def _show_joints(self, out: Path) -> None:
        """Show each camera's picture, with the joints that were detected in it."""
        with suppress(HandtrackError, OSError):
            shown = {name: _picture(one, name) for name, one in detected_joints(out).items()}
            put(self.pictures, content=pictures(shown), visible=True)

    def _cancel(self) -> None:
        if self._program is not None:
            put(self.cancel, visible=False)
            self._program.cancel()

    def _notify(self, title: str, words: str = "") -> None:
        self.output.content = text(f"<b>{html.escape(title)}</b> {html.escape(words)}", faint=False) if title else ""  # fmt: skip

    def _button(self, label: str, act: Callable[[], None], **drawn: Any) -> viser.GuiButtonHandle:
        """Add a button that calls `act`. drawn: as `add_button` has it."""
        button = self.web.server.gui.add_button(label, **{"color": "gray", **drawn})
        button.on_click(lambda _: self._tried(act))
        return button

    def _tried(self, act: Callable[[], None]) -> None:
        try:
            act()
        except HandtrackError as error:
            self._notify("That is not possible:", str(error))
        except Exception as error:
            log.exception("callback failed")
            self._notify("That did not work:", f"{type(error).__name__}: {error}")


def _picture(image: Bytes[H, W, D3], name: str = "") -> str:
    """Return a picture BGR as HTML, small."""
    return picture(small_picture(image)[..., ::-1], name)


def _cameras(files: InputFiles) -> str:
    """Return a row for each camera: its video, whether it is calibrated, and what is missing; and what is not used."""
    known = [] if files.given is None else [one.name for one in files.given.cameras]
    unnamed = None in known
    names = dict.fromkeys((*files.videos, *(name for name in known if name is not None)))
    rows = ""
    for name in names:
        video, calibrated = files.videos.get(name), unnamed or name in known
        joints = files.project is not None
        state = "ready" if calibrated and (video or joints) else "no calibration" if video else "no video: left out"  # fmt: skip
        rows += (
            f"<tr class='{'' if state == 'ready' else 'handtrack-error'}'><td><b>{html.escape(name)}</b></td>"
            f"<td>{html.escape(video.name) if video else '2D joints' if joints else '–'}</td>"
            f"<td>{'✓ calibrated' if calibrated else '–'}</td><td>{state}</td></tr>"
        )
    unused = "".join(
        f"<div class='handtrack-error'><b>Not used:</b> {html.escape(path.name)}, of no camera of the calibration</div>"
        for path in files.unused
    )
    family = files.given.family if files.given else ""
    if files.project is not None:
        family = f"a Pose2Sim project, with the cameras' 2D joints; {family}"
    return table(rows) + text(unused, faint=False) + escaped(family)


# ---- Serving the page


@logging_to(LOG_FILE)
def choose_recording(
    host: str, port: int | None, open_browser: bool, token: str | None = None, message: str = ""
) -> tuple[Path, WebServer] | None:
    """Serve the start page; return the folder that was chosen, and the page's web server, closed. None after Ctrl-C.

    token: of the page before, which comes again by itself; told: why it does. Raises HandtrackError for a host or port that cannot be used.
    """
    warning = host_warning(host)
    if warning and token is None:
        print(f"handtrack: {warning}", file=sys.stderr)
    chosen = choose_port(host, port)
    page = StartPage(host, chosen, token, message)
    try:
        if token is None:
            print(f"handtrack: choose a recording at {page.web.url} (Ctrl-C ends)", flush=True)
            if open_browser:
                show_in_browser(page.web)
        folder = page.wait()
        return None if folder is None else (folder, page.web)
    except KeyboardInterrupt:
        return None
    finally:
        page.stop()


# ---- What a folder holds of which a session can be made: videos, and a calibration that names their cameras


VIDEOS = (".mp4", ".avi", ".mov", ".mkv", ".m4v", ".webm")
CALIBRATIONS = (".toml", ".yaml", ".yml", ".json", ".xml", ".npz", ".mat")
_MOST = 2000
"""files looked at"""


@dataclass(frozen=True)
class InputFiles:
    """Videos by camera, and the calibration."""

    videos: dict[str, Path]
    calibrations: tuple[Path, ...]
    """one file of all cameras, or one a camera"""
    given: ImportedRig | None
    """its cameras, in its own unit"""
    unused: tuple[Path, ...]
    """videos of no camera"""
    project: Path | None = None
    """the folder, where it is a Pose2Sim project: `new` finds videos and 2D joints in it"""


def check_folder(folder: Path) -> None:
    """Raise HandtrackError for what is no folder."""
    if not folder.is_dir():
        raise HandtrackError(
            f"{folder}: no such folder. Give the folder with your cameras' videos, as a path on the machine that handtrack runs on."
        )


def find_files(folder: Path, calibrations: Sequence[Path] = ()) -> InputFiles:
    """Look into a folder, and the folders in it, for a recording. calibrations: if they lie elsewhere.

    Raises HandtrackError for what is no folder, has no video, and for a calibration that is none.
    """
    if is_pose2sim(folder):
        return _project(folder, next(iter(calibrations), None))
    check_folder(folder)
    files = sorted(
        path for path in [*folder.glob("*"), *folder.glob("*/*")][:_MOST] if path.is_file()
    )
    videos = [path for path in files if path.suffix.lower() in VIDEOS]
    if not videos:
        raise HandtrackError(f"{folder}: no video in it ({', '.join(VIDEOS)}).")
    given: ImportedRig | None = None
    if calibrations:
        given = read_calibration(calibrations)
    else:
        calibrations, given = _calibrated([p for p in files if p.suffix.lower() in CALIBRATIONS])
    cameras = () if given is None else given.cameras
    by_camera = _matched(videos, [camera.name for camera in cameras if camera.name is not None])
    unused = tuple(path for path in videos if path not in by_camera.values())
    return InputFiles(by_camera, tuple(calibrations), given, unused)


def _calibrated(files: Sequence[Path]) -> tuple[tuple[Path, ...], ImportedRig | None]:
    """Return the first file that has several cameras; else all that have one each, together. Raises HandtrackError for several that are no rig."""
    alone: dict[Path, ImportedRig] = {}
    for path in files:
        try:
            rig = read_calibration([path])
        except HandtrackError:
            continue
        if len(rig.cameras) > 1:
            return (path,), rig
        alone[path] = rig
    if len(alone) > 1:
        return tuple(alone), read_calibration(list(alone))
    return tuple(alone), next(iter(alone.values()), None)


def _project(folder: Path, calibration: Path | None) -> InputFiles:
    project = read_pose2sim(folder, calibration)
    cameras = list(project.keypoints)
    given, _ = named(read_calibration([project.calibration]), cameras, str(project.calibration))
    return InputFiles(dict(project.videos), (project.calibration,), given, (), folder)


def _matched(videos: list[Path], names: list[str]) -> dict[str, Path]:
    """Return videos by camera: those whose names hold a camera's, else all by their own names, which `new` compares."""
    files: dict[str, Path] = {}
    for name in sorted(names, key=len, reverse=True):  # cam10 before cam1
        like = [p for p in videos if p not in files.values() and name.lower() in p.stem.lower()]
        like = like or [
            p for p in videos if p not in files.values() and name.lower() == p.parent.name.lower()
        ]
        if len(like) == 1:
            files[name] = like[0]
    return {n: files[n] for n in names if n in files} or {path.stem: path for path in videos}


# ---- How far an import is: what its command prints, as steps with a bar and the time that is left; and what it has found so far


_BAR = re.compile(r"^\w+:\s+(\d+)%\|.*?[\d:]+<([\d:]+|\?)")
"""of tqdm: what is done, how much of it, and the time that is left"""
_STEPS = {"looking for the first pose": "Find first pose", "detecting": "Detect joints", "sizing": "Fit size", "tracking": "Track", "refining": "Refine"}  # fmt: skip
_IMPORT = "Import files"
_LINES = 8
_HIGH = 240  # [px] of a small picture
_JOINT = (0, 159, 230)  # BGR


@dataclass
class ImportProgress:
    """What a command said so far."""

    title: str
    step: str = _IMPORT
    share: float | None = None
    """of the step; None: not known"""
    left: str = ""
    """minutes and seconds until the step is done"""
    lines: list[str] = field(default_factory=list)
    _done: list[str] = field(default_factory=list)

    def hear(self, line: str) -> bool:
        """Take a line; return whether another step began."""
        bar = _BAR.match(line)
        if bar is None and not line.startswith("stopping"):
            self.lines = [*self.lines[1 - _LINES :], line]
        step = next((step for word, step in _STEPS.items() if line.startswith(word)), self.step)
        began = step != self.step
        if began:
            self._done = [*self._done, self.step]
            self.step, self.share, self.left = step, None, ""
        if bar is not None:
            self.share, self.left = int(bar[1]) / 100, bar[2].strip("?")
        return began

    def words(self) -> str:
        """Return the steps and the newest lines as HTML."""
        steps = "".join(
            f"<div>✓ {step}</div>" for step in dict.fromkeys(self._done) if step != self.step
        )
        now = "" if self.share is None else f" · {100 * self.share:.0f} %"
        now += f" · {self.left} left" if self.left else ""
        steps += f"<div><b>▸ {self.step}</b>{now}</div>"
        lines = "".join(f"<div>{html.escape(line)}</div>" for line in self.lines)
        return text(f"<b>{html.escape(self.title)}</b>{steps}", faint=False) + text(lines)


def detected_joints(folder: Path) -> dict[str, Bytes[H, W, D3]]:
    """Return a small picture BGR of each camera of a session, with the joints that were detected in it. Raises HandtrackError."""
    session = Session.open(folder)
    middle = session.frame_range[session.frame_count // 2]
    return {
        view.name: small_picture(image, [joints.pixels for joints in view.keypoints(middle, 1.0)])
        for view in session.views
        if (image := view.image(middle)) is not None
    }


def small_picture(image: Bytes[H, W, D3], joints: Iterable[Floats[N, D2]] = ()) -> Bytes[H, W, D3]:
    """Return an image small, with joints [px] as points."""
    scale = _HIGH / image.shape[0]
    size = (round(image.shape[1] * scale), _HIGH)
    small = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)
    for x, y in (scale * row for hand in joints for row in hand[np.isfinite(hand).all(axis=1)]):
        cv2.circle(small, (round(x), round(y)), 2, _JOINT, -1, cv2.LINE_AA)
    return small


# ---- A command of handtrack as a program of its own, read line by line: what it says is shown as it comes


_ITSELF = "import sys; from handtrack_app.cli import main; sys.exit(main(sys.argv[1:]))"


class Program:
    """A running command."""

    def __init__(
        self,
        args: Sequence[str],
        report: Callable[[str], None],
        end: Callable[[int], None],
    ) -> None:
        """Start it. tell: is called with each line, end: with the exit code, both on a thread of its own."""
        environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-c", _ITSELF, *args],
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
            encoding="utf-8", errors="replace", env=environment, process_group=0 if os.name == "posix" else None,
        )  # fmt: skip
        threading.Thread(target=self._read, args=(report, end), daemon=True).start()

    def cancel(self) -> None:
        """Interrupt it, as Ctrl-C does: it ends cleanly."""
        if self._process.poll() is None:
            self._process.send_signal(signal.SIGINT)

    def _read(self, report: Callable[[str], None], end: Callable[[int], None]) -> None:
        assert self._process.stdout is not None
        with self._process:
            for line in self._process.stdout:
                if line.strip():
                    report(line.strip())
        end(self._process.returncode)
