"""Which named joints are connected by bones: the lines of a stick figure."""

from __future__ import annotations

from handtrack.model.articulated import ArticulatedModel


def joint_links(model: ArticulatedModel) -> list[tuple[int, int]]:
    """Return pairs of joints (nearer to the root, farther): each hangs on the one before it along the bones."""
    at_head: dict[int, int] = {}
    for joint, (bone, point) in enumerate(zip(model.joint_bone, model.joint_point)):
        if not point.any():
            at_head.setdefault(int(bone), joint)
    links = []
    for joint, bone in enumerate(model.joint_bone):
        above = int(bone)
        if at_head.get(above) == joint:
            above = int(model.skeleton.parent[above])
        while above >= 0 and above not in at_head:
            above = int(model.skeleton.parent[above])
        if above >= 0:
            links.append((at_head[above], joint))
    return links
