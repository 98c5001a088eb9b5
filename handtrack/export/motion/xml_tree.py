"""XML as text, with numbers in one form: what URDF and OpenSim files are made of."""

from __future__ import annotations

from xml.etree import ElementTree

import numpy as np

from handtrack.arrays import Axes, Floats

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
