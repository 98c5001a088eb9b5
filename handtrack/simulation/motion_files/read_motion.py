"""Anybody's motion file as joint positions in metres: its form by its content, its joints by their names, its unit and its upright axis by a person's size."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from difflib import get_close_matches
from pathlib import Path

import numpy as np

from handtrack.arrays import D3, F, Floats, J
from handtrack.capture.calibration.formats.read_calibration import BODY, HAND
from handtrack.capture.joints.given_joints import known_body_joint, known_joint
from handtrack.errors import HandtrackError, check_name
from handtrack.files.text_files import LIKELY_UNITS_M, check_file, first_bytes
from handtrack.files.toml_table import read_toml
from handtrack.model.articulated import ArticulatedModel
from handtrack.session.truth import read_markers
from handtrack.simulation.motion_files.clip import FPS, LARGEST, MotionClip, read_asf_amc, read_bvh

ACCEPTED = "BVH, AMC with its ASF, TRC, C3D, or a CSV with the columns frame and <joint>_x, _y, _z"
_SIMILAR = 1.55  # ratio to an adult's length: less than √2.54, half of what is between centimetres and inches
_AXES = ("x", "y", "z")


def read_motion(
    path: Path, skeleton: Path | None, fps: float | None, positions: str | None
) -> tuple[MotionClip, float | None, str]:
    """Return what a file says of where joints are, in its unit; metres in one unit, where it says
    that; and which form it has, in words.

    Parameters
    ----------
    skeleton
        The .asf of an .amc; without it, the only one beside it.
    fps
        Frames a second, where the file says none.
    positions
        Of a BVH, see `read_bvh`.

    Raises
    ------
    HandtrackError
    """
    check_file(path, "a motion", LARGEST)
    suffix, start = path.suffix.lower(), first_bytes(path)
    if start.lstrip()[:9].upper() == b"HIERARCHY":
        clip = read_bvh(path, positions, 1.0)
        return replace(clip, fps=fps or clip.fps), None, "BVH"
    if suffix == ".amc":
        told = (
            "AMC"
            if fps
            else "AMC (its rate, which it does not say, is that of the CMU database; --fps)"
        )
        return read_asf_amc(skeleton or _skeleton_of(path), path, fps or FPS), 1.0, told
    if suffix == ".asf":
        raise HandtrackError(
            f"{path} is a skeleton alone; give the motion, an .amc file, and this with --skeleton."
        )
    markers = read_markers(path)
    rate = fps or _rate(markers.times_s)
    if rate is None:
        raise HandtrackError(
            f"{path}: it does not say how many frames a second there are; give it with --fps."
        )
    return MotionClip(markers.names, markers.values, rate), markers.unit_m, "points in space"


def in_metres(
    clip: MotionClip, names: Mapping[str, str], kind: str, unit_m: float | None, where: str
) -> tuple[MotionClip, float, list[str]]:
    """Return a model's joints [m] in the file's axes, the metres in its unit, and what was assumed
    of that, in sentences.

    Parameters
    ----------
    clip
        In the file's unit.
    names
        The model's joints → the file's.
    kind
        Body or hand.
    unit_m
        What the file or the user says.

    Raises
    ------
    HandtrackError
        Where the unit cannot be told by a person's size.
    """
    clip = clip.renamed(names)
    subject = BODY if kind == "body" else HAND
    length = _length(clip, subject.chains)
    if unit_m is not None:
        notes = []
        if length is not None and not subject.fits(length * unit_m):
            notes.append(
                f"note: with {unit_m:g} m a unit the {kind} is {100 * length * unit_m:.3g} cm long; expected {subject.range_words}."
            )
        return MotionClip(clip.names, clip.positions * unit_m, clip.fps), unit_m, notes
    if length is None:
        raise HandtrackError(
            f"{where}: how many metres is one unit? The joints that would tell it are missing; say it with --unit-m, such as 0.01."
        )
    off = {
        word: abs(np.log(length * unit / subject.usual_m)) for word, unit in LIKELY_UNITS_M.items()
    }
    word = min(off, key=off.__getitem__)
    if off[word] > np.log(_SIMILAR):
        raise HandtrackError(
            f"{where}: its {kind} is {length:.4g} long, which is nobody in {', '.join(LIKELY_UNITS_M)}. Say how many metres one unit is with "
            f"--unit-m ({subject.usual_m / length:.3g} would make an adult). If joints are far apart, --positions may be wrong."
        )
    unit = LIKELY_UNITS_M[word]
    said = f"unit: {word}; the {kind} is {100 * length * unit:.0f} cm from {'ankle to shoulder' if kind == 'body' else 'wrist to tip'}."
    return MotionClip(clip.names, clip.positions * unit, clip.fps), unit, [said]


def upright_axis(clip: MotionClip) -> tuple[int, float] | None:
    """Return the axis along which a body's shoulders are above its hips most, and the sign; None where that is not seen.

    Somebody who lies all the time tells a wrong one.
    """
    pairs = [(f"{side}_shoulder", f"{side}_hip") for side in ("left", "right")]
    known = [(a, b) for a, b in pairs if a in clip.names and b in clip.names]
    if not known:
        return None
    up = np.mean([_of(clip, a) - _of(clip, b) for a, b in known], axis=0)
    mean = np.nanmean(up, axis=0)
    axis = int(np.argmax(np.abs(mean)))
    return axis, float(np.sign(mean[axis]))


def axis_words(axis: tuple[int, float]) -> str:
    """Return an upright axis in words, such as `+z`."""
    return f"{'+' if axis[1] > 0 else '−'}{_AXES[axis[0]]}"


def turned_upright(positions: Floats[F, J, D3], axis: tuple[int, float]) -> Floats[F, J, D3]:
    """Return positions turned so that the axis is +y, by a quarter or half turn."""
    turn = np.zeros((3, 3))
    turn[0, (axis[0] + 1) % 3] = 1.0
    turn[1, axis[0]] = axis[1]
    turn[2] = np.cross(turn[0], turn[1])
    return np.asarray(np.einsum("ij,fkj->fki", turn, positions), dtype=float)


def _of(clip: MotionClip, name: str) -> Floats[F, D3]:
    return clip.positions[:, clip.names.index(name)]


def _length(clip: MotionClip, chains: tuple[tuple[str, ...], ...]) -> float | None:
    """Return the median length of chains along their joints; parts of a chain count where all is not there."""
    found = []
    for chain in chains:
        if all(name in clip.names for name in chain):
            points = np.stack([_of(clip, name) for name in chain])
            found.append(np.linalg.norm(np.diff(points, axis=0), axis=2).sum(axis=0))
    lengths = np.concatenate(found) if found else np.zeros(0)
    lengths = lengths[np.isfinite(lengths)]
    return float(np.median(lengths)) if len(lengths) else None


def _skeleton_of(path: Path) -> Path:
    beside = sorted(p for p in path.parent.iterdir() if p.suffix.lower() == ".asf")
    same = [p for p in beside if path.stem.startswith(p.stem)]
    if len(same) == 1 or len(beside) == 1:
        return (same or beside)[0]
    raise HandtrackError(
        f"{path}: an AMC file needs its skeleton, and {'several lie' if beside else 'none lies'} beside it; give it with --skeleton "
        "FILE.asf."
    )


def _rate(times_s: Floats[F] | None) -> float | None:
    if times_s is None or len(times_s) < 2:
        return None
    step = float(np.median(np.diff(times_s)))
    return 1.0 / step if step > 0 else None


# ---- Which of the joints are which of a model's: tables of names in use, and those that users write


_LIMBS = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle", "toe")
FEWEST = 6
"""joints of which a pose can be made"""
_PREFIX = re.compile(r"^(mixamorig\d*|character\d*|bip0*1)")


def _sided(pattern: str, sides: tuple[str, str], *limbs: str) -> dict[str, str]:
    """Return names of the limbs' joints, left and right: `{s}` is the side, `{j}` the joint."""
    return {
        f"{side}_{ours}": pattern.format(s=theirs, j=limb)
        for side, theirs in zip(("left", "right"), sides, strict=True)
        for ours, limb in zip(_LIMBS, limbs, strict=False)
    }


