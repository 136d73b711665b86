"""The one decorator that compiles a kernel, with all its flags."""

import numba
import numba.np.linalg


def _no_blas():
    raise ImportError("no kernel uses BLAS")


# Numba imports scipy.linalg (0.3 s) with the first kernel it loads, to see whether a BLAS is there.
# No kernel uses one, so it need not look; where this private name is gone it looks as before.
if hasattr(numba.np.linalg, "ensure_blas"):
    numba.np.linalg.ensure_blas = _no_blas

kernel = numba.njit(cache=True, fastmath=False, error_model="numpy", nogil=True)
"""Compile a function with Numba: cached on disk, NaN-safe, no exceptions from division."""

IS_COMPILED = not numba.config.DISABLE_JIT
"""Whether kernels are compiled in this process, or run as plain Python (``NUMBA_DISABLE_JIT=1``)."""
