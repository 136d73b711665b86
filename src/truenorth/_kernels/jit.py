"""The one decorator that compiles a kernel, with all its flags."""

import numba

kernel = numba.njit(cache=True, fastmath=False, error_model="numpy", nogil=True)
"""Compile a function with Numba: cached on disk, NaN-safe, no exceptions from division."""

IS_COMPILED = not numba.config.DISABLE_JIT
"""Whether kernels are compiled in this process, or run as plain Python (``NUMBA_DISABLE_JIT=1``)."""
