"""The one decorator that compiles a kernel, with all its flags."""

import importlib

import numba
import numba.np.linalg


def _skip_the_search_for_blas():
    """Keep Numba from importing scipy.linalg (0.3 s) only to see whether a BLAS is there.

    It looks once, with the first kernel it loads. SciPy is a dependency of this package, so the answer is
    known; what really uses a BLAS still loads it then. Where these private names are gone, Numba looks.
    """
    linalg = numba.np.linalg
    look = getattr(linalg, "ensure_blas", None)
    if look is not None:
        linalg.ensure_blas = lambda: None
        try:
            importlib.import_module("numba.np.arraymath")
        finally:
            linalg.ensure_blas = look


_skip_the_search_for_blas()

kernel = numba.njit(cache=True, fastmath=False, error_model="numpy", nogil=True)
"""Compile a function with Numba: cached on disk, NaN-safe, no exceptions from division."""

IS_COMPILED = not numba.config.DISABLE_JIT
"""Whether kernels are compiled in this process, or run as plain Python (``NUMBA_DISABLE_JIT=1``)."""
