"""What URDF and MJCF share: a plain XML file, and attributes that are numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from handtrack.arrays import Axes, Floats
from handtrack.errors import HandtrackError
from handtrack.files.text_files import read_text


def read_root(path: Path, tag: str, what: str) -> ElementTree.Element:
    """Return a file's root element, which has this tag. Raises HandtrackError for no XML, another root, or entities."""
    text = read_text(path, f"a robot's {what}")
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise HandtrackError(
            f"{path}: it declares a document type or entities; expected plain {what}."
        )
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise HandtrackError(f"{path}: not valid XML: {error}.") from None
    if root.tag != tag:
        raise HandtrackError(f"{path}: its root is <{root.tag}>; expected <{tag}>, as {what} has it.")  # fmt: skip
    return root


def numbers(
    given: Mapping[str, str], key: str, default: Sequence[float] | None, path: Path, count: int = 0
) -> Floats[*Axes]:
    """Return an attribute's numbers; the default where it is not given. Raises HandtrackError for what is none.

    count: how many are expected; 0: as many as there are.
    """
    text = given.get(key)
    if text is None:
        if default is None:
            raise HandtrackError(f"{path}: a shape has no `{key}`.")
        return np.array(default, float)
    try:
        values = np.array([float(word) for word in text.split()])
    except ValueError:
        values = np.array([np.nan])
    if not np.isfinite(values).all() or len(values) != (count or len(values)) or not len(values):
        raise HandtrackError(f'{path}: {key}="{text}"; expected {count or "finite"} numbers.')
    return values
