"""Compares arrays with the axes in types of signatures while a program runs: `Floats[N, D3]` is N by 3, one N in a call."""

from __future__ import annotations

import ast
import inspect
import sys
from collections.abc import Iterator
from types import CodeType, FrameType, FunctionType
from typing import Any

import numpy as np

ARRAYS = {"Floats": "f", "Ints": "iu", "Bytes": "u", "Array": ""}
"""names in handtrack/arrays.py, and the letters of NumPy's kinds that may stand there; empty: any"""


def fits(kind: ast.expr, value: Any, lengths: dict[str, int]) -> bool:
    """Return whether a value has the axes of its type. lengths: of the letters met so far; new ones are added."""
    if isinstance(kind, ast.BinOp):
        sides = [dict(lengths), dict(lengths)]
        for side, tried in zip((kind.left, kind.right), sides, strict=True):
            if fits(side, value, tried):
                lengths |= tried
                return True
        return False
    if isinstance(kind, ast.Constant):
        return value is kind.value
    if not isinstance(kind, ast.Subscript) or not isinstance(kind.value, ast.Name):
        return not isinstance(value, np.ndarray)
    inside = kind.slice.elts if isinstance(kind.slice, ast.Tuple) else [kind.slice]
    name = kind.value.id
    if name in ARRAYS:
        is_kind = isinstance(value, np.ndarray | np.generic) and value.dtype.kind in (
            ARRAYS[name] or value.dtype.kind
        )
        return is_kind and has_axes([ast.unparse(axis) for axis in inside], value.shape, lengths)
    if name == "tuple" and isinstance(value, tuple) and ast.unparse(inside[-1]) != "...":
        return all(fits(one, item, lengths) for one, item in zip(inside, value, strict=True))
    if name in ("tuple", "list", "Sequence") and isinstance(value, tuple | list):
        return all(fits(inside[0], item, dict(lengths)) for item in value)
    if name in ("dict", "Mapping"):
        return all(fits(inside[-1], item, dict(lengths)) for item in value.values())
    return not isinstance(value, np.ndarray)


def has_axes(axes: list[str], shape: tuple[int, ...], lengths: dict[str, int]) -> bool:
    if "*Axes" in axes:
        at, after = axes.index("*Axes"), len(axes) - axes.index("*Axes") - 1
        if len(shape) < at + after:
            return False
        axes, shape = axes[:at] + axes[at + 1 :], shape[:at] + shape[len(shape) - after :]
    if len(axes) != len(shape):
        return False
    for axis, length in zip(axes, shape, strict=True):
        fixed = int(axis[1:]) if axis[0] == "D" else lengths.setdefault(axis, length)
        if fixed != length:
            return False
    return True


class ShapeWatch:
    """While it is entered, looks at every call of a public function or dataclass of some packages."""

    def __init__(self, *packages: str) -> None:
        self.known = dict(_typed(packages))
        self.met: set[str] = set()
        self.misfits: dict[str, str] = {}
        self._open: dict[int, dict[str, int]] = {}

    def __enter__(self) -> ShapeWatch:
        sys.setprofile(self._look)
        return self

    def __exit__(self, *_: object) -> None:
        sys.setprofile(None)

    def _look(self, frame: FrameType, event: str, value: Any) -> None:
        if event not in ("call", "return") or frame.f_code not in self.known:
            return
        name, types = self.known[frame.f_code]
        if event == "call":
            lengths = self._open[id(frame)] = {}
            for argument in types.keys() & frame.f_locals.keys():
                self._check(name, argument, types[argument], frame.f_locals[argument], lengths)
        else:
            lengths = self._open.pop(id(frame), {})
            if value is not None and "return" in types:  # None, too, where an error is raised
                self._check(name, "return", types["return"], value, lengths)

    def _check(
        self, name: str, what: str, kind: ast.expr, value: Any, lengths: dict[str, int]
    ) -> None:
        self.met.add(name)
        if not fits(kind, value, lengths):
            self.misfits[f"{name}: {what}"] = (
                f"{ast.unparse(kind)} is {_described(value)}, where {lengths}"
            )


def _typed(packages: tuple[str, ...]) -> Iterator[tuple[CodeType, tuple[str, dict[str, ast.expr]]]]:
    """Yield the code of what is loaded and public, with its name and the types that have arrays in them."""
    for module in [m for m in sys.modules.values() if m.__name__.split(".")[0] in packages]:
        for owner in (module, *(c for c in vars(module).values() if inspect.isclass(c))):
            for thing in list(vars(owner).values()):
                thing = getattr(thing, "fget", None) or getattr(thing, "__func__", thing)
                if not isinstance(thing, FunctionType) or inspect.isgeneratorfunction(thing):
                    continue
                name = f"{thing.__module__}.{thing.__qualname__}"
                if thing.__module__ == module.__name__ and "._" not in name.replace("__init__", ""):
                    types = {
                        of: ast.parse(str(kind), mode="eval").body
                        for of, kind in thing.__annotations__.items()
                    }
                    many = inspect.getfullargspec(thing).varargs  # of which each has that type
                    types = {of: k for of, k in types.items() if of != many and _has_arrays(k)}
                    if types:
                        yield thing.__code__, (name, types)


def _has_arrays(kind: ast.expr) -> bool:
    names = {node.id for node in ast.walk(kind) if isinstance(node, ast.Name)}
    return bool(names & ARRAYS.keys()) and "Callable" not in names


def _described(value: Any) -> str:
    if isinstance(value, np.ndarray | np.generic):
        return f"{value.dtype} {value.shape}"
    return f"{type(value).__name__} {[_described(v) for v in value] if isinstance(value, tuple | list) else ''}"
