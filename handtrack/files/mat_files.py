"""MATLAB's .mat files: numbers, texts, structs and cells as Python's own.

SciPy's reader is not used: nested structs make it overrun its stack, and one of some thousand damaged files (SciPy 1.17) its memory,
which ends the program.
"""

from __future__ import annotations

import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from handtrack.errors import HandtrackError
from handtrack.files.text_files import check_file

_DEEPEST = 20  # levels
_MOST_BYTES = 64 << 20  # of one variable, unpacked
_HEADER = 128
_MATRIX, _PACKED = 14, 15
_NUMBERS = {
    1: "i1",
    2: "u1",
    3: "i2",
    4: "u2",
    5: "i4",
    6: "u4",
    7: "f4",
    9: "f8",
    12: "i8",
    13: "u8",
    16: "u1",
    17: "u2",
}
_CELL, _STRUCT, _CHAR, _OPAQUE = 1, 2, 4, 17


def read_mat(path: Path) -> dict[str, Any]:
    """Return the variables of a file by name: arrays (rows, columns), texts, structs as dict (several as a list of them).

    Cells are lists. Objects of a class, and all of version 7.3, are read by mat-io, as dict of their properties. Raises
    HandtrackError, also where that is not installed.
    """
    check_file(path, "a .mat file")
    data = path.read_bytes()
    if data[:10] == b"MATLAB 7.3":
        return _by_matio(path)
    if data[:10] != b"MATLAB 5.0":
        raise HandtrackError(
            f"{path}: no .mat file of version 5 to 7; save it in MATLAB with '-v7'."
        )
    order = ">" if data[126:128] == b"MI" else "<"
    try:
        return _variables(data, order)
    except NotImplementedError:
        return _by_matio(path)
    except (ValueError, struct.error, zlib.error, IndexError, UnicodeDecodeError) as error:
        raise HandtrackError(
            f"{path}: not a readable .mat file ({error}). Was it cut off while it was copied?"
        ) from None


def _by_matio(path: Path) -> dict[str, Any]:
    try:
        from matio import load_from_mat
    except ImportError:
        raise HandtrackError(
            f"{path} holds objects of MATLAB's classes, which are read with mat-io: pip install mat-io"
        ) from None
    try:
        return {name: _plain(value, 0) for name, value in load_from_mat(str(path)).items()}
    except Exception as error:  # a library's own, of many kinds, for a file that is damaged
        raise HandtrackError(
            f"{path}: mat-io cannot read it ({type(error).__name__}: {error}). Was it cut off while it was copied?"
        ) from None


def _plain(value: Any, depth: int) -> Any:
    """Return what mat-io gives as dict, list, text and arrays of numbers."""
    if depth > _DEEPEST:
        raise ValueError(f"nested more than {_DEEPEST} times")
    properties = getattr(value, "properties", None)
    if (
        properties is not None
    ):  # an object; classes that save themselves do so as a struct named `any`
        table = {name: _plain(inner, depth + 1) for name, inner in properties.items()}
        inner = table.pop("any", None)
        return {**table, **inner} if isinstance(inner, dict) else table
    if not isinstance(value, np.ndarray):
        return value
    if value.dtype.names:
        rows = [{n: _plain(row[n], depth + 1) for n in value.dtype.names} for row in value.ravel()]
        return rows[0] if len(rows) == 1 else rows
    if value.dtype == object:
        return [_plain(inner, depth + 1) for inner in value.ravel()]
    return "".join(value.ravel()[:1].tolist()) if value.dtype.kind == "U" else value


def _variables(data: bytes, order: str) -> dict[str, Any]:
    found, at = dict[str, Any](), _HEADER
    while at < len(data):
        kind, body, at = _element(data, at, order)
        if kind == _PACKED:
            unpacker = zlib.decompressobj()
            plain = unpacker.decompress(body, _MOST_BYTES)
            if unpacker.unconsumed_tail:
                raise ValueError(f"a variable takes more than {_MOST_BYTES / 1e6:.0f} MB")
            kind, body, _ = _element(plain, 0, order)
        if kind == _MATRIX:
            name, value = _matrix(body, order, 0)
            found[name] = value
    return found


def _element(data: bytes, at: int, order: str) -> tuple[int, bytes, int]:
    """Return kind and bytes of the element at a place, and where the next begins."""
    (word,) = struct.unpack_from(order + "I", data, at)
    if word >> 16:  # a small one, within 8 bytes
        kind, size = word & 0xFFFF, word >> 16
        return kind, data[at + 4 : at + 4 + size], at + 8
    kind, size = struct.unpack_from(order + "II", data, at)
    end = at + 8 + size
    if end > len(data):
        raise ValueError("it is cut off")
    return kind, data[at + 8 : end], end if kind == _PACKED else end + (-size) % 8


def _matrix(data: bytes, order: str, depth: int) -> tuple[str, Any]:
    if depth > _DEEPEST:
        raise ValueError(f"nested more than {_DEEPEST} times")
    if not data:
        return "", np.zeros((0, 0))
    _, flags, at = _element(data, 0, order)
    (word,) = struct.unpack_from(order + "I", flags)
    kind = word & 0xFF
    if kind == _OPAQUE:
        raise NotImplementedError("an object of a class, which MATLAB alone can read")
    _, dims, at = _element(data, at, order)
    shape = tuple(int(n) for n in np.frombuffer(dims, order + "i4"))
    _, name, at = _element(data, at, order)
    text = name.decode("latin-1")
    if min(shape, default=0) < 0:
        raise ValueError("a negative size")
    count = int(np.prod(shape, dtype=object))
    if kind == _CELL:
        return text, _parts(data, at, order, count, depth)
    if kind == _STRUCT:
        return text, _structs(data, at, order, count, depth)
    return text, _numbers(data, at, order, shape, count, kind == _CHAR)


def _numbers(
    data: bytes, at: int, order: str, shape: tuple[int, ...], count: int, is_text: bool
) -> Any:
    kind, body, _ = _element(data, at, order) if at < len(data) else (9, b"", 0)
    if kind not in _NUMBERS:
        if is_text:
            return body.decode("utf-8", errors="replace")
        raise ValueError(f"numbers of an unknown kind {kind}")
    values = np.frombuffer(body, order + _NUMBERS[kind])
    if is_text:
        if values.dtype.kind != "u":
            raise ValueError("a text of numbers that are no signs")
        return "".join(map(chr, values.tolist()))
    if len(values) != count:
        raise ValueError(f"{len(values)} numbers where its size {shape} announces {count}")
    return values.astype(float).reshape(shape, order="F")


def _parts(data: bytes, at: int, order: str, count: int, depth: int) -> list[Any]:
    if count > len(data):  # each takes some bytes
        raise ValueError(f"{count} parts announced, which cannot be")
    parts = []
    for _ in range(count):
        _, body, at = _element(data, at, order)
        parts.append(_matrix(body, order, depth + 1)[1])
    return parts


def _structs(data: bytes, at: int, order: str, count: int, depth: int) -> Any:
    _, length, at = _element(data, at, order)
    (width,) = struct.unpack_from(order + "i", length)
    _, packed, at = _element(data, at, order)
    if not 0 < width <= 256:
        raise ValueError("field names of an impossible length")
    names = [
        packed[i : i + width].split(b"\0")[0].decode("latin-1")
        for i in range(0, len(packed), width)
    ]
    values = _parts(data, at, order, count * len(names), depth)
    tables = [
        dict(zip(names, values[i * len(names) :], strict=False))
        for i in range(count if names else 0)
    ]
    return tables[0] if count == 1 and tables else tables
