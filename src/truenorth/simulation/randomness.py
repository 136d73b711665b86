"""Independent random streams by name: what is added to a scenario leaves all other draws alone."""

from __future__ import annotations

import zlib

import numpy as np

__all__ = ["stream"]


def stream(seed: int, *names: str | int) -> np.random.Generator:
    """Generator of its own for one purpose.

    Parameters
    ----------
    seed : int
        Seed of the scenario.
    *names : str or int
        What is drawn for whom, e.g. ``"clock", "fore"``.

    Returns
    -------
    numpy.random.Generator
        The same for the same seed and names, on every platform.
    """
    key = tuple(name if isinstance(name, int) else zlib.crc32(name.encode()) for name in names)
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(seed, spawn_key=key)))
