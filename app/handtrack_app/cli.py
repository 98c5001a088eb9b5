"""The program `handtrack`: reads the command line and hands over to one module per command."""

from __future__ import annotations

import argparse
import importlib
import io
import os
import sys
import tempfile
import traceback
from pathlib import Path
from typing import Any

from handtrack.errors import HandtrackError

EXIT_OK, EXIT_INTERNAL, EXIT_USAGE, EXIT_INTERRUPTED = 0, 1, 2, 130


def main(argv: list[str] | None = None) -> int:
    """Run one command; return its exit code (contracts §3). Never shows a traceback."""
    # Matrices here are small: threads of BLAS only get in each other's way, and change the order of sums.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    os.environ.setdefault("MKL_NUM_THREADS", "1")
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal that knows no "−" shows "?"
    parser = build_parser()
    try:
        args = parser.parse_args(sys.argv[1:] if argv is None else argv)
    except SystemExit as asked:  # --help, --version: 0; usage: 2
        return int(asked.code or EXIT_OK)
    if args.command is None:
        args = parser.parse_args(["open"])
    return _run(args)


def _run(args: argparse.Namespace) -> int:
    try:
        command = importlib.import_module(f"handtrack_app.commands.{args.module}")
        code = int(command.run(args) or EXIT_OK)
        sys.stdout.flush()
        return code
    except HandtrackError as error:
        return _told(args, str(error), EXIT_USAGE)
    except KeyboardInterrupt:
        return _told(args, "interrupted.", EXIT_INTERRUPTED)
    except BrokenPipeError:  # the reader of our output has gone, as `| head` does
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return EXIT_OK
    except OSError as error:
        if error.errno is None:
            return _told(args, _internal(error), EXIT_INTERNAL)
        where = "" if error.filename is None else f"{error.filename}: "
        return _told(args, f"{where}{error.strerror}.", EXIT_USAGE)
    except MemoryError as error:
        return _told(args, f"this needs more memory than there is. {error}".strip(), EXIT_USAGE)
    except Exception as error:
        return _told(args, _internal(error), EXIT_INTERNAL)


def _told(args: argparse.Namespace, text: str, code: int) -> int:
    paragraph = " ".join(text.splitlines())
    print(f"handtrack {args.command}: {paragraph}", file=sys.stderr)
    return code


def _internal(error: Exception) -> str:
    """Return what the user is told of a mistake of ours; the traceback goes to a file."""
    what = f"an error inside handtrack, not in your data: {type(error).__name__}: {error}."
    try:
        handle, name = tempfile.mkstemp(prefix="handtrack_error_", suffix=".log")
        with os.fdopen(handle, "w", encoding="utf-8") as log:
            log.write("".join(traceback.format_exception(error)))
    except OSError:
        return what
    return f"{what} Please report it with the command you gave and the details in {name}."