_WORDS = ("Left", "Right")
BANDAI_JOINTS = {"chest": "Chest", "neck": "Neck", "head": "Head"} | _sided(
    "{j}_{s}", ("L", "R"), "UpperArm", "LowerArm", "Hand", "UpperLeg", "LowerLeg", "Foot", "Toes"
)
"""joints of body34 → those of the Bandai Namco Research motion data"""
CMU_JOINTS = {"chest": "upperback", "neck": "lowerneck", "head": "upperneck"} | _sided(
    "{s}{j}", ("l", "r"), "clavicle", "humerus", "radius", "hipjoint", "femur", "tibia", "foot"
)
"""joints of body34 → bones of the CMU motion capture database whose ends they are"""
CMU_WRIST_JOINTS = CMU_JOINTS | {
    f"{side}_{ours}": f"{side[0]}{theirs}"
    for side in ("left", "right")
    for ours, theirs in (("wrist", "wrist"), ("hand", "fingers"))
}
"""the same of body38: a CMU forearm is two bones in line, of which the second only rolls; the wrist bends after it"""
TABLES: dict[str, dict[str, str]] = {
    "mixamo": {"neck": "Neck", "head": "Head", "head_top": "HeadTop_End"}
    | _sided("{s}{j}", _WORDS, "Arm", "ForeArm", "Hand", "UpLeg", "Leg", "Foot", "ToeBase"),
    "xsens": {"neck": "Neck", "head": "Head"}
    | _sided(
        "{s}{j}", _WORDS, "UpperArm", "ForeArm", "Hand", "UpperLeg", "LowerLeg", "Foot", "Toe"
    ),
    "vrm": {"neck": "Neck", "head": "Head"}
    | _sided(
        "{s}{j}", _WORDS, "UpperArm", "LowerArm", "Hand", "UpperLeg", "LowerLeg", "Foot", "Toes"
    ),
    "unreal": {"neck": "neck_01", "head": "head"}
    | _sided(
        "{j}_{s}", ("l", "r"), "upperarm", "lowerarm", "hand", "thigh", "calf", "foot", "ball"
    ),
    "blender": {"neck": "neck", "head": "head"}
    | _sided("{j}.{s}", ("L", "R"), "upper_arm", "forearm", "hand", "thigh", "shin", "foot", "toe"),
    "biped": {"neck": "Neck", "head": "Head"}
    | _sided("{s} {j}", ("L", "R"), "UpperArm", "Forearm", "Hand", "Thigh", "Calf", "Foot", "Toe0"),
    "vicon": _sided("{s}{j}JC", ("L", "R"), "S", "E", "W", "H", "K", "A"),
    "bandai": BANDAI_JOINTS,
    "cmu": CMU_JOINTS,
}
"""by who writes them: joints of body34 → names in files. A BVH joint lies where its bone begins: Mixamo's `LeftArm` is the shoulder.
`vicon` are joint centres of plug-in gait; markers on the skin are no joints."""


