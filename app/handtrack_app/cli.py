"""The program `handtrack`: reads the command line and hands over to one module per command."""

from __future__ import annotations

import argparse
import errno
import importlib
import io
import math
import os
import sys
from collections.abc import Callable, Iterable
from dataclasses import is_dataclass
from inspect import signature
from pathlib import Path
from typing import Any, NamedTuple

from handtrack.errors import HandtrackError, not_enough_memory, unknown_name
from handtrack.export.registry import FORMATS
from handtrack.version import VERSION

EXIT_OK, EXIT_INTERNAL, EXIT_USAGE, EXIT_INTERRUPTED = 0, 1, 2, 130


def main(argv: list[str] | None = None) -> int:
    """Run one command; return its exit code (contracts §3). Never shows a traceback."""
    # Matrices here are small: threads of BLAS only get in each other's way, and change the order of sums.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    os.environ.setdefault("MKL_NUM_THREADS", "1")
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal that knows no "−" shows "?"
    words = (sys.argv[1:] if argv is None else argv) or ["open"]
    words = [*EARLIER_COMMANDS.get(words[0], words[:1]), *words[1:]]
    if not words[0].startswith("-") and words[0] not in COMMANDS:
        names = [name for group in COMMAND_GROUPS.values() for name in group]
        print(f"handtrack: {unknown_name('command', words[0], names)}", file=sys.stderr)
        return EXIT_USAGE
    try:
        args = build_parser([name for name in words[:1] if name in COMMANDS]).parse_args(words)
    except SystemExit as asked:  # --help, --version: 0; usage: 2
        return int(asked.code or EXIT_OK)
    except HandtrackError as error:  # of an option's value
        return _failed(words[0], str(error), EXIT_USAGE)
    return _run(args)


def _run(args: argparse.Namespace) -> int:
    from handtrack.capture.images.containers import CAPTURE_OPTIONS

    os.environ.setdefault("OPENCV_FFMPEG_CAPTURE_OPTIONS", CAPTURE_OPTIONS)
    try:
        run, taker = function_of(args.command)
        values = vars(args)
        given = taker(**{n: values[n] for n in signature(taker).parameters if n in values})
        code = given if taker is run else run(given)
        sys.stdout.flush()
    except HandtrackError as error:
        return _failed(args.command, str(error), EXIT_USAGE)
    except KeyboardInterrupt:
        return _failed(args.command, "interrupted.", EXIT_INTERRUPTED)
    except BrokenPipeError:  # the reader of our output has gone, as `| head` does
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return EXIT_OK
    except OSError as error:
        if error.errno is None:
            return _failed(args.command, _internal(error), EXIT_INTERNAL)
        where = "" if error.filename is None else f"{error.filename}: "
        what = error.strerror
        if error.errno in (errno.EACCES, errno.EPERM, errno.EROFS):
            what = f"cannot be written, or not be read ({error.strerror})"
        return _failed(args.command, f"{where}{what}.", EXIT_USAGE)
    except MemoryError as error:
        return _failed(args.command, str(not_enough_memory("this", error)), EXIT_USAGE)
    except Exception as error:
        return _failed(args.command, _internal(error), EXIT_INTERNAL)
    return code


def function_of(command: str) -> tuple[Callable[..., int], Any]:
    """Return a command's function, and what takes its options as keywords: that, or the dataclass of which it takes one."""
    module, name = COMMANDS[command].runs.split(":")
    run = getattr(importlib.import_module(f"handtrack_app.commands.{module}"), name)
    first, *_ = signature(run, eval_str=True).parameters.values()
    return run, first.annotation if is_dataclass(first.annotation) else run


def _failed(command: str, text: str, code: int) -> int:
    if os.strerror(errno.EMFILE) in text:
        text += " Close other programs, or allow more open files: `ulimit -n 4096`."
    paragraph = " ".join(text.splitlines())
    print(f"handtrack {command}: {paragraph}", file=sys.stderr)
    return code


