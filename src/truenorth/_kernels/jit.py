"""The one decorator that compiles a kernel, with all its flags."""

import importlib
import sys
import time

# Numba imports `coverage` where it is installed (0.07 s), to report compiled lines as covered. Only a
# process that measures coverage, which has imported it already, wants that.
_WITHOUT_COVERAGE = "coverage" not in sys.modules
if _WITHOUT_COVERAGE:
    sys.modules["coverage"] = None
import numba  # noqa: E402
import numba.core.event  # noqa: E402
import numba.np.linalg  # noqa: E402

if _WITHOUT_COVERAGE:
    del sys.modules["coverage"]

from . import fingerprint  # noqa: E402


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


def kernel(function):
    """Compile a function with Numba: cached on disk, NaN-safe, no exceptions from division.

    Numba takes a cached function for valid as long as its own file is unchanged, but the kernels it calls
    are compiled into it. The cache is therefore valid only for the content of all kernel files together.
    """
    compiled = numba.njit(cache=True, fastmath=False, error_model="numpy", nogil=True, no_cfunc_wrapper=True)(
        function
    )
    index = getattr(getattr(compiled, "_cache", None), "_cache_file", None)
    if hasattr(index, "_source_stamp"):
        index._source_stamp = fingerprint()
    return compiled


IS_COMPILED = not numba.config.DISABLE_JIT
"""Whether kernels are compiled in this process, or run as plain Python (``NUMBA_DISABLE_JIT=1``)."""


class _CompileClock(numba.core.event.Listener):
    """Wall time that Numba spends compiling (not loading from its cache), nested calls counted once."""

    def __init__(self):
        self.seconds = 0.0
        self._depth = 0
        self._since = 0.0

    def on_start(self, event):
        if self._depth == 0:
            self._since = time.perf_counter()
        self._depth += 1

    def on_end(self, event):
        self._depth -= 1
        if self._depth == 0:
            self.seconds += time.perf_counter() - self._since


compile_clock = _CompileClock()
"""``compile_clock.seconds``: compilation so far in this process."""

numba.core.event.register("numba:compile", compile_clock)
