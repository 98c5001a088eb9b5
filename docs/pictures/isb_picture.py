"""Draws docs/figures/isb.png: what each positive angle of the ISB's convention means, right and left. Run: python -m docs.pictures.isb_picture"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from docs.pictures.plotting import pyplot, saved
from handtrack.arrays import Floats
from handtrack.export.isb import isb_angles
from handtrack.export.shown import joint_links, model_skin
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.kinematics import BonePoses
from handtrack.model.model_file import load_model

# title; what is set before, and after [°]; the angle that is written below; from which side one looks: the palm, or the thumb's side
PANELS = (
    ("wrist: flexion", {}, {"wrist_flex": 35}, "wrist_flexion", "thumb"),
    ("wrist: ulnar deviation", {}, {"wrist_abd": -25}, "wrist_ulnar_deviation", "palm"),
    ("finger: flexion", {}, {"index_mcp_flex": 50, "index_pip_flex": 40}, "index_mcp_flexion", "thumb"),
    ("finger: ulnar deviation", {}, {"little_mcp_abd": 25}, "little_mcp_ulnar_deviation", "palm"),
    ("thumb's base: flexion", {"thumb_cmc_abd": 18}, {"thumb_cmc_abd": 18, "thumb_cmc_flex": 40}, "thumb_cmc_flexion", "palm"),
    ("thumb's base: adduction", {"thumb_cmc_abd": 55}, {}, "thumb_cmc_adduction", "thumb"),
)  # fmt: skip
_AXES = (("X palm", "#d62728", (0, 0, -1)), ("Y body", "#2ca02c", (0, -1, 0)), ("Z thumb", "#1f77b4", (-1, 0, 0)))  # fmt: skip
_ARROW_M = 0.035


def draw() -> Any:
    """Return the figure: a row for each hand, grey at rest, drawn where the angle is positive."""
    figure, axes = pyplot().subplots(2, len(PANELS), figsize=(14, 6.4))
    for row, side in zip(axes, ("right", "left"), strict=True):
        model = load_model("hand26", side=side, forearm=True)
        for axis, (title, start, turned, name, seen) in zip(row, PANELS, strict=True):
            rest, moved = _bones(model, start), _bones(model, turned)
            _hand(axis, model, rest, seen, "0.85", "0.7")
            _hand(axis, model, moved, seen, "#e8c3a4", "#7a4a2a")
            _segment_axes(axis, model, moved, seen, name)
            before, after = (
                np.rad2deg(isb_angles(model, b.T_world_bone[None])[name][0]) for b in (rest, moved)
            )
            axis.set_title(f"{side} {title}", fontsize=9)
            axis.text(0.5, -0.02, f"{name}: {round(before)}° → {round(after)}°", transform=axis.transAxes, ha="center", fontsize=8)  # fmt: skip
            axis.set_aspect("equal")
            axis.set_axis_off()
    for label, colour, _ in _AXES:
        axes[1][0].plot([], [], color=colour, label=label)
    figure.legend(*axes[1][0].get_legend_handles_labels(), loc="lower center", ncols=3, frameon=False, fontsize=9)  # fmt: skip
    figure.tight_layout(rect=(0, 0.06, 1, 1))
    return figure


def _bones(model: ArticulatedModel, values: Mapping[str, float]) -> BonePoses:
    """Return a pose [°] with the forearm upright, wherever the hand turns."""
    bones = model.bones(model.params_from({k: float(np.deg2rad(v)) for k, v in values.items()}))
    turn = bones.rotation[model.skeleton.bone("forearm")] @ np.diag([-1.0, -1.0, 1.0])
    position = (bones.position - bones.position[0]) @ turn
    return BonePoses(position[0], turn.T @ bones.rotation, position)


def _seen(points: Floats, seen: str, side: str) -> Floats:
    """Return what one sees from the palm's side, fingers up, or from the thumb's."""
    if seen == "palm":
        return points[..., :2] * (-1.0, 1.0)
    return points[..., [2, 1]] * (1.0 if side == "right" else -1.0, 1.0)


def _hand(
    axis: Any, model: ArticulatedModel, bones: BonePoses, seen: str, flesh: str, line: str
) -> None:
    skin = model_skin(model)
    points, _ = skin.carried(bones)
    points = points[points[:, 1] > -0.09]  # the forearm goes on
    flat = _seen(points, seen, model.side)
    axis.plot(*flat.T, ".", color=flesh, markersize=2.4, zorder=1)
    joints = _seen(model.joint_positions(bones), seen, model.side)
    for pair in joint_links(model):
        axis.plot(*joints[list(pair)].T, color=line, lw=1.2, zorder=2)


def _segment_axes(
    axis: Any, model: ArticulatedModel, bones: BonePoses, seen: str, name: str
) -> None:
    distal = {
        "wrist": "middle_metacarpal",
        "index": "index_proximal",
        "little": "little_proximal",
        "thumb": "thumb_metacarpal",
    }
    bone = model.skeleton.bone(distal[name.split("_", maxsplit=1)[0]])
    thumbwards = 1.0 if model.side == "right" else -1.0
    for label, colour, direction in _AXES:
        wanted = np.array(direction, float) * (thumbwards if label.startswith("Z") else 1.0)
        start, tip = bones.position[bone], bones.position[bone] + _ARROW_M * bones.rotation[bone] @ wanted  # fmt: skip
        flat = _seen(np.array([start, tip]), seen, model.side)
        if np.linalg.norm(flat[1] - flat[0]) > 0.2 * _ARROW_M:
            axis.annotate("", flat[1], flat[0], arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 1.8}, zorder=4)  # fmt: skip


if __name__ == "__main__":
    saved(draw(), Path(sys.argv[1] if len(sys.argv) > 1 else "docs/figures") / "isb.png")
