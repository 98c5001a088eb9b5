"""Which of a motion file's joints are which of a model's: tables of names in use, and those that users write."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path

import numpy as np

from handtrack.capture.joints.joint_names import known_body_joint, known_joint
from handtrack.errors import HandtrackError, check_name
from handtrack.files.toml_text import read_toml
from handtrack.model.articulated import ArticulatedModel

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
    return found[best], _words(best, found[best], names)


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
    return rows, _words(path.name, rows, names)


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


def _words(table: str, rows: Mapping[str, str], names: Sequence[str]) -> str:
    """Return by which table how many joints were matched, and which of the file's were not."""
    unused = [name for name in names if name not in rows.values()]
    left = (
        f"; not used: {', '.join(unused[:12])}{' …' if len(unused) > 12 else ''}" if unused else ""
    )
    return f"{len(rows)} joints by the names of {table}{left}."


def _plain(name: str) -> str:
    bare = re.sub(r"[^a-z0-9]", "", name.rpartition(":")[2].lower())
    return _PREFIX.sub("", bare) or bare
