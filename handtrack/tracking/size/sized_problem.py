"""What a frame says of its pose and of a person's size, as one system."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from handtrack.arrays import Array, Floats, N, P
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.kinematics import BoneFields
from handtrack.model.size import SizeParameters
from handtrack.solver.problem import Problem
from handtrack.terms.bone_system import JointSystem
from handtrack.terms.keypoints import KeypointTerm
from handtrack.terms.silhouettes.silhouette_field import FieldTerm
from handtrack.terms.term import ObservationTerm


def linearize_sized(
    problem: Problem,
    model: ArticulatedModel,
    size: SizeParameters,
    free: Array[N],
    pose: Floats[P],
    outline: bool = False,
) -> JointSystem:
    """Return a frame's system in its pose and the free ones of the deviations (K,), P + K numbers, without a size's prior; then,
    if wished, by how much its masks are wider.

    model: `size.rescaled`, of the size around which the system holds.
    """
    bones, twists, joint = model.linearize(pose)
    fields = BoneFields.of_twists(twists, len(model.joint_names))
    if free.any():
        fields = fields.beside(size.fields(bones).chosen(free))
    fields = fields.with_outline() if outline else fields
    count, both = twists.shape[2], fields.joints.shape[2]
    system = JointSystem.zero(both)
    for term in terms_of(problem, model):
        system += term.linearize(bones, fields)
    gradient, hessian, cost = system.gradient, system.hessian, system.cost
    for prior in problem.parameter_terms:
        known = prior.linearize(joint)
        cost += known.cost
        gradient[:count] += known.gradient
        hessian[:count, :count] += known.hessian
    matrix = np.zeros((both, len(pose) + both - count))
    matrix[:count, : len(pose)] = model.transform.matrix
    matrix[count:, len(pose) :] = np.eye(both - count)
    return JointSystem(cost, gradient, hessian).pull_back(matrix)


def terms_of(problem: Problem, model: ArticulatedModel) -> list[ObservationTerm]:
    """Return a problem's terms of what was seen, where the joints that a detector means are this model's."""
    return [
        replace(term, model=model) if isinstance(term, KeypointTerm) else term
        for term in problem.observation_terms
    ]


def with_wider(problem: Problem, by_m: float) -> Problem:
    """Return a problem of masks in which the outline of a hand is so much farther out than the hand's own."""
    if by_m == 0.0:
        return problem
    terms = [t.wider(by_m) if isinstance(t, FieldTerm) else t for t in problem.observation_terms]
    return replace(problem, observation_terms=terms)
