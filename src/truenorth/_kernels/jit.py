"""The one decorator that compiles a kernel, with all its flags."""

import numba

kernel = numba.njit(cache=True, fastmath=False, error_model="numpy", nogil=True)
"""Compile a function with Numba: cached on disk, NaN-safe, no exceptions from division."""