def _internal(error: Exception) -> str:
    """Return what the user is told of a mistake of ours; the traceback goes to a file."""
    import tempfile  # with what they import a tenth of the start
    import traceback

    what = f"an error inside handtrack, not in your data: {type(error).__name__}: {error}."
    try:
        handle, name = tempfile.mkstemp(prefix="handtrack_error_", suffix=".log")
        with os.fdopen(handle, "w", encoding="utf-8") as log:
            log.write("".join(traceback.format_exception(error)))
    except OSError:
        return what
    return f"{what} Please report it with the command you gave and the details in {name}."


_Option = tuple[tuple[str, ...], dict[str, object]]
"""arguments of argparse's `add_argument`"""


def _option(*names: str, **how: object) -> _Option:
    return names, how


def _number(
    name: str, kind: type[int | float], low: float, high: float = math.inf, **how: object
) -> _Option:
    """Return an option that is a number from low to high."""

    def read(text: str) -> float:
        value = kind(text)
        if not low <= value <= high:
            expected = f"at least {low:g}" if high == math.inf else f"{low:g} to {high:g}"
            raise HandtrackError(f"{name} {text}: expected {expected}.")
        return value

    read.__name__ = kind.__name__  # as argparse names it where it is no number
    return _option(name, type=read, **how)


class _ByCamera(argparse.Action):
    """Keeps what is given of each camera by its name: `CAMERA=FILE`, and further files where an option takes several."""

    def __call__(
        self, _: object, args: argparse.Namespace, values: Any, option: str | None = None
    ) -> None:
        """Add a camera. Raises HandtrackError for what is not of this form, and a camera that was there already."""
        first, *more = values if isinstance(values, list) else [values]
        camera, _, file = first.partition("=")
        known = getattr(args, self.dest)
        if not (camera and file) or camera in known:
            form = self.metavar[0] if isinstance(self.metavar, tuple) else self.metavar
            raise HandtrackError(f"{option} {first}: expected {form}, each camera once, by its name in the calibration.")  # fmt: skip
        setattr(args, self.dest, known | {camera: [file, *more] if self.nargs else file})


def _by_camera(name: str, metavar: str | tuple[str, str], **how: object) -> _Option:
    return _option(name, action=_ByCamera, default={}, metavar=metavar, **how)


class _Command(NamedTuple):
    """A command: what runs it, its help, its options."""

    runs: str
    """module of `commands`, and function"""
    help: str
    options: tuple[_Option, ...]
    has_json: bool = True
    """whether it prints JSON with `--json`"""


def _listed(names: list[str], last: str) -> str:
    return f"{', '.join(names[:-1])} {last} {names[-1]}"


_SESSION = _option("session", type=Path, help="session folder")
_POSES = _option("poses", type=Path, metavar="POSES.npz")
_LANDMARKS = _option(
    "--landmarks", metavar="DEFINITION",
    help="points: joints (the model's joint centres), surface21 (on the skin), or a detector's, such as mediapipe21 (default: joints; for `evaluate`, that of the truth)",
)  # fmt: skip
_CAMERAS = _option(
    "--camera", action="append", default=[], metavar="NAME", help="this camera only; repeat for several (default: all cameras with images)"
)  # fmt: skip
_FRAMES = _option("--frames", metavar="A:B", help="frames A to B−1 (default: all)")
_SET = _option(
    "--set", action="append", default=[], metavar="section.key=value", help="override a setting for this run only; repeat for several"
)  # fmt: skip
_INIT = _option(
    "--init", metavar="FILE|auto",
    help="first-frame pose: a file, or `auto` to find one (default: the session's init.json)",
)  # fmt: skip
_YES = _option(
    "--yes",
    action="store_true",
    help="track even from a first pose with low confidence, or one that looks like the other hand",
)
_TAKE_OVER = _option(
    "--take-over", action="store_true", help="take over the write lock from another running handtrack"
)  # fmt: skip
_SIDE = _option("--side", choices=("right", "left"), default="right")
_NEW = _option("--out", type=Path, required=True, metavar="SESSION", help="folder to make")
_SERVER = (
    _option("--host", default="127.0.0.1", help="address to listen on (default: this machine only)"),
    _option("--port", type=int, help="port (default: 8080, or the next free one)"),
    _option("--no-browser", action="store_true", help="open no browser window; the address is printed"),
    _option("--rerun", action="store_true", help="also stream residuals to rerun's viewer"),
    _option("--memory", type=float, metavar="GB",
            help="most that decoding and tracking may use (default: 3/4 of this machine's)"),
)  # fmt: skip

