"""`handtrack new`: a session folder from what people have."""

from __future__ import annotations

import shlex
from argparse import Namespace
from dataclasses import replace
from pathlib import Path

from handtrack.capture.calibration.formats.read_calibration import BODY, HAND
from handtrack.capture.calibration.rig_file import write_rig
from handtrack.capture.joints.given_joints import UnknownPoints
from handtrack.capture.masks.seeded import Seeded
from handtrack.capture.masks.segmentation import METHODS
from handtrack.errors import HandtrackError, unknown_name
from handtrack.files.toml_table import read_table
from handtrack.geometry.camera import CameraRig
from handtrack.model.model_file import load_model
from handtrack.session.bundled import TWO_VIDEOS, sample_names, write_sample
from handtrack.session.layout import CALIBRATION_FILE, SESSION_FILE, TRUTH_FILE, allow_links
from handtrack.session.session import Session
from handtrack.session.session_file import (
    CameraSettings,
    CloudSettings,
    HandSettings,
    LensSettings,
    RecordingSettings,
    SessionFile,
    write_session_file,
)
from handtrack.session.truth import import_truth, write_truth
from handtrack_app.cli import main
from handtrack_app.commands.new_session.given import (
    USUAL,
    USUAL_MODELS,
    Given,
    Recording,
    check_detector,
    check_sizes,
    copied,
    definition_of,
    fill_by_project,
    given_rig,
    joints_of,
    recorded_cameras,
    setting_of,
    side_of_hand,
    sizes_of,
    table_to_fill_in,
    tracking_of,
    with_joints,
    without_padding,
)
from handtrack_app.commands.output import Answer, check_new, new_folder, print_status

_RATE_TOLERANCE = 0.01
_MOST = 0.5
"""share of a camera's images in which its joints must be for its masks to be made by them"""
_WITHOUT_JOINTS = "skin_ycrcb"


def make_session(options: Namespace) -> int | Answer:
    """Make the folder; whatever is wrong is found before anything is written."""
    project = fill_by_project(options)
    recorded = recorded_cameras(options)
    _check_depth(recorded, options.depth_scale)
    check_new(options.out)
    definition = kind = None
    if options.model is not None:
        definition = definition_of(options.model)
        kind = BODY if load_model(options.model).kind == "body" else HAND
    try:
        likely = None if project is None else project.layout
        kind, recorded = with_joints(options, recorded, kind, likely)
    except UnknownPoints as error:
        table = options.out.resolve().with_name(f"{options.out.resolve().name}-names.toml")
        if options.names is None and not table.exists():
            table.write_text(table_to_fill_in(error.names), encoding="utf-8")
        raise HandtrackError(f"{error} Fill in {table}, and give it with --names.") from None
    is_hand = kind is HAND
    said = None
    if is_hand:
        sides = (joints.side for joints in joints_of(recorded).values() if joints.side)
        said = options.side or next(sides, None)
    side = said or USUAL
    truth, note = (None, "") if options.truth is None else import_truth(options.truth, side)
    rig, recorded, notes = given_rig(options, recorded, kind)
    observed = [
        name for name, cam in recorded.items() if is_hand and cam.images and cam.joints is None
    ]
    sizes = sizes_of(recorded)
    rig, padded = without_padding(rig, sizes)
    _check_cameras(recorded, rig, options)
    sizes = {camera.name: camera.size for camera in rig} | sizes
    fps, own = _frame_rates(options.fps, recorded)
    missing = check_detector(options, options.track and bool(observed))
    if options.masks == Seeded.name and options.track and observed and missing:
        raise HandtrackError(
            f"--masks {options.masks}: masks by joints, and there are none: {missing}"
        )
    method, masks = options.masks or (_WITHOUT_JOINTS if is_hand else "none"), None
    if method != "none":
        masks = read_table(METHODS[method], {}, f"--masks {method}")
    files = dict[str, Path]()
    given = [one for cam in recorded.values() for one in cam.files]
    roots = [one.files[0].resolve().parent for one in given] if options.link else []

    def setting(one: Given | None, place: str) -> str | None:
        if one is None:
            return None
        text, names = setting_of(one, place, options.link)
        files.update(names)
        return text

    late = {} if project is None else project.lag_frames
    lags = {name: frames / fps for name, frames in late.items()}
    cameras = tuple(
        CameraSettings(
            name,
            setting(cam.images, _place(i, cam.camera)),
            masks if cam.images else None,
            lens=LensSettings.of(*cam.view) if cam.view and cam.images else None,
            image_size=sizes[name] if sizes[name] != rig[name].size else None,
            depth=setting(cam.depth, f"depth/{_place(i, name)}"),
            depth_scale_m=options.depth_scale if cam.depth else None,
            keypoints=f"joints/{_place(i, name)}/*.json" if cam.joints else None,
            keypoint_layout=cam.joints.layout(side) if cam.joints else None,
            fps=own.get(name),
            lag_s=lags.get(name),
        )
        for i, (name, cam) in enumerate(recorded.items())
    )
    deep = tuple(camera.name for camera in cameras if camera.depth)
    recording = RecordingSettings(options.name or options.out.resolve().name, fps)
    clouds = CloudSettings(depth=deep) if deep else None
    report = () if project is None else project.notes
    for text in (*report, *notes, *padded, note):
        if text:
            print_status(text)
    with new_folder(options.out) as folder:
        write_rig(folder / CALIBRATION_FILE, rig)
        copied(files, folder)
        for i, (name, cam) in enumerate(recorded.items()):
            if cam.joints is not None:
                cam.joints.write(folder / "joints" / _place(i, name), side, sizes[name])
        if truth is not None:
            write_truth(folder / TRUTH_FILE, truth)
        model = options.model or USUAL_MODELS[kind]
        if definition is not None:
            model = definition.name
            copied({model: definition}, folder)
        hand = HandSettings(model, side, scale="fit")
        tracking = tracking_of(kind, recorded, sizes)
        file = SessionFile(recording, hand, cameras, clouds, tracking)
        write_session_file(folder / SESSION_FILE, file)
        if roots:
            allow_links(folder, roots)
        session = Session.open(folder)
        count = session.frame_count
        for text in session.warnings:
            print_status(f"note: {text.replace(str(folder), str(options.out))}")
        if said is None and observed and not joints_of(recorded) and not missing:
            result = side_of_hand(session, options)
            file = replace(file, hand=replace(hand, side=result))
        if options.masks is None and is_hand:
            file = _with_masks_by_joints(file, session, recorded)
        write_session_file(folder / SESSION_FILE, file)
    if roots:
        allow_links(options.out, roots)
    place = shlex.quote(str(options.out))
    made = (
        f"session of {len(cameras)} cameras and {count} frames of a {kind.word} in {options.out}."
    )
    if not options.track:
        if observed and options.masks in (None, Seeded.name) and not missing:
            print_status(
                f"Joints, and masks by them, are found with: handtrack detect {place} --write --masks"
            )
        report = {
            "session": options.out,
            "cameras": [camera.name for camera in cameras],
            "frames": count,
            "model": hand.model,
        }
        words = (
            f"{made} Look at it with: handtrack doctor {place}; then track it with: handtrack track {place} --init auto, "
            f"or pose the {kind.word} by hand with: handtrack open {place}"
        )
        return Answer(report, [words])
    print_status(made)
    on = ["--yes"] * options.yes + ["--json"] * options.json
    then = [["track", str(options.out), "--init", "auto", *on]]
    if observed and missing:
        print_status(f"note: {missing}")
    elif observed:
        weights = [] if options.detector is None else ["--weights", str(options.detector)]
        chosen = [word for name in observed for word in ("--camera", name)]
        masks = ["--masks"] if options.masks is None else []
        then.insert(0, ["detect", str(options.out), "--write", *masks, *chosen, *weights])
    return next(filter(None, map(main, then)), 0)


