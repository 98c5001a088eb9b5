"""How loops are compiled: to machine code that is kept, and that holds no lock, so that threads run it at once.

Numba knows kept code by the function's own file. It contains what the function calls, too, from any file: here it is known by
all that it was made of. So no code of another version runs, and nothing is compiled anew where nothing changed.
"""

from __future__ import annotations

import gc
import hashlib
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from types import FunctionType
from typing import Any

import numba
from numba import config
from numba.core import event
from numba.core.caching import FunctionCache, _CacheLocator
from numba.core.dispatcher import Dispatcher
from numba.core.runtime import rtsys
from numba.misc.appdirs import AppDirs

_FOLDER = Path(AppDirs("handtrack", appauthor=False).user_cache_dir) / "kernels"
_KEPT_S = 180 * 86_400.0


class _Locator(_CacheLocator):
    """Keeps machine code by what it was made of, in the folder NUMBA_CACHE_DIR or else in the user's cache."""

    def __init__(self, py_func: FunctionType, py_file: str) -> None:
        self._py_file, self._lineno = py_file, py_func.__code__.co_firstlineno
        self._stamp = _sources(py_func)
        chosen = config.CACHE_DIR  # pyright: ignore[reportAttributeAccessIssue]
        self._path = Path(chosen or _FOLDER) / py_func.__module__

    def get_cache_path(self) -> str:
        return str(self._path)

    def get_source_stamp(self) -> str:
        return self._stamp

    def get_disambiguator(self) -> str:
        return f"{self._lineno}-{self._stamp[:16]}"

    @classmethod
    def from_function(cls, py_func: FunctionType, py_file: str) -> _Locator | None:
        """Return it; None for a function of no file, or without a folder to write to: Numba's own ways are next."""
        if not Path(py_file).exists():
            return None
        found = cls(py_func, py_file)
        try:
            found.ensure_cache_path()
        except OSError:
            return None
        return found


class _Files(FunctionCache._impl_class):
    _locator_classes = (_Locator, *FunctionCache._impl_class._locator_classes)

    def reduce(self, data: Any) -> Any:
        """Return what is kept of compiled code: without the modules of callees that have no constants, which loading would import."""
        *code, environments = super().reduce(data)
        return *code, [one for one in environments if one.consts]


class _Cache(FunctionCache):
    _impl_class = _Files

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return compiled code from disk. None, and the function's files removed, where a type of its arguments has been renamed since.

        It is only run: what Numba compiles with, and loads first here, is not needed for that, and takes 0.4 s.
        """
        rtsys.initialize(target_context)
        try:
            with self._guard_against_spurious_io_errors():
                return self._load_overload(sig, target_context)
        except (AttributeError, ImportError):
            self.flush()
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep code, and remove what was written long ago from its folder: of versions that are gone. Others compile again."""
        try:
            super().save_overload(sig, data)
        except (AttributeError, ImportError):
            self.flush()  # of another version, which came while this one compiled
            super().save_overload(sig, data)
        for file in Path(self._cache_path).glob("*.nb[ci]"):
            with suppress(OSError):
                if file.stat().st_mtime < time.time() - _KEPT_S:
                    file.unlink()


class _CollectorOff(event.Listener):
    """Keeps the garbage collector off while functions are compiled, each within its caller: it would take a tenth of that time."""

    def __init__(self) -> None:
        self._compiling, self._was_on = 0, False

    def on_start(self, event: event.Event) -> None:
        if not self._compiling:
            self._was_on = gc.isenabled()
            gc.disable()
        self._compiling += 1

    def on_end(self, event: event.Event) -> None:
        self._compiling -= 1
        if self._was_on and not self._compiling:
            gc.enable()


event.register("numba:compile", _CollectorOff())


@cache
def _sources(function: FunctionType) -> str:
    """Return a hash of a function's file, and of what this has from others: compiled functions, numbers, the fields of tuples."""
    sources = [Path(function.__code__.co_filename).read_bytes()]
    for name, value in sorted(function.__globals__.items()):
        if isinstance(value, Dispatcher) and value.py_func.__module__ != function.__module__:
            sources.append(_sources(value.py_func).encode())
        elif isinstance(value, int | float | str) and not name.startswith("__"):
            sources.append(f"{name} {value!r}".encode())
        elif isinstance(value, type) and hasattr(value, "_fields"):
            sources.append(f"{name} {value._fields}".encode())
    return hashlib.sha256(b"\0".join(sources)).hexdigest()


def compiled_with(**options: Any) -> Callable[[Any], Any]:
    """Return the decorator for options of `numba.njit`."""

    def decorate(function: FunctionType) -> Any:
        # nothing is called from C: without a wrapper for that, all compiles a tenth quicker
        flags: dict[str, Any] = {"nogil": True, "no_cfunc_wrapper": True} | options
        dispatcher: Any = numba.njit(**flags)(function)
        # Numba imports the module again for what is kept: of one loaded by its path it could not
        if function.__module__ in sys.modules:
            dispatcher._cache = _Cache(function)
        return dispatcher

    return decorate


compiled = compiled_with()
"""a division by zero raises, as in Python"""
compiled_as_numpy = compiled_with(error_model="numpy")
"""a division by zero is infinite, as in NumPy: no check in the loop"""
inlined = compiled_with(error_model="numpy", inline="always")
"""written into its callers, whose divisions it shares"""
