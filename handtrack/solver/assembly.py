"""Add the two ledgers, bone twists and joint parameters, up to one small normal system."""

from __future__ import annotations

from collections.abc import Sequence

from handtrack.arrays import Floats, P
from handtrack.model.articulated import ArticulatedModel
from handtrack.terms.bone_system import BoneSystem, JointSystem
from handtrack.terms.term import ObservationTerm, ParameterTerm


def assemble(
    model: ArticulatedModel,
    params: Floats[P],
    observation_terms: Sequence[ObservationTerm],
    parameter_terms: Sequence[ParameterTerm],
) -> JointSystem:
    """Return the sum of all terms at solver parameters, as a system in them."""
    bones, twist_jacobian, joint_params = model.linearize(params)
    systems = [term.linearize(bones) for term in observation_terms]
    seen = sum(systems[1:], systems[0]) if systems else BoneSystem.zero(len(bones.position))
    joints = seen.pull_back(twist_jacobian)
    for prior in parameter_terms:
        joints = joints + prior.linearize(joint_params)
    return joints.pull_back(model.transform.matrix)