def matched_joints(
    model: ArticulatedModel, names: Sequence[str], where: str
) -> tuple[dict[str, str], str]:
    """Return the model's joints → those of a file, by the table that knows most of them, and how they were matched, in a sentence. Raises HandtrackError where none knows enough of them."""
    tables = {"handtrack": own_table(model), "common use": _common(model, names)}
    if model.kind == "body":
        tables |= TABLES
        if any(
            "wrist" in name for name in model.parameter_names
        ):  # of others the hand is the forearm's
            tables["cmu"] = CMU_WRIST_JOINTS
    plain = {_plain(name): name for name in reversed(names)}
    found = {
        table: {
            ours: plain[_plain(theirs)]
            for ours, theirs in rows.items()
            if ours in model.joint_names and _plain(theirs) in plain
        }
        for table, rows in tables.items()
    }
    best = max(found, key=lambda table: len(found[table]))
    if len(found[best]) < min(FEWEST, len(model.joint_names)):
        raise HandtrackError(
            f"{where}: joints of unknown names: {guesses(model, names)}. Write a table, a TOML file with lines such as "
            f'{model.joint_names[-2]} = "THEIR NAME", and give it with --names FILE.'
        )
    return found[best], _matched_words(best, found[best], names)


def read_table(
    path: Path, model: ArticulatedModel, names: Sequence[str]
) -> tuple[dict[str, str], str]:
    """Return the same of a user's table: TOML, our name = "theirs". Raises HandtrackError for names that are in neither."""
    rows = read_toml(path, "a table of joints")
    for ours, theirs in rows.items():
        check_name(f"joint of {model.name}", ours, model.joint_names, str(path))
        check_name("joint", theirs, names, f"the motion file ({path}: {ours})")
    if len(rows) < min(FEWEST, len(model.joint_names)):
        raise HandtrackError(f"{path}: {len(rows)} joints; expected {FEWEST} at least.")
    return rows, _matched_words(path.name, rows, names)