_MOTION = (
    _option("--skeleton", type=Path, metavar="FILE.asf", help="skeleton of an .amc file (default: the one beside it)"),
    _option("--names", type=Path, metavar="TABLE.toml", help='names of the joints, in lines such as left_knee = "LeftLeg"'),
    _option("--unit-m", type=float, metavar="M", help="metres per unit of the file (default: estimated from the person's size)"),
    _option("--positions", choices=("add", "replace"), help="whether a BVH's position channels add to OFFSETs or replace them, if it is ambiguous"),
)  # fmt: skip

_KNOWN_PERSON = _option(
    "--person", type=Path, metavar="FILE", help="a person's file; the shape is fitted, starting from it"
)  # fmt: skip
_OF_PERSON = (
    _option("session", type=Path, metavar="SESSION|POSES.npz", help="session folder, or a result whose fitted shape is saved"),
    _FRAMES,
    _number("--count", int, 1, default=20, metavar="N", help="number of frames fitted, evenly spaced (20)"),
    _INIT, _YES,
    _option("--use", metavar="NAMES", help="observations: silhouettes, cloud, keypoints; comma-separated"),
    _SET, _KNOWN_PERSON,
    _option("--spread", action="store_true", help="print how a result's fingers spread together instead, for coupling 18"),
    _option("--out", type=Path, metavar="FILE.toml|.json",
            help="file to write (default: person.toml beside the session or result; with `size`, hand.json or body.json)"),
)  # fmt: skip
COMMANDS: dict[str, _Command] = {
    "open": _Command("workbench:open_session", "Open the workbench in the browser, on a session folder or on the bundled one.", (
        _option("session", nargs="?", type=Path, help="session folder; with --live, a folder with a calibration will do"),
        _option("--choose", action="store_true", help="choose a recording in the browser, or make one from videos"),
        _option("--live", action="store_true", help="track running cameras, by the session's settings and calibration"),
        _by_camera("--camera", "NAME=DEVICE",
                help="with --live: a camera's number, path or address, or a video played as one; once per "
                "camera (default: 0, 1, 2 … in the session's order)"),
        _option("--record", type=Path, metavar="FOLDER", help="with --live: record to a new session folder from the start"),
        _number("--tolerance-ms", float, 0.1, 10_000, default=50.0, metavar="T",
                help="with --live: largest time between the images of a frame [ms] (50)"),
        _TAKE_OVER, *_SERVER,
    ), False),
    "demo": _Command("workbench:open_demo", "Open the workbench on a bundled recording that is tracked already.", _SERVER, False),
    "sample": _Command("new_session.new:save_sample", "Write a bundled sample recording to a folder.", (
        _option("name", metavar="NAME", help="two_videos (the tutorial's material) or another_hand or open_fist_open (sessions)"),
        _option("--to", type=Path, required=True, metavar="DIR", help="folder to make"),
    )),
    "new": _Command("new_session.new:make_session", "Make a session folder from recordings and a calibration.", (
        _NEW,
        _option("folder", nargs="?", help=argparse.SUPPRESS),  # refused, and --project named
        _option("--project", type=Path, metavar="FOLDER",
                help="a Pose2Sim project or trial: its calibration, videos, 2D joints and rate, unless you give others"),
        _option("--calibration", type=Path, action="append", default=[], metavar="FILE",
                help="calibration of Anipose, OpenCV, Kalibr, COLMAP, MATLAB, Qualisys, or JSON and NPZ of K, dist, R, t; or one file per camera"),
        _by_camera("--video", "CAMERA=FILE", help="a camera's video; once per camera"),
        _by_camera("--images", "CAMERA=PATTERN",
                help="a camera's numbered image files instead, such as cam0='left/*.png'"),
        _by_camera("--depth", "CAMERA=PATTERN", help="a camera's 16-bit depth images"),
        _number("--depth-scale", float, 1e-9, 1, metavar="M", help="metres in one unit of the depth files, such as 0.001"),
        _by_camera("--keypoints", "CAMERA=FILE",
                help="a camera's 2D joints of a hand or body, from OpenPose, MediaPipe, RTMPose, DeepLabCut, SLEAP or CSV"),
        _option("--layout", metavar="NAME",
                help="the order of a body's joints, such as body_25 or halpe26 (default: recognised and reported)"),
        _option("--person", type=int, metavar="N", help="which of several people; 1 is the tallest one present throughout (default)"),
        _option("--model", metavar="NAME|FILE",
                help="hand26, body34, another name or your own definition (default: hand26, or body34 for a body's joints)"),
        _option("--truth", type=Path, metavar="FILE", help="ground truth: truth.npz, TRC, C3D or CSV, in the calibration's world"),
        _option("--name", default="", help="the session's name"),
        _option("--side", choices=("right", "left"), help="which hand (default: detected, else right)"),
        _option("--detector", type=Path, metavar="FILE", help="the hand detector's weights (default: as for `detect`)"),
        _option("--track", action="store_true", help="track after import: detect the hand, then track it"),
        _number("--fps", float, 0.001, 1e6, help="frames a second (default: the first video's)"),
        _number("--world-unit-m", float, 1e-9, 1e6, help="metres in one unit of the calibration (default: its format's, or inferred)"),
        _option("--names", type=Path, metavar="TABLE.toml",
                help='names of the points in --keypoints, in lines such as index_tip = "D2_tip"'),
        _option("--lens", choices=("plain", "fisheye"),
                help="meaning of four distortion coefficients, if the calibration does not specify it: k1 k2 p1 p2, or a fisheye's"),
        _option("--link", action="store_true", help="link the recordings instead of copying them"),
        _option("--yes", action="store_true", help="accept every default without asking"),
        _option("--scaled", action="store_true", help="accept videos that are scaled versions of the calibration's images"),
        _option("--masks", choices=("seeded", "skin_ycrcb", "background_mog2", "background_median", "none"),
                help="segmentation method; its settings are in session.toml (default: seeded, from 2D joints, if there are any; "
                "otherwise skin_ycrcb, by skin colour)"),
    )),
    "track": _Command("track:run", "Track a session and save poses.npz.", (
        _SESSION, _INIT, _YES, _FRAMES,
        _option("--use", metavar="NAMES", help="observations: silhouettes, cloud, keypoints, edges, intensity; comma-separated"),
        _SET, _KNOWN_PERSON,
        _option("--seed", type=int, metavar="N", help="random seed, the setting tracker.seed (default: 0)"),
        _option("--size-later", action="store_true",
                help="track first, fit the hand's size to the tracked frames, then track again"),
        _option("--out", type=Path, metavar="FILE.npz", help="result (default: SESSION/tracks/poses.npz)"),
        _option("--rerun", action="store_true", help="show residuals in rerun's viewer in the browser"),
        _option("--rerun-save", type=Path, metavar="FILE.rrd", help="record residuals to a file"),
        _option("--rerun-frame", type=int, metavar="N", help="record every iteration of this frame"),
        _option("--restart", action="store_true", help="start over instead of resuming an interrupted run"),
        _TAKE_OVER,
        _option("--explain", type=int, metavar="FRAME", help="report the searches made in this frame and why a pose was chosen"),
    )),
    "batch": _Command("batch:run", "Track many recordings in parallel and report the worst first.", (
        _option("pattern", nargs="+", metavar="PATTERN", help="session folders, or patterns of them, such as 'takes/*'"),
        _number("--jobs", int, 1, default=1, metavar="N", help="recordings at a time on this machine (1)"),
        _option("--dask", metavar="ADDRESS", help="on a dask cluster instead: its scheduler's address"),
        _option("--resume", action="store_true", help="skip recordings already tracked with the same inputs"),
        _option("--out", type=Path, default=Path("batch"), metavar="DIR", help="for ledger, reports and logs (./batch); results stay "
                "with their recordings"),
        _number("--most-lost", float, 0, 1, default=0.5, metavar="SHARE", help="a recording with more lost frames makes the exit code 3 (0.5)"),
        _INIT, _YES, _FRAMES,
        _option("--use", metavar="NAMES", help="as for `track`"), _SET,
        _option("--seed", type=int, metavar="N", help="as for `track`"),
    )),
    "takes": _Command("results:manage_takes", "List, compare, restore or remove the takes of a session.", (
        _SESSION,
        _option("--restore", type=int, metavar="TAKE", help="make a take current again, and save it as tracks/poses.npz"),
        _option("--compare", type=int, nargs=2, metavar="TAKE", help="how far two takes differ"),
        _option("--prune", type=int, metavar="TAKE", help="remove a take that is not current, for good"),
        _option("--frames", metavar="A:B", help="restore or compare only these (default: all)"),
        _TAKE_OVER,
    )),
    "person": _Command("person:fit_person", "Fit a person's hand or body shape and save it for other recordings.", _OF_PERSON),
    "size": _Command("person:fit_person", "The same as `person`, saved as hand.json or body.json.", _OF_PERSON),
    "export": _Command("results:export_poses", "Write a tracked sequence for other programs.", (
        _POSES,
        _option("--to", metavar="FORMAT", help=f"{_listed([f.name for f in FORMATS], 'or')}; without it, the formats are described"),
        _option("--out", type=Path, metavar="FILE", help="file to write (default: beside the poses)"),
        _option("--up", metavar="AXIS", help=f"which of the world's axes points up: x, y, z, or --up=-y where y points down; {_listed([f.name for f in FORMATS if f.up], 'and')} are then rotated upright (default: no rotation)"),
        _LANDMARKS,
        _option("--mano", type=Path, metavar="MODEL", help="your MANO_RIGHT.pkl or MANO_LEFT.pkl, which --to mano fits"),
        _option("--metadata", type=Path, metavar="FILE.toml", help="what archives (nwb) require about subject and session: subject_id, species, sex, age, start, description, experimenter, institution, lab"),
        _option("--session", type=Path, metavar="DIR", help="session with the images (default: the one that contains the poses)"),
    )),
    "evaluate": _Command("checks:compare_with_truth", "Compare a tracked sequence with the truth.", (
        _POSES, _option("--truth", type=Path, required=True, metavar="truth.npz"), _LANDMARKS,
    )),
    "skin": _Command("person:fit_skin", "Fit the skin colour filter of point clouds to manually segmented images.", (
        _SESSION,
        _option("--segmented", nargs=2, action="append", metavar=("IMAGE", "MASK"),
                help="an image file and its mask; may be repeated (default: the masks painted in the session)"),
        _number("--size", float, 0.01, 100, default=2.5, help="size of the ellipse, in standard deviations (2.5)"),
    )),
    "simulate": _Command("simulate:run", "Make a simulated recording with truth.", (
        _NEW,
        _option("--cameras", type=int, default=3),
        _number("--frames", int, 1, help="number of frames (100; for a motion file, all)"),
        _number("--size", int, 1, 8192, nargs=2, default=(640, 480), metavar=("W", "H"), help="image size in pixels"),
        _option("--model", choices=("hand26", "body34", "body38"), help="default: hand26, or for a motion file the one that its joint names match"),
        _option("--motion", metavar="NAME|FILE",
                help="open_fist_open, curl, gestures or still; for a body: dance, greet or still; or a motion file: BVH, AMC, TRC, C3D"),
        *_MOTION, _option("--motion-fps", type=float, metavar="RATE", help="frame rate of a motion file that has none (AMC)"),
        _SIDE,
        _number("--scale", float, 0.3, 3, default=1.0, help="size; 1 is a hand of 187 mm, a body of 1.75 m"),
        _option("--forearm", action="store_true", help="with a bare forearm"),
        _option("--distance", type=float, help="distance of the cameras [m] (0.5; for a body 3.5)"),
        _option("--fps", type=float, default=25.0),
        _option("--no-images", action="store_true", help="masks alone, no videos"),
        _number("--joints-px", float, 0, 100, metavar="PX", help="also 2D joints like a detector's, with this error"),
        _option("--clouds", action="store_true", help="also the cameras' point clouds"),
        _option("--distortion", action="store_true", help="lenses with distortion"),
        _number("--init-noise-mm", float, 0, 100, default=5.0, help="noise of the keypoints in init.json; 0: exact pose"),
        _number("--seed", int, 0, default=0, help="random seed of motion and noise"),
    )),
    "retarget": _Command("simulate:retarget", "Fit a model's size and joint angles to a motion file (BVH, AMC, TRC, C3D).", (
        _option("file", type=Path, metavar="FILE"),
        _option("--out", type=Path, required=True, metavar="SESSION|POSES.npz", help="a session's folder to make, or a file of poses"),
        _option("--model", metavar="NAME", help="body34, hand26 or another (default: the one that the file's joint names match)"),
        _SIDE, *_MOTION,
        _option("--fps", dest="motion_fps", type=float, metavar="RATE", help="frames per second, if the file has no rate (AMC)"),
        _option("--scale", type=Path, metavar="FILE.json", help="a person's saved size (default: fitted)"),
    )),
    "model": _Command("checks:check_model", "Check a model definition, or convert a URDF, MJCF or BVH to one.", (
        _option("action", choices=("check",), help="what to do"),
        _option("file", type=Path, metavar="FILE", help="a definition (.toml), or a URDF, MJCF or BVH"),
        _option("--out", type=Path, metavar="FILE", help="also write it, as an editable definition (.toml) or a robot (.urdf)"),
    )),
    "warmup": _Command("checks:compile_kernels", "Compile the kernels now instead of at the first frame.", ()),
    "detect": _Command("detection:detect", "Find the hand in a session's images and write its 21 joints as files.", (
        _SESSION, _FRAMES,
        _option("--weights", type=Path, metavar="FILE",
                help="the detector's weights (default: from HANDTRACK_DETECTOR, or from `handtrack detector install`)"),
        _CAMERAS,
        _number("--every", int, 1, default=1, metavar="N", help="only every N-th frame (default: 1)"),
        _option("--write", action="store_true", help="also use these joints in session.toml"),
        _option("--masks", action="store_true", help="with --write: also segment from them (method seeded), unless masks are files"),
        _option("--backend", choices=("opencv", "litert"), help="runtime of the networks (default: litert if installed)"),
    )),
    "masks": _Command("detection:segment_again", "Re-segment the images with the tracked poses and save the masks.", (
        _SESSION,
        _option("--poses", type=Path, metavar="FILE.npz", help="tracked poses (default: the session's tracks/poses.npz)"),
        _CAMERAS,
        _option("--write", action="store_true", help="also use these masks in session.toml"),
    )),
    "detector": _Command("detection:install", "Install the hand detector's weights for all sessions.", (
        _option("action", choices=("install",), help="what to do"),
        _option("file", nargs="?", type=Path, metavar="FILE",
                help="hand_landmarker.task, or a wheel of MediaPipe that contains it (default: fetched by pip, 36 MB)"),
    )),
    "stereo": _Command("detection:match_stereo", "Match calibrated pairs of images and write point clouds.", (
        _SESSION, _FRAMES,
        _option("--out", type=Path, metavar="FOLDER", help="folder for the .ply files (default: SESSION/clouds)"),
    )),
    "calibrate": _Command("calibration:calibrate", "Print a calibration board, or calibrate cameras from images or videos of it.", (
        _option("--out", type=Path, required=True, metavar="FILE.toml|.pdf|.svg|.png",
                help="calibration to write; or the board, to print in its true size"),
        _option("--board", required=True, metavar="BOARD",
                help="chessboard:9x6:25mm (inner corners, square) or charuco:7x5:30mm:22mm:DICT_4X4_50 (squares, square, marker)"),
        _number("--dpi", float, 50, 2400, default=300.0, help="resolution of a board's PNG (300)"),
        _by_camera("--camera", ("NAME=FILES", "FILES"), nargs="+",
                help="images (pattern or folder) or a video, matched between cameras by frame number; once per camera"),
        _by_camera("--intrinsics", ("NAME=FILES", "FILES"), nargs="+",
                help="more images or a video for this camera's lens alone"),
        _option("--known", type=Path, metavar="FILE.toml", help="keep the lenses of the cameras in this calibration"),
        _option("--world", metavar="camera:NAME|board:FRAME", help="the world's frame (default: the first camera's)"),
        _option("--no-k3", action="store_true", help="hold the third radial coefficient at 0"),
        _option("--no-tangential", action="store_true", help="hold p1 and p2 at 0"),
        _number("--most-views", int, 3, default=40, metavar="N", help="views used per camera, sharp and spread"),
        _number("--most-images", int, 3, default=400, metavar="N", help="images searched per camera, evenly"),
        _option("--bayer", metavar="PATTERN", help="images are raw mosaics: RGGB, BGGR, GRBG or GBRG"),
    )),
    "doctor": _Command("doctor:check_session", "Check a session folder and report problems.", (
        _SESSION,
        _option("--picture", type=Path, metavar="FILE.png", help="also draw the cameras, and the hand if joints locate it; suspect cameras are orange"),
    )),
    "completion": _Command("completion:print_script", "Print the script by which a shell completes commands, options and files.", (
        _option("shell", choices=("bash", "zsh"), help='print the completion script of this shell. bash: add eval "$(handtrack completion bash)" to ~/.bashrc; zsh: write it to a file _handtrack in a folder of $fpath'),
    ), False),
    "bench": _Command("checks:run_benchmarks", "Run the benchmarks: each figure beside its reference, in one run.", (
        _option("name", nargs="?", help="one benchmark (default: all quick ones)"),
    )),
}  # fmt: skip
"""by name"""

