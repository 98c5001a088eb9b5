"""What robot and OpenSim files are made of: XML with numbers in one form, and masses and inertia of bones, by their ellipsoids."""

from __future__ import annotations

from xml.etree import ElementTree

import numpy as np

from handtrack.arrays import D3, Axes, B, Floats, N
from handtrack.model.articulated import ArticulatedModel

_DENSITY = 1080.0  # kg/m³ of a hand or forearm: Clauser et al. 1969 have 1,080 to 1,110 for limbs
LEAST_MASS_KG = 1e-4
"""of what has no flesh of its own: OpenSim and MuJoCo refuse bodies without mass"""
LEAST_INERTIA = 1e-9
"""kg m²"""


def bone_masses(
    model: ArticulatedModel,
) -> tuple[Floats[B], Floats[B, D3], Floats[B, D3, D3]]:
    """Return each bone's mass [kg], and in its own frame the centre [m] and the inertia about that [kg m²].

    Overlaps of ellipsoids count twice: for looking and inverse kinematics, not for forces.
    """
    ellipsoids, count = model.ellipsoids["fine"], model.skeleton.bone_count
    mass, centre = np.full(count, LEAST_MASS_KG), np.zeros((count, 3))
    inertia = np.tile(LEAST_INERTIA * np.eye(3), (count, 1, 1))
    weights = _DENSITY * 4.0 / 3.0 * np.pi * ellipsoids.radii.prod(axis=1)
    for bone in range(count):
        own = np.flatnonzero(ellipsoids.bone == bone)
        if len(own):
            mass[bone] = max(float(weights[own].sum()), LEAST_MASS_KG)
            centre[bone] = weights[own] @ ellipsoids.centre[own] / mass[bone]
            places = ellipsoids.centre[own] - centre[bone]
            inertia[bone] += _inertia(weights[own], places, ellipsoids.radii[own])
    return mass, centre, inertia


def _inertia(masses: Floats[N], centres: Floats[N, D3], radii: Floats[N, D3]) -> Floats[D3, D3]:
    """Return the inertia (3, 3) of balls in the place of ellipsoids about their common centre [kg m²]."""
    total = np.zeros((3, 3))
    for mass, centre, radius in zip(masses, centres, radii, strict=True):
        ball = 0.4 * float((radius**2).mean()) + centre @ centre
        total += mass * (ball * np.eye(3) - np.outer(centre, centre))
    return total


# ---- XML as text, with numbers in one form: what URDF and OpenSim files are made of


Element = ElementTree.Element


def element(parent: Element, tag: str, text: str = "", **attributes: str) -> Element:
    """Return a new child of an element."""
    child = ElementTree.SubElement(parent, tag, attributes)
    child.text = text or None
    return child


def numbers(values: Floats[*Axes]) -> str:
    """Return numbers as text, nine digits each; zeros without a sign."""
    return " ".join(f"{x + 0.0:.9g}" for x in np.ravel(np.where(np.abs(values) < 1e-15, 0, values)))


def document(root: Element) -> str:
    """Return an indented document."""
    ElementTree.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ElementTree.tostring(root, "unicode") + "\n"
