"""A term as plain tables of arrays that compiled loops read by address, and the kernels that turn them into sums.

How to write one: docs/contributing/adding_a_term.md.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from handtrack.arrays import D2, Array, Axes, Ints, N

_CELLS = 4  # of an array in a table: its address and up to three lengths


class TermKernel:
    """A compiled function (term, place, width) → cost that any loop can call by its address.

    term: address of the term's own table; place: of the loop's, see PLACE. It adds its derivatives to the
    place's gradient and hessian, or nothing where width is 0. Compiled when it is first asked for.

    A decorator: `@TermKernel("i8 f8")` says of what type the table's arrays are, in their order.
    """

    def __init__(self, types_of_arrays: str) -> None:
        self.types_of_arrays = tuple(types_of_arrays.split())

    def __call__(self, function: Callable[[int, int, int], float]) -> TermKernel:
        self.function = function
        return self

    @cached_property
    def address(self) -> int:
        signature = types.float64(types.int64, types.int64, types.int64)
        self._compiled: Any = numba.cfunc(signature, cache=True)(self.function)
        return self._compiled.address


class TermTable:
    """Arrays in the order and of the types in which a kernel reads them: what is of another type is converted, for a kernel
    reads memory as it is. couples: a residual moves with more than one bone.
    """

    def __init__(self, kernel: TermKernel, *arrays: Array[*Axes], couples: bool = False) -> None:
        self.kernel, self.couples = kernel, couples
        self._arrays = [  # kept alive for the kernel
            np.ascontiguousarray(array, kind)
            for array, kind in zip(arrays, kernel.types_of_arrays, strict=True)
        ]
        self._cells = np.array([_cells(a) for a in self._arrays], np.int64)

    @property
    def entry(self) -> tuple[int, int]:
        """The addresses of kernel and table."""
        return self.kernel.address, self._cells.ctypes.data


def _cells(array: Array) -> tuple[int, ...]:
    shape = (*array.shape, 1, 1, 1)[:3]
    return array.ctypes.data, *shape


def entries(tables: list[TermTable]) -> Ints[N, D2]:
    """Return the addresses of kernels and tables; the tables must outlive its use."""
    return np.array([t.entry for t in tables], np.int64).reshape(-1, 2)


_intrinsic: Any = intrinsic  # its functions are called without their first argument


@_intrinsic
def _pointer(typing, address):
    def generate(context, builder, signature, values):
        return builder.inttoptr(values[0], cgutils.voidptr_t)

    return types.voidptr(types.int64), generate


@_intrinsic
def call_kernel(typing, kernel, term, place, width):
    """Return what the kernel at an address returns."""

    def generate(context, builder, signature, values):
        long = ir.IntType(64)
        kind = ir.FunctionType(ir.DoubleType(), [long, long, long])
        return builder.call(builder.inttoptr(values[0], kind.as_pointer()), values[1:])

    return types.float64(*[types.int64] * 4), generate


@numba.njit(cache=True, nogil=True, inline="always")
def array1(table, number, dtype):  # pragma: no cover - compiled
    """Return the table's array of that number, one-dimensional."""
    cell = numba.carray(_pointer(table + 32 * number), (4,), np.int64)
    return numba.carray(_pointer(cell[0]), (cell[1],), dtype)


@numba.njit(cache=True, nogil=True, inline="always")
def array2(table, number, dtype):  # pragma: no cover - compiled
    """Return the table's array of that number, two-dimensional."""
    cell = numba.carray(_pointer(table + 32 * number), (4,), np.int64)
    return numba.carray(_pointer(cell[0]), (cell[1], cell[2]), dtype)


@numba.njit(cache=True, nogil=True, inline="always")
def array3(table, number, dtype):  # pragma: no cover - compiled
    """Return the table's array of that number, three-dimensional."""
    cell = numba.carray(_pointer(table + 32 * number), (4,), np.int64)
    return numba.carray(_pointer(cell[0]), (cell[1], cell[2], cell[3]), dtype)


@numba.njit(cache=True, nogil=True)
def put_array(place, number, array, n0, n1, n2):  # pragma: no cover - compiled
    """Enter an array (n0, n1, n2) into the cells of a loop's own table."""
    place[4 * number] = array.ctypes.data
    place[4 * number + 1], place[4 * number + 2], place[4 * number + 3] = n0, n1, n2


GRADIENT, HESSIAN, JOINTS = 0, 1, 2
"""arrays of the place of a parameter term: (S,), (S, S), (S,)"""
ROTATION, POSITION, REFERENCE = 2, 3, 4
"""arrays of the place of an observation term, after gradient (6B,) and Hessian (6B, 6B): (B, 3, 3), (B, 3), (3,)"""
PLACE = 5
"""arrays of a place at most"""
