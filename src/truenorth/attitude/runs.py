"""Two receivers, epoch by epoch, as single differences: at once in memory, or block after block.

A short run is one block: everything is read, positioned and differenced once. A long one is read block
after block (`truenorth.formats.open_observations`) in three passes over its files:

1. the times of all epochs, which say what pairs with what (when the files are opened);
2. what is chosen from the whole run: the signals that are differenced, and a sample of epochs spread over
   it, from which the noise is estimated and the length checked;
3. the blocks themselves, with the state of the receivers carried from one to the next.

So the results of a long run are those it would have in one piece, and its memory is that of a block. A
block of one epoch is live mode.
"""

import itertools
import time
from functools import cached_property
from pathlib import Path

import numpy as np

from ..ambiguity.differencing import (
    build_single_differences,
    count_phases,
    is_long_baseline,
    match_receivers,
    pair_signals,
)
from ..ambiguity.resolution import SAMPLE_EPOCHS
from ..ambiguity.slips import MAX_GAP_S
from ..errors import NoSolutionError
from ..observations import Observations
from ..timescales import NS_PER_S

__all__ = ["BlockRun", "Receivers", "WholeRun", "open_receiver", "open_run"]

LONG_TEXT_BYTES = 32e6
"""RINEX text beyond this is not read at once."""

LONG_ROWS = 400_000
"""Observations of one receiver beyond this are not solved at once."""

BLOCK_ROWS = 100_000
"""Observations of one receiver in a block, about."""


def open_receiver(source, *, whole=False):
    """Observations of one receiver, in memory where they are few.

    Parameters
    ----------
    source : path, Observations or blocks
        A file, what is in memory, or what `truenorth.formats.open_observations` returned.
    whole : bool
        Whether everything must be in memory.

    Returns
    -------
    Observations, ObservationBlocks or RinexObservationBlocks
    """
    from ..formats import open_observations, read_observations

    if isinstance(source, (str, Path)) or hasattr(source, "__fspath__"):
        is_long = not whole and _text_bytes(source) > LONG_TEXT_BYTES
        source = open_observations(source) if is_long else read_observations(source)
    if whole and not isinstance(source, Observations):
        source = next(source.ranges([(0, source.n_epochs)])) if source.n_epochs else source
    return source


def _text_bytes(path):
    """Size of a file, of a gzipped one by what its trailer says (modulo 4 GiB)."""
    try:
        with Path(path).open("rb") as file:
            is_gzip = file.read(2) == b"\x1f\x8b"
            size = file.seek(0, 2)
            if is_gzip and size > 18:
                file.seek(-4, 2)
                size = max(size, int.from_bytes(file.read(4), "little"))
    except OSError:  # the reader says what is wrong
        return 0
    return size


def open_run(base, rover, navigation, settings, *, block_epochs=None):
    """The run of two receivers, in blocks where it is long.

    Parameters
    ----------
    base, rover : Observations or blocks
        See `open_receiver`.
    navigation : Navigation
        Broadcast ephemerides.
    settings : GnssSettings
        Systems, bands, masks and the stochastic model; a ``direction`` other than forward needs the whole.
    block_epochs : int, optional
        Common epochs of a block; by default as many as the memory of a block allows.

    Returns
    -------
    WholeRun or BlockRun

    Raises
    ------
    NoSolutionError
        If the two have no epochs, or none in common.
    """
    for name, receiver in (("base", base), ("rover", rover)):
        if receiver.n_epochs == 0:
            raise NoSolutionError(f"could not solve: the {name} file {receiver.meta.path} holds no epochs")
    if settings.direction == "forward":
        in_memory = isinstance(base, Observations) and isinstance(rover, Observations)
        is_long = not in_memory or max(base.n_rows, rover.n_rows) > LONG_ROWS
        if is_long or block_epochs is not None:
            return BlockRun(base, rover, navigation, settings, block_epochs)
    base, rover = (open_receiver(receiver, whole=True) for receiver in (base, rover))
    return WholeRun(base, rover, navigation, settings)


class Receivers:
    """Two receivers whose epochs are positioned and differenced, block after block.

    Parameters
    ----------
    navigation : Navigation
        Broadcast ephemerides.
    settings : GnssSettings
        Systems, bands, masks and the stochastic model.
    pairs : list of tuple, optional
        Signals that are differenced; by default those of the first block.
    at_code_baseline : bool, optional
        See `truenorth.ambiguity.differencing.is_long_baseline`; by default by the first block.
    is_whole : bool
        Whether there is only one block, whose choices nobody needs.
    """

    def __init__(self, navigation, settings, *, pairs=None, at_code_baseline=None, is_whole=False):
        self._navigation, self._settings, self._is_whole = navigation, settings, is_whole
        self.pairs, self.at_code_baseline = pairs, at_code_baseline
        self._guess = [None, None]
        self._position = None

    def step(self, base, rover, epochs=None):
        """Single differences of the next block.

        Parameters
        ----------
        base, rover : Observations
            All that came since the last block.
        epochs : tuple of ndarray of int64, optional
            Matched epochs of the two; by default they are matched here.

        Returns
        -------
        SingleDifferences

        Raises
        ------
        NoSolutionError
            If the block has no epochs in common, or the first one no signals.
        """
        from ..positioning import solve_single_point

        settings = self._settings
        if epochs is None:
            epochs = match_receivers(base, rover, settings)
        points = []
        for k, receiver in enumerate((base, rover)):
            point = solve_single_point(
                receiver,
                self._navigation,
                systems=settings.systems,
                elevation_mask_deg=min(settings.elevation_mask_deg, 10.0),
                initial_position_ecef_m=self._guess[k],
            )
            known = np.flatnonzero(np.isfinite(point.position_ecef_m[:, 0]))
            if len(known):
                self._guess[k] = point.position_ecef_m[known[-1]]
            points.append(point)
        if self.pairs is None and not self._is_whole:
            counts = (count_phases(base, epochs[0], settings), count_phases(rover, epochs[1], settings))
            self.pairs = pair_signals(*counts)
        if self.at_code_baseline is None and not self._is_whole:
            self.at_code_baseline = is_long_baseline(*points, epochs)
        differences = build_single_differences(
            base, rover, *points, settings, epochs=epochs, pairs=self.pairs,
            at_code_baseline=self.at_code_baseline, position_before=self._position,
        )  # fmt: skip
        if differences.has_position[-1]:
            self._position = differences.position_ecef_m[-1]
        return differences


