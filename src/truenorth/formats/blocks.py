"""Long observation files in blocks of epochs.

`open_observations` goes through a file once and knows the times of all its epochs; then any ranges of
epochs can be read, each pass over the file giving blocks in order. RINEX is read from pieces of its text,
so that neither the text nor the observations of the whole file are ever in memory; other formats (UBX and
the like), and RINEX in a packing other than gzip, are read whole and cut.
"""

from itertools import chain

import numpy as np

from ..observations import Observations

__all__ = ["ObservationBlocks", "iter_observations", "join_observations", "open_observations"]

BLOCK_EPOCHS = 10_000
"""Epochs of a block where the caller does not say."""


class ObservationBlocks:
    """Observations in memory, cut into blocks.

    Parameters
    ----------
    observations : Observations
        Of one receiver.
    """

    def __init__(self, observations):
        self._observations = observations
        self.time_ns, self.meta, self.n_rows = observations.time_ns, observations.meta, observations.n_rows
        self.sat = np.unique(observations.sat)

    @property
    def n_epochs(self):
        """int: Number of epochs."""
        return len(self.time_ns)

    def ranges(self, ranges):
        """Cut out ranges of epochs.

        Parameters
        ----------
        ranges : iterable of tuple of int
            First epoch and the one after the last, of each block; increasing, none empty.

        Yields
        ------
        Observations
        """
        for first, stop in ranges:
            yield self._observations.select_epochs(slice(first, stop))


def open_observations(path):
    """Open a file of observations for reading in blocks.

    Parameters
    ----------
    path : str or os.PathLike
        Any file that `truenorth.read_observations` reads.

    Returns
    -------
    RinexObservationBlocks or ObservationBlocks
        With ``time_ns``, ``n_epochs``, ``n_rows``, ``sat`` and ``meta`` of the whole file, and ``ranges``.

    Raises
    ------
    FormatError
        If the file cannot be read or holds no observations.
    """
    from .compression import read_pieces
    from .registry import read_observations, sniff_bytes
    from .rinex_obs import RinexObservationBlocks

    pieces = read_pieces(path)
    first = next(pieces)
    form = sniff_bytes(first)
    if form is None or form.name != "rinex_obs":
        pieces.close()
        return ObservationBlocks(read_observations(path))
    opened = iter((chain((first,), pieces),))
    return RinexObservationBlocks(lambda: next(opened, None) or read_pieces(path), path)


def iter_observations(path, *, block_epochs=BLOCK_EPOCHS):
    """Read a file block after block.

    Parameters
    ----------
    path : str or os.PathLike
        Any file that `truenorth.read_observations` reads.
    block_epochs : int
        Epochs of a block; the last may have fewer.

    Yields
    ------
    Observations
        Together they are what `truenorth.read_observations` returns. All have the metadata of the whole
        file; events stand in the block of the epoch that follows them.

    Raises
    ------
    FormatError
        If the file cannot be read or holds no observations.
    """
    opened = open_observations(path)
    first = range(0, opened.n_epochs, block_epochs)
    yield from opened.ranges((k, min(k + block_epochs, opened.n_epochs)) for k in first)


def join_observations(blocks):
    """Join blocks of one receiver in the order of time.

    Parameters
    ----------
    blocks : sequence of Observations
        At least one.

    Returns
    -------
    Observations
        With the metadata of the first.
    """

    def joined(name):
        return np.concatenate([getattr(block, name) for block in blocks])

    counts = np.concatenate([np.diff(block.epoch_start) for block in blocks])
    columns = ("time_ns", "sat", "signal", "code_m", "phase_cyc", "doppler_hz", "cn0_dbhz", "lli")
    return Observations(
        epoch_start=np.concatenate(([0], np.cumsum(counts))).astype(np.int64),
        **{name: joined(name) for name in (*columns, "clock_offset_s")},
        glonass_channel=blocks[0].glonass_channel,
        meta=blocks[0].meta,
        events=tuple(chain.from_iterable(block.events for block in blocks)),
    )
