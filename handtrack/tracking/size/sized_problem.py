"""What a frame says of its pose and of a person's size, as one system."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from handtrack.arrays import Floats, N, P
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.kinematics import BoneFields
from handtrack.solver.problem import Problem
from handtrack.terms.bone_system import JointSystem
from handtrack.terms.keypoints import KeypointTerm
from handtrack.terms.silhouettes.silhouette_terms import FieldTerm
from handtrack.terms.term import ObservationTerm
from handtrack.tracking.size.person import PersonChange


def linearize_sized(
    problem: Problem,
    person: PersonChange,
    pose: Floats[P],
    moves: Floats[P, N],
    outline: Floats[N] | None = None,
) -> JointSystem:
    """Return what a frame's observations say of N changes of its pose, and of the free ones of a person's deviations (K,), N + K
    numbers, without a size's prior.

    moves: how solver parameters change with the N. outline: by how much each of them sets outlines farther out [m].
    """
    if not person.count and outline is None:
        return replace(problem, parameter_terms=()).linearize(pose).pull_back(moves)
    model = person.model
    bones, twists, _ = model.linearize(pose)
    fields = BoneFields.of_twists(
        twists @ (model.transform.matrix @ moves), len(model.joint_names), outline
    )
    if person.count:
        fields = fields.beside(person.parameters.fields(bones, np.flatnonzero(person.free)))
    system = JointSystem.zero(fields.joints.shape[2])
    for term in terms_of(problem, model):
        system += term.linearize(bones, fields)
    return system


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
