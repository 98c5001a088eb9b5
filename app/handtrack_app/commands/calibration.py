"""`handtrack calibrate`: images or videos of a moving board → calibration.toml, with a report; the board to print."""

from __future__ import annotations

import glob
from argparse import Namespace
from collections.abc import Sequence
from pathlib import Path

import cv2

from handtrack.arrays import Array
from handtrack.capture.calibration.boards import (
    FORMATS,
    Board,
    CameraViews,
    frames_to_search,
    natural_order,
    page_size_mm,
    parse_board,
    require_views,
    search_views,
    write_board,
)
from handtrack.capture.calibration.rig_calibration import (
    CalibrationSettings,
    RigCalibration,
    calibrate_rig,
    report_text,
)
from handtrack.capture.calibration.rig_file import read_rig, write_rig
from handtrack.capture.calibration.rig_picture import draw_calibration, draw_residuals
from handtrack.capture.images.frames import IMAGE_SUFFIXES, FrameSource, ImageFiles
from handtrack.capture.images.raw_frames import PATTERNS, MosaicFiles
from handtrack.capture.images.video import VideoFile
from handtrack.errors import HandtrackError, unknown_name
from handtrack.files.atomic import keep_version, replacing
from handtrack_app.commands.output import Answer, output_file, print_status, progress_bar

_Inputs = dict[str, dict[str, FrameSource]]
"""by camera, its sources: `shared`, matched between cameras by frame number, and `alone`, of its lens"""


def calibrate(options: Namespace) -> int | Answer:
    """Find the board, calibrate, write calibration.toml and the report; print the report. Or write the board."""
    board = parse_board(options.board)
    if options.out.suffix.lower() in FORMATS:
        return _save_board(board, options.out, options.dpi)
    if options.bayer and options.bayer not in PATTERNS:
        raise unknown_name("Bayer pattern", options.bayer, PATTERNS, "--bayer")
    output_file(options.out, (".toml",), "calibrations are")
    inputs = _inputs(options)
    known = read_rig(options.known) if options.known else None
    if known is not None and not inputs.keys() & set(known.names):
        raise HandtrackError(
            f"--known {options.known}: none of its cameras ({', '.join(known.names)}) is calibrated here; the names after "
            "--camera must be the same."
        )
    cameras = _searched(inputs, board, options.most_images)
    require_views(board, cameras, lambda camera: _some_images(inputs[camera.name], camera))
    settings = CalibrationSettings(
        k3=not options.no_k3,
        tangential=not options.no_tangential,
        most_views=options.most_views,
        world=options.world or "",
        known={camera.name: camera for camera in known or ()},
    )
    calibration = calibrate_rig(board, cameras, settings)
    _write_report(calibration, board, options)
    if wrong := calibration.report["contradictions"]:
        raise HandtrackError(f"{' '.join(wrong)} {options.out} was not written; the report was.")
    previous = keep_version(options.out)
    with replacing(options.out) as part:
        write_rig(part, calibration.rig)
    print_status(
        f"wrote {options.out}{f'; the one before is kept as {previous}' if previous else ''}"
    )
    return 0


def _inputs(options: Namespace) -> _Inputs:
    inputs = _Inputs()
    uses = (("shared", "--camera", options.camera), ("alone", "--intrinsics", options.intrinsics))
    for use, option, given in uses:
        for name, parts in given.items():
            source = _source(parts, f"{option} {name}", options.bayer, synchronised=use == "shared")
            inputs.setdefault(name, {})[use] = source
    if not inputs:
        raise HandtrackError(
            "no camera given: --camera NAME=FILES (images, a folder or a video), once per camera."
        )
    return inputs


def _expanded(part: str, where: str) -> list[Path]:
    path = Path(part)
    if path.is_dir():
        files = [p for p in path.iterdir() if p.suffix.lower() in IMAGE_SUFFIXES]
    else:
        paths = [path] if path.is_file() else map(Path, glob.glob(part, recursive=True))
        files = [p for p in paths if p.is_file()]
    if not files:
        raise HandtrackError(
            f"{where}: nothing found at {part}; expected images, a folder of them, or a video."
        )
    return natural_order(files)


