"""The program `handtrack`: reads the command line and hands over to one module per command."""

from __future__ import annotations

import argparse
import errno
import importlib
import io
import math
import os
import sys
import tomllib
from collections.abc import Callable, Iterable, Mapping
from inspect import signature
from pathlib import Path
from typing import TYPE_CHECKING, Any

from handtrack.errors import HandtrackError, not_enough_memory, unknown_name
from handtrack.export.registry import FORMATS
from handtrack.version import VERSION

if TYPE_CHECKING:
    from handtrack_app.commands.output import Answer

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
    words = [*_TOLD["earlier"].get(words[0], words[:1]), *words[1:]]
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
    from handtrack_app.commands.output import Answer

    os.environ.setdefault("OPENCV_FFMPEG_CAPTURE_OPTIONS", CAPTURE_OPTIONS)
    try:
        run = function_of(args.command)
        values = {**vars(args), "options": args}
        result = run(**{name: values[name] for name in signature(run).parameters})
        code = result.print(args.json) if isinstance(result, Answer) else result
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


def function_of(command: str) -> Callable[..., int | Answer]:
    """Return a command's function. It takes its options by their names; where they are many, `options` has them all. It returns its
    answer, or the exit code where it has printed that.
    """
    module, name = COMMANDS[command]["runs"].split(":")
    return getattr(importlib.import_module(f"handtrack_app.commands.{module}"), name)


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


_TOLD: dict[str, Any] = tomllib.loads(
    Path(__file__).with_name("commands").joinpath("commands.toml").read_text("utf-8")
)
COMMANDS: dict[str, dict[str, Any]] = _TOLD["command"]
"""by name, as commands.toml has them"""
COMMAND_GROUPS: dict[str, list[str]] = _TOLD["groups"]
"""in the order of `handtrack --help`"""


_KINDS: dict[str, Callable[[str], Any]] = {"path": Path, "int": int, "number": float}


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


def _within(name: str, kind: Callable[[str], Any], low: float, high: float) -> Callable[[str], Any]:
    """Return what reads an option that is a number from low to high."""

    def read(text: str) -> float:
        value = kind(text)
        if not low <= value <= high:
            expected = f"at least {low:g}" if high == math.inf else f"{low:g} to {high:g}"
            raise HandtrackError(f"{name} {text}: expected {expected}.")
        return value

    read.__name__ = kind.__name__  # as argparse names it where it is no number
    return read


def _add_option(command: argparse.ArgumentParser, name: str, told: Mapping[str, Any]) -> None:
    """Add an option as commands.toml has it."""
    how = dict(told or _TOLD["shared"][name])
    kind = how.pop("kind", "text")
    if kind == "flag":
        how["action"] = "store_true"
    elif kind == "hidden":
        how["help"] = argparse.SUPPRESS
    elif kind == "by camera":
        how |= {"action": _ByCamera, "default": {}}
    elif kind != "text":
        how["type"] = _KINDS[kind]
    if "range" in how:
        how["type"] = _within(name, how["type"], *how.pop("range"))
    if isinstance(how.get("metavar"), list):
        how["metavar"] = tuple(how["metavar"])
    if "{" in how.get("help", ""):
        how["help"] = how["help"].format(
            formats=_listed([f.name for f in FORMATS], "or"),
            upright=_listed([f.name for f in FORMATS if f.up], "and"),
        )
    command.add_argument(name, **how)


def _listed(names: list[str], last: str) -> str:
    return f"{', '.join(names[:-1])} {last} {names[-1]}"


def _listing() -> str:
    """Return the commands in groups, for `--help`."""
    lines = []
    for group, names in COMMAND_GROUPS.items():
        lines += ["", f"{group}:", *(f"    {name:<10} {COMMANDS[name]['help']}" for name in names)]
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
        told = COMMANDS[name]
        words, like = told["help"], COMMANDS[told.get("like", name)]
        listed: dict[str, Any] = {"help": words} if described else {}
        command = commands.add_parser(name, description=words, allow_abbrev=False, **listed)
        for option, how in like.get("options", {}).items():
            _add_option(command, option, how)
        if told.get("json", True):
            command.add_argument("--json", action="store_true", help="print JSON")
    return parser


if __name__ == "__main__":
    sys.exit(main())