COMMAND_GROUPS = {
    "workbench": ("open", "demo", "sample"),
    "tracking": ("new", "track", "batch", "takes", "export", "evaluate"),
    "preparing a recording": ("doctor", "calibrate", "detect", "detector", "masks", "stereo"),
    "a person": ("person", "skin", "retarget"),
    "models and tests": ("model", "simulate", "bench", "warmup", "completion"),
}  # fmt: skip
"""in the order of `handtrack --help`; an alias, such as `size`, is in none"""
EARLIER_COMMANDS = {"start": ("open", "--choose"), "board": ("calibrate",), "spread": ("person", "--spread")}  # fmt: skip
"""for one more release, by what does the same now"""


def _listing() -> str:
    """Return the commands in groups, for `--help`."""
    lines = []
    for group, names in COMMAND_GROUPS.items():
        lines += ["", f"{group}:", *(f"    {name:<10} {COMMANDS[name].help}" for name in names)]
    return "\n".join(lines[1:])


def build_parser(
    names: Iterable[str] = COMMANDS, described: bool = False
) -> argparse.ArgumentParser:
    """Return the parser of some commands: all take a third of the start. described: each in the parser's own list too, from
    which shtab knows them.
    """
    parser = argparse.ArgumentParser(
        prog="handtrack",
        description="Track the full 3D pose of a hand by fitting an articulated model to the images of calibrated cameras.",
        epilog=_listing()
        + "\n\nWithout a command, the workbench opens in the browser. Options: `handtrack COMMAND --help`.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument(
        "--version",
        action="version",
        version=f"handtrack {VERSION}",
        help="show the version and end",
    )
    commands = parser.add_subparsers(
        dest="command", metavar="COMMAND", help="see below", required=True
    )
    for name in names:
        _, words, options, has_json = COMMANDS[name]
        listed: dict[str, Any] = {"help": words} if described else {}
        command = commands.add_parser(name, description=words, allow_abbrev=False, **listed)
        for names, how in options:
            command.add_argument(*names, **how)  # type: ignore[arg-type]
        if has_json:
            command.add_argument("--json", action="store_true", help="print JSON")
    return parser


if __name__ == "__main__":
    sys.exit(main())