class WholeRun:
    """A run in memory: one block.

    Parameters
    ----------
    base, rover : Observations
        Of the two receivers.
    navigation : Navigation
        Broadcast ephemerides.
    settings : GnssSettings
        Systems, bands, masks and the stochastic model.
    """

    read_s = 0.0

    def __init__(self, base, rover, navigation, settings):
        self.base, self.rover, self.navigation = base, rover, navigation
        self._differences = Receivers(navigation, settings, is_whole=True).step(base, rover)
        self.n_epochs = self._differences.n_epochs

    def sample(self):
        """Single differences and the epochs of them that serve as a sample; None leaves the choice."""
        return self._differences, None

    def blocks(self):
        """Yield single differences and the observations of both receivers: once."""
        yield self._differences, self.base, self.rover


class BlockRun:
    """A run in blocks.

    Parameters
    ----------
    base, rover : Observations or blocks
        Of the two receivers.
    navigation : Navigation
        Broadcast ephemerides.
    settings : GnssSettings
        Systems, bands, masks and the stochastic model.
    block_epochs : int, optional
        Common epochs of a block; by default as many as have about `BLOCK_ROWS` observations.
    """

    def __init__(self, base, rover, navigation, settings, block_epochs=None):
        from ..formats.blocks import ObservationBlocks

        self.base, self.rover = (
            ObservationBlocks(receiver) if isinstance(receiver, Observations) else receiver
            for receiver in (base, rover)
        )
        self.navigation, self._settings = navigation, settings
        self.read_s = 0.0
        epochs = match_receivers(self.base, self.rover, settings)
        self.n_epochs = len(epochs[0])
        if block_epochs is None:
            block_epochs = max(BLOCK_ROWS * self.n_epochs // max(self.base.n_rows, self.rover.n_rows), 1)
        # What one receiver saw alone counts for the arcs that go on, so it is read, but no further back.
        is_apart = np.diff(self.rover.time_ns[epochs[1]]) > MAX_GAP_S * NS_PER_S
        cuts = np.union1d(np.arange(0, self.n_epochs, block_epochs), np.flatnonzero(is_apart) + 1)
        self._spans = []
        stops = [0, 0]
        for first, stop in itertools.pairwise([*cuts.tolist(), self.n_epochs]):
            ranges, local = [], []
            for k, receiver in enumerate((self.base, self.rover)):
                here = epochs[k][first:stop]
                since = receiver.time_ns[here[0]] - int(MAX_GAP_S * NS_PER_S)
                begin = max(stops[k], int(np.searchsorted(receiver.time_ns, since)))
                stops[k] = int(here[-1]) + 1
                ranges.append((begin, stops[k]))
                local.append(here - begin)
            self._spans.append((first, ranges, tuple(local)))

    def _read(self):
        """Yield blocks: index of the first epoch, observations of both, matched epochs."""
        of_base, of_rover = zip(*(ranges for _, ranges, _ in self._spans), strict=True)
        readers = self.base.ranges(of_base), self.rover.ranges(of_rover)
        for first, _, local in self._spans:
            since = time.perf_counter()
            base, rover = (next(reader) for reader in readers)
            self.read_s += time.perf_counter() - since
            yield first, base, rover, local

    @cached_property
    def _chosen(self):
        """What the whole run chooses: signals, where to linearise, differences of the sample."""
        from ..formats.blocks import join_observations

        wanted = np.unique(np.linspace(0, self.n_epochs - 1, SAMPLE_EPOCHS[1]).astype(int))
        counts, samples = [0, 0], ([], [])
        for first, base, rover, local in self._read():
            here = wanted[(wanted >= first) & (wanted < first + len(local[0]))] - first
            for k, receiver in enumerate((base, rover)):
                counts[k] = counts[k] + count_phases(receiver, local[k], self._settings)
                if len(here):
                    samples[k].append(receiver.select_epochs(local[k][here]))
        base, rover = (join_observations(parts) for parts in samples)
        every = np.arange(len(wanted))
        receivers = Receivers(self.navigation, self._settings, pairs=pair_signals(*counts) or None)
        differences = receivers.step(base, rover, (every, every))
        return receivers.pairs, receivers.at_code_baseline, differences

    def sample(self):
        """Single differences of a sample of epochs, and the indices of all of them."""
        differences = self._chosen[2]
        return differences, np.arange(differences.n_epochs)

    def blocks(self):
        """Yield single differences and the observations of both receivers, block after block."""
        pairs, at_code_baseline, _ = self._chosen
        receivers = Receivers(self.navigation, self._settings, pairs=pairs, at_code_baseline=at_code_baseline)
        for _, base, rover, local in self._read():
            yield receivers.step(base, rover, local), base, rover
