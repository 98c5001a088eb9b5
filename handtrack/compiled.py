"""How loops are compiled: to machine code that is kept beside the source and holds no lock, so that threads run it at once."""

import numba

compiled = numba.njit(cache=True, nogil=True)
"""a division by zero raises, as in Python"""
compiled_as_numpy = numba.njit(cache=True, nogil=True, error_model="numpy")
"""a division by zero is infinite, as in NumPy: no check in the loop"""
inlined = numba.njit(cache=True, nogil=True, error_model="numpy", inline="always")
"""written into its callers, whose divisions it shares"""
