"""What a calibration file holds, as nested tables, whatever it was written in: chosen by its first bytes, never by its name."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

from handtrack.errors import HandtrackError
from handtrack.files.given_files import MOST_BYTES, check_given, first_bytes
from handtrack.files.mat_files import read_mat, read_mat_objects
from handtrack.files.npz_files import read_arrays
from handtrack.files.text_files import read_json, read_text
from handtrack.files.toml_text import read_toml
from handtrack.files.yaml_text import parse_yaml

_WHAT = "a calibration"
_TOML = re.compile(r"\[+\s*[\w.\"'-]+\s*\]+\s*(#.*)?$|[\w.\"'-]+\s*=")
_YAML = re.compile(r"""(- |[\w."'/ -]+:(\s|$)|\{)""")
_ROWS = re.compile(r"(?:#.*\r?\n)*[A-Za-z]+:[ \t]*\r?\n[ \t]*[-+.\d]+[eE\d.+-]*[ \t]+[-+.\d]")
_STORAGE = "opencv_storage"


class Tree(NamedTuple):
    """A file's content."""

    form: str
    """toml, yaml, json, xml, npz, mat or rows."""
    content: Any
    """nested dict and list; of other XML than OpenCV's the root element."""


def calibration_tree(path: Path) -> Tree | None:
    """Return what a file holds; None where it is of no known form. Raises HandtrackError for what cannot be read."""
    check_given(path, _WHAT)
    start = first_bytes(path)
    if start[:4] == b"PK\3\4":
        return Tree("npz", {key: _plain(value) for key, value in read_arrays(path).items()})
    if start[:10] == b"MATLAB 5.0":
        variables = read_mat(path)
        return Tree("mat", read_mat_objects(path) if _holds_object(variables) else variables)
    if start[:10] == b"MATLAB 7.3":
        return Tree("mat", read_mat_objects(path))
    if start[:1] == b"\x80" and start[1:2] in b"\2\3\4\5":
        raise HandtrackError(
            f"{path} is a Python pickle, which may run any program when it is read, so it is not. Where you trust it, write it "
            "as JSON: for each camera K, dist, R, t and size, as lists (OpenCap's: intrinsicMat, distortion, rotation, "
            "translation in mm, imageSize as height, width)."
        )
    if b"\0" in start:
        return None
    text = start.decode("utf-8-sig", errors="replace").lstrip()
    if text.startswith("<"):
        return _xml(path)
    if text.startswith("{") or re.match(r"\[\s*\{", text):
        return Tree("json", read_json(path, _WHAT))
    if text.startswith(("%YAML", "---")):
        return _yaml(path)
    first = next(
        (line for line in text.splitlines() if line.strip() and line.strip()[0] != "#"), ""
    )
    if _TOML.match(first.strip()):
        return Tree("toml", read_toml(path, _WHAT))
    if _ROWS.match(text):
        return Tree("rows", _rows(path))
    return _yaml(path) if _YAML.match(first.strip()) else None


def _holds_object(value: Any) -> bool:
    """Return whether something that `read_mat` returned has an object of a class in it, which it gives as None."""
    inner = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
    return value is None or any(map(_holds_object, inner))


def _rows(path: Path) -> dict[str, list[list[float]]]:
    """Return what stands below each `word:`, rows of numbers, as handpose3d writes a camera's lens and its pose."""
    found: dict[str, list[list[float]]] = {}
    key = ""
    for line in read_text(path, _WHAT).splitlines():
        if line.strip().endswith(":"):
            key = line.strip()[:-1]
            found[key] = []
        elif key and line.strip() and line.strip()[0] != "#":
            try:
                found[key].append([float(word) for word in line.split(None, MOST_BYTES)])
            except ValueError:
                raise HandtrackError(f"{path}: '{line[:60]}'; expected a row of numbers.") from None
    return found


def _plain(value: Any) -> Any:
    """Return an array; one number or text as itself, texts as a list. Pickles were refused before."""
    return (
        value.item() if value.ndim == 0 else value.tolist() if value.dtype.kind in "US" else value
    )


def _yaml(path: Path) -> Tree:
    try:
        return Tree("yaml", parse_yaml(read_text(path, _WHAT)))
    except ValueError as error:
        raise HandtrackError(f"{path}: not readable YAML: {error}.") from None


def _xml(path: Path) -> Tree:
    text = read_text(path, _WHAT)
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise HandtrackError(
            f"{path}: XML with declarations of its own (DOCTYPE) is not read; a calibration needs none."
        )
    try:
        root = ElementTree.fromstring(re.sub(r"^\s*<\?xml[^>]*\?>", "", text))
    except ElementTree.ParseError as error:
        raise HandtrackError(f"{path}: not valid XML: {error}.") from None
    return Tree("xml", _storage(root, 0, path) if root.tag == _STORAGE else root)


def _storage(element: ElementTree.Element, depth: int, path: Path) -> Any:
    """Return what OpenCV wrote: elements named `_` are a list, a text of numbers is one or several."""
    if depth > 40:
        raise HandtrackError(f"{path}: nested more than 40 times; no calibration is.")
    children = list(element)
    if children and all(child.tag == "_" for child in children):
        return [_storage(child, depth + 1, path) for child in children]
    if children:
        return {child.tag: _storage(child, depth + 1, path) for child in children}
    text = (element.text or "").strip()
    if text[:1] == '"':
        return text.strip('"')
    words = text.split(None, MOST_BYTES)
    try:
        values = [float(word) for word in words]
    except ValueError:
        return text
    whole = [int(value) if value == int(value) and "." not in word else value
             for value, word in zip(values, words, strict=True)] if _finite(values) else values  # fmt: skip
    return whole[0] if len(whole) == 1 and element.tag != "data" else whole


def _finite(values: list[float]) -> bool:
    return all(abs(value) < 1e300 for value in values)