class _Version(argparse.Action):
    """Look the version up only when it is asked for."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        from importlib.metadata import PackageNotFoundError, version

        try:
            print(f"handtrack {version('handtrack')}")
        except PackageNotFoundError:
            print("handtrack (a checkout that is not installed)")
        parser.exit()


def build_parser() -> argparse.ArgumentParser:
    """Return the parser of all commands."""
    parser = argparse.ArgumentParser(
        prog="handtrack",
        description="Track the full 3D pose of a hand by fitting an articulated model to what calibrated cameras saw.",
        epilog="Without a command, the workbench opens in the browser. `handtrack COMMAND --help` tells more.",
        allow_abbrev=False,
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="show the version and end")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND")
    _add_workbench(commands)
    _add_new(commands)
    _add_track(commands)
    _add_size(commands)
    _add_results(commands)
    _add_simulate(commands)
    _add_stereo(commands)
    _add_calibrate(commands)
    _add_checks(commands)
    return parser


def _command(commands: Any, name: str, module: str, help_text: str) -> argparse.ArgumentParser:
    command = commands.add_parser(name, help=help_text, description=help_text, allow_abbrev=False)
    command.set_defaults(module=module)
    return command


def _add_workbench(commands: Any) -> None:
    for name, text in (
        ("open", "Open the workbench in the browser, on a session folder or on the bundled one."),
        ("demo", "Open the workbench on the bundled session and track it."),
    ):
        command = _command(commands, name, "workbench", text)
        if name == "open":
            command.add_argument("session", nargs="?", type=Path, help="session folder")
        command.add_argument(
            "--host", default="127.0.0.1", help="address to listen on (default: this machine only)"
        )
        command.add_argument("--port", type=int, help="port (default: 8080, or the next free one)")
        command.add_argument(
            "--no-browser", action="store_true", help="do not open a browser window"
        )
        command.add_argument(
            "--rerun", action="store_true", help="also stream residuals to rerun's viewer"
        )


def _add_new(commands: Any) -> None:
    new = _command(commands, "new", "new", "Make a session folder from videos and a calibration.")
    new.add_argument("--out", type=Path, required=True, metavar="SESSION", help="folder to make")
    new.add_argument(
        "--calibration",
        type=Path,
        required=True,
        metavar="FILE",
        help="Anipose-form calibration.toml",
    )
    new.add_argument(
        "--video",
        action="append",
        required=True,
        metavar="CAMERA=FILE",
        help="a camera's video; once per camera",
    )
    new.add_argument("--name", default="", help="the session's name")
    new.add_argument("--side", choices=("right", "left"), default="right")
    new.add_argument("--fps", type=float, help="frames a second (default: the first video's)")
    new.add_argument(
        "--world-unit-m", type=float, default=1.0, help="metres in one unit of the calibration"
    )
    new.add_argument(
        "--masks",
        choices=("skin_ycrcb", "skin_adaptive", "background_mog2", "background_median", "none"),
        default="skin_ycrcb",
        help="how silhouettes are found; settings in session.toml (default: skin_ycrcb, by skin colour)",
    )


def _add_track(commands: Any) -> None:
    track = _command(
        commands,
        "track",
        "track",
        "Track a session and save poses.npz; the workbench's engine and numbers.",
    )
    track.add_argument("session", type=Path, help="session folder")
    track.add_argument(
        "--init",
        metavar="FILE|auto",
        help="first-frame pose: a file, or `auto` to find one (default: the session's init.json)",
    )
    track.add_argument("--frames", metavar="A:B", help="frames A to B−1 (default: all)")
    track.add_argument(
        "--use",
        metavar="NAMES",
        help="of silhouettes, cloud, keypoints, edges, intensity; comma-separated",
    )
    track.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="section.key=value",
        help="a setting; may be repeated",
    )
    track.add_argument(
        "--seed", type=int, metavar="N", help="of everything random, the setting tracker.seed (default: 0)"
    )
    track.add_argument(
        "--out", type=Path, metavar="FILE.npz", help="result (default: SESSION/tracks/poses.npz)"
    )
    track.add_argument(
        "--rerun", action="store_true", help="show residuals in rerun's viewer in the browser"
    )
    track.add_argument(
        "--rerun-save", type=Path, metavar="FILE.rrd", help="record residuals to a file"
    )
    track.add_argument(
        "--rerun-frame", type=int, metavar="N", help="record every iteration of this frame"
    )


def _add_size(commands: Any) -> None:
    size = _command(
        commands, "size", "size", "Fit a person's hand size to a recording and save it for others."
    )
    size.add_argument("session", type=Path, help="session folder")
    size.add_argument("--frames", metavar="A:B", help="frames A to B−1 (default: all)")
    size.add_argument(
        "--count", type=int, default=20, metavar="N", help="of them, evenly spread, are fitted (20)"
    )
    size.add_argument(
        "--init",
        metavar="FILE|auto",
        help="first-frame pose: a file, or `auto` to find one (default: the session's init.json)",
    )
    size.add_argument("--use", metavar="NAMES", help="of silhouettes, cloud; comma-separated")
    size.add_argument(
        "--set", action="append", default=[], metavar="section.key=value", help="a setting"
    )
    size.add_argument(
        "--out", type=Path, metavar="FILE.json", help="result (default: SESSION/hand.json)"
    )


def _add_results(commands: Any) -> None:
    export = _command(commands, "export", "export", "Convert a tracked sequence.")
    export.add_argument("poses", type=Path, metavar="POSES.npz")
    export.add_argument(
        "--to", required=True, metavar="FORMAT", help="csv, csv-long, npz or keypoints"
    )
    export.add_argument("--out", type=Path, metavar="FILE", help="default: beside the poses")
    evaluate = _command(
        commands, "evaluate", "evaluate", "Compare a tracked sequence with the truth."
    )
    evaluate.add_argument("poses", type=Path, metavar="POSES.npz")
    evaluate.add_argument("--truth", type=Path, required=True, metavar="truth.npz")
    evaluate.add_argument("--json", action="store_true", help="print JSON")
    spread = _command(
        commands,
        "spread",
        "spread",
        "Measure how a person's fingers spread together, for coupling 18.",
    )
    spread.add_argument("poses", type=Path, metavar="POSES.npz")


def _add_simulate(commands: Any) -> None:
    simulate = _command(commands, "simulate", "simulate", "Make a simulated recording with truth.")
    simulate.add_argument(
        "--out", type=Path, required=True, metavar="SESSION", help="folder to make"
    )
    simulate.add_argument("--cameras", type=int, default=3)
    simulate.add_argument("--frames", type=int, default=100)
    simulate.add_argument(
        "--size", type=int, nargs=2, default=(640, 480), metavar=("W", "H"), help="pixels"
    )
    simulate.add_argument("--model", choices=("hand26", "body34"), default="hand26")
    simulate.add_argument(
        "--motion", help="open_fist_open, curl, gestures or still; of a body: dance, greet or still"
    )
    simulate.add_argument("--side", choices=("right", "left"), default="right")
    simulate.add_argument(
        "--scale", type=float, default=1.0, help="1 is a hand of 187 mm, a body of 1.75 m"
    )
    simulate.add_argument("--forearm", action="store_true", help="with a bare forearm")
    simulate.add_argument(
        "--distance", type=float, help="of the cameras [m]: 0.5, around a body 3.5"
    )
    simulate.add_argument("--fps", type=float, default=25.0)
    simulate.add_argument("--no-images", action="store_true", help="masks alone, no videos")
    simulate.add_argument("--distortion", action="store_true", help="lenses with distortion")
    simulate.add_argument(
        "--init-noise-mm",
        type=float,
        default=5.0,
        help="of the keypoints in init.json; 0: exact pose",
    )
    simulate.add_argument("--seed", type=int, default=0, help="of motion and noise")


def _add_calibrate(commands: Any) -> None:
    calibrate = _command(
        commands,
        "calibrate",
        "calibrate",
        "Calibrate cameras from images or videos of a moving board.",
    )
    board = "chessboard:9x6:25mm (inner corners, square) or charuco:7x5:30mm:22mm:DICT_4X4_50 (squares, square, marker)"
    calibrate.add_argument(
        "--out", type=Path, required=True, metavar="FILE.toml", help="calibration to write"
    )
    calibrate.add_argument("--board", required=True, metavar="BOARD", help=board)
    calibrate.add_argument(
        "--camera",
        action="append",
        nargs="+",
        default=[],
        metavar=("NAME=FILES", "FILES"),
        help="images (pattern or folder) or a video, matched between cameras by frame number; once per camera",
    )
    calibrate.add_argument(
        "--intrinsics",
        action="append",
        nargs="+",
        default=[],
        metavar=("NAME=FILES", "FILES"),
        help="more images or a video for this camera's lens alone",
    )
    calibrate.add_argument(
        "--known",
        type=Path,
        metavar="FILE.toml",
        help="keep the lenses of the cameras in this calibration",
    )
    calibrate.add_argument(
        "--world",
        metavar="camera:NAME|board:FRAME",
        help="the world's frame (default: the first camera's)",
    )
    calibrate.add_argument(
        "--no-k3", action="store_true", help="hold the third radial coefficient at 0"
    )
    calibrate.add_argument("--no-tangential", action="store_true", help="hold p1 and p2 at 0")
    calibrate.add_argument(
        "--most-views",
        type=int,
        default=40,
        metavar="N",
        help="views used per camera, sharp and spread",
    )
    calibrate.add_argument(
        "--most-images",
        type=int,
        default=400,
        metavar="N",
        help="images searched per camera, evenly",
    )
    calibrate.add_argument(
        "--bayer", metavar="PATTERN", help="images are raw mosaics: RGGB, BGGR, GRBG or GBRG"
    )
    calibrate.add_argument("--json", action="store_true", help="print the report as JSON")
    printed = _command(
        commands, "board", "board", "Write a calibration board to print, in its true size."
    )
    printed.add_argument("--out", type=Path, required=True, metavar="FILE.svg|.pdf|.png")
    printed.add_argument("--board", required=True, metavar="BOARD", help=board)
    printed.add_argument("--dpi", type=float, default=300.0, help="of a PNG; SVG and PDF are exact")


def _add_stereo(commands: Any) -> None:
    stereo = _command(
        commands, "stereo", "stereo", "Match calibrated pairs of images and write point clouds."
    )
    stereo.add_argument("session", type=Path, help="session folder")
    stereo.add_argument("--frames", metavar="A:B", help="frames A to B−1 (default: all)")
    stereo.add_argument(
        "--out", type=Path, metavar="FOLDER", help="of the .ply files (default: SESSION/clouds)"
    )


def _add_checks(commands: Any) -> None:
    doctor = _command(commands, "doctor", "doctor", "Check a session folder and say what is odd.")
    doctor.add_argument("session", type=Path, help="session folder")
    bench = _command(
        commands,
        "bench",
        "bench",
        "Run the benchmarks: each figure beside its reference, in one run.",
    )
    bench.add_argument("name", nargs="?", help="one benchmark (default: all quick ones)")
    bench.add_argument("--json", action="store_true", help="print JSON")


if __name__ == "__main__":
    sys.exit(main())
