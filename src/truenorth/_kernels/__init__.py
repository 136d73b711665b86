"""Every compiled loop of the package, and nothing else.

Modules here import NumPy and Numba only. They know arrays and integer codes, not files, settings or
objects; the public wrappers validate, convert to contiguous arrays and call them.
"""

import functools
import hashlib
from pathlib import Path


@functools.cache
def fingerprint():
    """Hash of the content of all kernel files; compiled code is valid for one of them."""
    files = sorted(Path(__file__).parent.glob("*.py"))
    return hashlib.sha256(b"".join(path.read_bytes() for path in files)).hexdigest()