def _source(
    parts: Sequence[str], where: str, pattern: str | None, synchronised: bool
) -> FrameSource:
    """Return a camera's images or video; the shell may have listed its files already."""
    paths = [path for part in parts for path in _expanded(part, where)]
    images = [path for path in paths if path.suffix.lower() in IMAGE_SUFFIXES]
    if len(paths) == 1 and not images and not pattern:
        return VideoFile(paths[0], where=str(paths[0]))
    if len(images) < len(paths):
        other = next(path for path in paths if path not in images)
        raise HandtrackError(f"{where}: {other} is no image; expected either images or one video.")
    # of a lens alone by their order: no other camera must agree
    folder, in_order = str(paths[0].parent), not synchronised
    if pattern:
        return MosaicFiles(paths, pattern, where=folder, in_order=in_order)
    return ImageFiles(paths, where=folder, in_order=in_order)


def _searched(inputs: _Inputs, board: Board, most: int) -> list[CameraViews]:
    """Return what each camera saw of the board."""
    shared = [sources["shared"] for sources in inputs.values() if "shared" in sources]
    shared_frames = frames_to_search(shared, most)
    plans = {
        name: [
            (
                source,
                shared_frames if use == "shared" else frames_to_search([source], most),
                use == "alone",
            )
            for use, source in sources.items()
        ]
        for name, sources in inputs.items()
    }
    every = (part for searched in plans.values() for part in searched)
    total = sum(source.has(frame) for source, frames, _ in every for frame in frames)
    with progress_bar(total, "looking for the board") as bar:
        return [search_views(name, plan, board, bar.update) for name, plan in plans.items()]


def _some_images(sources: dict[str, FrameSource], camera: CameraViews) -> list[Array]:
    """Return three images of a camera, of those with the board where there are some."""
    use, source = next(iter(sources.items()))
    seen = [frame for lens_of, frame in camera.views if bool(lens_of) == (use == "alone")]
    frames = seen or [frame for frame in source.frames if source.has(frame)]
    picked = [frames[i * (len(frames) - 1) // 2] for i in range(3)] if frames else []
    read = (source.read(frame) for frame in dict.fromkeys(picked))
    return [image for image in read if image is not None]


def _write_report(calibration: RigCalibration, board: Board, options: Namespace) -> None:
    """Print the report; beside calibration.toml leave it as text, and two pictures."""
    text = report_text(calibration.report)
    stem = options.out.with_suffix("")
    files = {Path(f"{stem}_report.txt"): (text + "\n").encode()}
    pictures = {
        "rig": draw_calibration(calibration, board),
        "residuals": draw_residuals(calibration),
    }
    for name, picture in pictures.items():
        files[Path(f"{stem}_{name}.png")] = cv2.imencode(".png", picture)[1].tobytes()
    for path, content in files.items():
        with replacing(path) as part:
            part.write_bytes(content)
    Answer(calibration.report, [text]).print(options.json)
    print_status(f"wrote {', '.join(map(str, files))}")


# ---- the board to print


_PAPERS_MM = {
    "A4": (210, 297),
    "A3": (297, 420),
    "A2": (420, 594),
    "A1": (594, 841),
    "letter": (216, 279),
}


def _save_board(printed: Board, out: Path, dpi: float) -> Answer:
    """Write the board and say how large it must come out of the printer."""
    output_file(out, FORMATS, "boards are")
    width, height = page_size_mm(printed)
    if out.suffix.lower() == ".png" and width * height * (dpi / 25.4) ** 2 > 2e8:
        raise HandtrackError(
            f"--out {out}: {width:.0f} x {height:.0f} mm at {dpi:g} dpi is too large a picture; "
            "write .svg or .pdf, which are exact, or choose a smaller --dpi."
        )
    keep_version(out)
    with replacing(out) as part:
        write_board(part, printed, dpi)
    columns, rows = printed.squares
    side = printed.square_m * 1e3
    fits = [
        name
        for name, size in _PAPERS_MM.items()
        if max(width, height) <= max(size) and min(width, height) <= min(size)
    ]
    words = (
        f"{out}: {printed.text}, page {width:g} x {height:g} mm"
        f"{f' (fits {fits[0]})' if fits else ' (larger than A1)'}. Print at 100 % (actual size) and measure: "
        f"{columns} squares must be {columns * side:g} mm wide, {rows} squares {rows * side:g} mm high; if not, "
        "give the measured square to `handtrack calibrate`. Glue it to something flat and stiff."
    )
    report = {"output": out, "page_mm": [width, height], "squares": [columns, rows], "square_mm": side}  # fmt: skip
    return Answer(report, [words])