def _with_masks_by_joints(file: SessionFile, session: Session, recorded: Recording) -> SessionFile:
    """Return a session's settings with masks seeded by the joints of each camera that has them in most of its images."""
    joints = joints_of(recorded)

    def has_joints(camera: CameraSettings) -> bool:
        if camera.images is None or camera.name not in joints:
            return False
        return len(joints[camera.name].frames) >= _MOST * session.view(camera.name).frame_count

    by = [camera.name for camera in file.cameras if has_joints(camera)]
    if by:
        print_status(f"masks of {', '.join(by)}: by the joints (method {Seeded.name}).")
    changed = (replace(c, masks=Seeded()) if c.name in by else c for c in file.cameras)
    return replace(file, cameras=tuple(changed))


def _check_cameras(recorded: Recording, rig: CameraRig, options: Namespace) -> None:
    """Raise HandtrackError for a camera that the calibration lacks, or whose images are not of its size."""
    for name, cam in recorded.items():
        if name not in rig:
            given = cam.images or cam.depth
            where = f"--keypoints {name}={cam.keypoints}" if given is None else given.where
            raise HandtrackError(
                f"{where}: {' and '.join(map(str, options.calibration))} has no camera '{name}'; cameras there: "
                f"{', '.join(rig.names)}."
            )
        check_sizes(cam, rig[name], options.scaled)


def _check_depth(recorded: Recording, scale: float | None) -> None:
    deep = [cam.depth for cam in recorded.values() if cam.depth is not None]
    if deep and scale is None:
        raise HandtrackError(
            f"{deep[0].where}: how many metres is one unit of these files? Give it with --depth-scale: 0.001 for millimetres "
            "(Kinect, many RealSense), 0.0001 for a RealSense D405."
        )
    if scale is not None and not deep:
        raise HandtrackError("--depth-scale is about depth files, but no --depth is given.")


def _frame_rates(asked: float | None, recorded: Recording) -> tuple[float, dict[str, float]]:
    """Return the session's frames a second, and those of cameras that differ."""
    if asked is not None:
        return asked, {}
    rates = {name: cam.images.fps for name, cam in recorded.items() if cam.images is not None}
    known = [rate for rate in rates.values() if rate > 0]
    if not known:
        raise HandtrackError("no recording states its frame rate; give it with --fps.")
    fps = known[0]
    own = {
        name: rate
        for name, rate in rates.items()
        if rate > 0 and abs(rate / fps - 1) > _RATE_TOLERANCE
    }
    for name, rate in own.items():
        print_status(
            f"note: the video of camera '{name}' says {rate:g} frames a second, the first {fps:g}: its frames will be taken "
            "by time. If all have one rate, begin anew with --fps."
        )
    return fps, own


def _place(index: int, camera: str) -> str:
    plain = camera.isascii() and camera.replace("_", "").replace("-", "").isalnum()
    return camera if plain else f"video{index}"


# ---- `handtrack sample`: a recording that comes with the program, as files


def save_sample(name: str, to: Path) -> Answer:
    """Write the sample into a new folder and name what is in it."""
    if name not in sample_names():  # before anything is made
        raise unknown_name("sample", name, sample_names())
    check_new(to, "--to")
    with new_folder(to) as folder:
        files = [path.relative_to(folder) for path in write_sample(name, folder)]
    shown = ", ".join(map(str, files[:6])) + (" …" if len(files) > 6 else "")
    words = [f"{len(files)} files in {to}: {shown}"]
    if name != TWO_VIDEOS:
        words.append(f"Open it with: handtrack open {shlex.quote(str(to))}")
    return Answer({"sample": name, "folder": to, "files": files}, words)
