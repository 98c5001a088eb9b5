"""XML as text, with numbers in one form: what URDF and OpenSim files are made of."""

from __future__ import annotations

from xml.etree import ElementTree

import numpy as np

from handtrack.arrays import D3, Axes, Floats

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


def angles_xyz(rotation: Floats[D3, D3]) -> Floats[D3]:
    """Return the angles [rad] of R = Rx Ry Rz, as OpenSim's frames have them."""
    x = np.arctan2(-rotation[1, 2], rotation[2, 2])
    y = np.arcsin(np.clip(rotation[0, 2], -1.0, 1.0))
    return np.array([x, y, np.arctan2(-rotation[0, 1], rotation[0, 0])])


def angles_rpy(rotation: Floats[D3, D3]) -> Floats[D3]:
    """Return the angles [rad] of R = Rz(yaw) Ry(pitch) Rx(roll), as (roll, pitch, yaw): URDF's."""
    roll = np.arctan2(rotation[2, 1], rotation[2, 2])
    pitch = np.arcsin(np.clip(-rotation[2, 0], -1.0, 1.0))
    return np.array([roll, pitch, np.arctan2(rotation[1, 0], rotation[0, 0])])