def guesses(model: ArticulatedModel, names: Sequence[str]) -> str:
    """Return a file's names with what each could be, in words."""
    plain = {_plain(theirs): ours for rows in TABLES.values() for ours, theirs in rows.items()}
    plain |= {_plain(name): name for name in model.joint_names}
    words = []
    for name in names[:40]:
        near = get_close_matches(_plain(name), plain, 1, 0.7)
        words.append(
            f"{name} ({plain[near[0]]}?)" if near and plain[near[0]] in model.joint_names else name
        )
    return ", ".join(words) + (" …" if len(names) > 40 else "")


def own_table(model: ArticulatedModel) -> dict[str, str]:
    """Return the names that our BVH export gives the model's joints: a bone's where it begins, `<bone>_end` where it ends."""
    bones = model.bones(model.params_from({}))
    joints = model.joint_positions(bones)
    skeleton = model.skeleton
    heads = dict(zip(skeleton.bone_names, bones.position, strict=True))
    ends = bones.position + bones.rotation[:, :, 1] * skeleton.length[:, None]
    last = [b for b in range(len(skeleton.bone_names)) if b not in set(skeleton.parent)]
    places = {"_".join(name.split()): place for name, place in heads.items()}
    places |= {f"{skeleton.bone_names[b]}_end": ends[b] for b in last}
    found = {}
    for joint, place in zip(model.joint_names, joints, strict=True):
        near = [name for name, at in places.items() if np.linalg.norm(at - place) < 1e-6]
        if near:
            found[joint] = near[-1]
    return found


def _common(model: ArticulatedModel, names: Sequence[str]) -> dict[str, str]:
    """Return names that mean one of the model's joints in any usual spelling; of a hand, of whichever side has more."""
    if model.kind == "body":
        known = {name: known_body_joint(name) for name in names}
        return {ours: name for name, ours in known.items() if ours is not None}
    sides: dict[str, dict[str, str]] = {}
    for name in names:
        joint = known_joint(name)
        if joint is not None:
            sides.setdefault(joint[1], {}).setdefault(joint[0], name)
    return max(sides.values(), key=len, default={})


def _matched_words(table: str, rows: Mapping[str, str], names: Sequence[str]) -> str:
    """Return by which table how many joints were matched, and which of the file's were not."""
    unused = [name for name in names if name not in rows.values()]
    left = (
        f"; not used: {', '.join(unused[:12])}{' …' if len(unused) > 12 else ''}" if unused else ""
    )
    return f"{len(rows)} joints by the names of {table}{left}."


def _plain(name: str) -> str:
    bare = re.sub(r"[^a-z0-9]", "", name.rpartition(":")[2].lower())
    return _PREFIX.sub("", bare) or bare
