"""All receivers of an array, block after block: rows of every antenna, and the joint engine over them.

A block is a span of time. Each receiver is read once, positioned once, and differenced with the first one
that has the epoch (`truenorth.ambiguity.array_rows`); what the engine carries goes from block to block, so
memory is that of a block, and a block of one epoch is live mode.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from ..ambiguity.array_rows import ArcBook, ArrayRows, build_array_rows
from ..config import ArraySettings, GnssSettings
from ..errors import Reason, Status
from ..observations import Observations, sat_name, signal_name
from ..timescales import NS_PER_S
from .runs import BLOCK_ROWS

__all__ = ["EXCLUDED", "USED", "ArrayEngine", "ArrayRun", "EngineBlock", "compile_engine"]

USED, EXCLUDED = 1, 2
"""Parts of an antenna in an epoch, as of `truenorth._kernels.array_engine`."""

MAX_NODES = 500_000
"""Nodes of one epoch's joint search before it gives up."""

MARGIN = 20.0
"""Candidates within this of the best count for the posterior probability."""

CAP_FACTOR = 5.0
"""The search looks no further than this multiple of the residual test's limit, plus the margin."""

NO_PRIOR = np.zeros((3, 3))

MAX_UNSURE = 5
"""Epochs that are searched together where none alone decides."""

MAX_STRIKES = 8
"""Outlying phases that one epoch may lose before an antenna is looked for."""

EVENTS = {
    1: ("fixed", "integers of all antennas accepted by the joint search: probability {statistic:.6f}"),
    2: ("slip", "phase of {name} at {antenna} slipped: {statistic:+.3f} m off, limit {limit:.3f} m; "
        "its integer is sought anew"),
    3: ("released", "integer of {name} at {antenna} released after repeated outliers: {statistic:+.3f} m"),
    4: ("released", "all integers released: residual test {statistic:.1f}, limit {limit:.1f}; "
        "the joint search begins anew"),
    5: ("held", "integer of {name} at {antenna} held: {statistic:+.4f} m from the nearest, "
        "limit {limit:.4f} m"),
    6: ("outlier", "phase of {name} at {antenna} left out of the epoch: normalised residual {statistic:.1f}, "
        "{limit:+.4f} m"),
    7: ("excluded", "{antenna} contradicts the other antennas and is left out: residual test {statistic:.1f} "
        "with it, limit {limit:.1f}"),
    8: ("released", "integers of {antenna} released after {statistic:.0f} epochs against the others"),
}  # fmt: skip
"""Kinds of events of the compiled engine and their sentences."""


def compile_engine():
    """Run the engine over one epoch without observations; compiles, and caches, it."""
    none, number = np.empty(0), np.empty(0, np.int64)
    rows = ArrayRows(
        np.zeros(1, np.int64), np.full((1, 3), np.nan), np.zeros(2, np.int64), number, number, number, number,
        number, number, none, none, np.empty((0, 3)), none, none, none, none, none,
    )  # fmt: skip
    ArrayEngine(np.zeros((2, 3)), GnssSettings(), ArraySettings()).step(rows)


class ArrayRun:
    """The receivers of an array in blocks of time.

    Parameters
    ----------
    receivers : sequence of Observations or blocks
        One for each antenna, see `truenorth.attitude.runs.open_receiver`.
    navigation : Navigation
        Broadcast ephemerides.
    settings : GnssSettings
        Systems, bands, masks and the stochastic model.
    block_epochs : int, optional
        Epochs of a block; by default as many as have about `BLOCK_ROWS` observations.
    """

    def __init__(self, receivers, navigation, settings, block_epochs=None):
        self._receivers = [_as_blocks(receiver) for receiver in receivers]
        self._navigation, self._settings = navigation, settings
        self.read_s = 0.0
        longest = max(self._receivers, key=lambda receiver: receiver.n_epochs)
        self.n_epochs = longest.n_epochs
        if block_epochs is None:
            rows = max(receiver.n_rows for receiver in self._receivers)
            block_epochs = max(BLOCK_ROWS * max(self.n_epochs, 1) // max(rows, 1), 1)
        # Tags of one epoch differ by little; a block ends between two epochs.
        half_ns = round(settings.max_time_difference_s * NS_PER_S)
        edges = [np.iinfo(np.int64).min]
        edges += [int(t) - half_ns for t in longest.time_ns[block_epochs::block_epochs]]
        self._edges = [*edges, np.iinfo(np.int64).max]

    def blocks(self):
        """Yield the rows of every block, and which arcs go on in it: (numbers before, numbers now)."""
        spans = []
        for receiver in self._receivers:
            at = np.searchsorted(receiver.time_ns, self._edges)
            spans.append(list(zip(at[:-1].tolist(), at[1:].tolist(), strict=True)))
        yield from self._rows(spans)

    def sample(self, n_epochs):
        """Rows of epochs spread over the run, one block; None where no two receivers share one."""
        longest = max(self._receivers, key=lambda receiver: receiver.n_epochs)
        wanted = np.unique(np.linspace(0, longest.n_epochs - 1, min(n_epochs, longest.n_epochs)).astype(int))
        half_ns = round(self._settings.max_time_difference_s * NS_PER_S)
        spans = []
        for receiver in self._receivers:
            first = np.searchsorted(receiver.time_ns, longest.time_ns[wanted] - half_ns)
            stop = np.searchsorted(receiver.time_ns, longest.time_ns[wanted] + half_ns, side="right")
            spans.append([(int(a), int(max(a, b))) for a, b in zip(first, stop, strict=True)])
        found = list(self._rows(spans, join=True))
        return found[0][0] if found else None

    def _rows(self, spans, join=False):
        """Rows of spans of epochs, span by span or all of them as one block."""
        from ..formats.blocks import join_observations

        book, guess = ArcBook(), [None] * len(self._receivers)
        readers = [
            receiver.ranges([span for span in of_one if span[1] > span[0]])
            for receiver, of_one in zip(self._receivers, spans, strict=True)
        ]
        gathered = [[] for _ in readers]
        for k in range(len(spans[0])):
            since = time.perf_counter()
            parts = [
                next(reader) if of_one[k][1] > of_one[k][0] else None
                for reader, of_one in zip(readers, spans, strict=True)
            ]
            self.read_s += time.perf_counter() - since
            if join:
                for all_of_one, part in zip(gathered, parts, strict=True):
                    all_of_one += [part] if part is not None else []
            elif (step := self._step(parts, guess, book)) is not None:
                yield step
        if join:
            parts = [join_observations(all_of_one) if all_of_one else None for all_of_one in gathered]
            if (step := self._step(parts, guess, book)) is not None:
                yield step

    def _step(self, parts, guess, book):
        """Rows of one block, and the arcs that go on in it."""
        from ..positioning import solve_single_point

        points = []
        for k, receiver in enumerate(parts):
            if receiver is None or receiver.n_epochs == 0:
                points.append(None)
                continue
            point = solve_single_point(
                receiver,
                self._navigation,
                systems=self._settings.systems,
                elevation_mask_deg=min(self._settings.elevation_mask_deg, 10.0),
                initial_position_ecef_m=guess[k],
            )
            known = np.flatnonzero(np.isfinite(point.position_ecef_m[:, 0]))
            if len(known):
                guess[k] = point.position_ecef_m[known[-1]]
            points.append(point)
        arcs, was, now, n_arcs = book.enter_block(parts)
        rows = build_array_rows(parts, points, self._settings, arcs, n_arcs)
        return None if rows is None else (rows, (was, now))


def _as_blocks(receiver):
    from ..formats.blocks import ObservationBlocks

    return ObservationBlocks(receiver) if isinstance(receiver, Observations) else receiver


@dataclass(frozen=True, slots=True, eq=False)
class EngineBlock:
    """What the joint engine found in a block.

    Parameters
    ----------
    rows : ArrayRows
        What it was given.
    table : ndarray, shape (n_epochs, n_columns)
        Columns of `truenorth._kernels.array_engine`.
    status, reason : ndarray of uint8, shape (n_epochs,)
        Codes of `Status` and `Reason`.
    part : ndarray of uint8, shape (n_epochs, n_antennas)
        0: absent, 1: used, 2: excluded.
    vector_ned_m, cov_ned_m2 : ndarray, shapes (n_epochs, m, 3), (n_epochs, 3 m, 3 m)
        See `truenorth.attitude.array_vectors.ArrayVectors`.
    residual_m, integer_cyc : ndarray, shape (n_rows,)
        Of the phases that took part.
    events : list of tuple
        (time_ns, kind, satellite, signal, statistic, limit, text).
    """

    rows: object
    table: np.ndarray
    status: np.ndarray
    reason: np.ndarray
    part: np.ndarray
    vector_ned_m: np.ndarray
    cov_ned_m2: np.ndarray
    residual_m: np.ndarray
    integer_cyc: np.ndarray
    events: list


class ArrayEngine:
    """State and step of the joint engine.

    Parameters
    ----------
    positions_body_m : ndarray, shape (n_antennas, 3)
        Body coordinates.
    settings : GnssSettings
        ``residual_significance``, ``use_code``, ``single_epoch``.
    array : ArraySettings
        ``position_sd_m``, ``success_probability``.
    factors : tuple of float
        Variance factors of phases and codes.
    names : sequence of str
        Of the antennas.
    keep_vectors : bool
        Fill `EngineBlock.vector_ned_m` and `.cov_ned_m2`.
    """

    def __init__(self, positions_body_m, settings, array, *, factors=(1.0, 1.0), names=(), keep_vectors=True):
        from .._kernels import array_engine as kernel

        self._body_m = np.ascontiguousarray(positions_body_m, dtype=float)
        self._position_sd_m, self._min_probability = array.position_sd_m, array.success_probability
        self._settings, self.factors = settings, factors
        self._names = tuple(names) or tuple(f"antenna {k}" for k in range(len(self._body_m)))
        self._keep_vectors = keep_vectors
        self._origin_ns = None
        self._number, self._value = np.zeros((2, 0), np.int64), np.full((2, 0), np.nan)
        self._carried = np.zeros(kernel.N_CARRIED)
        self._carried[kernel.LAST_TIME] = np.nan
        # Epochs that alone could not decide: time, rows, arcs.
        self._unsure = []

    def step(self, rows, resumed=None):
        """Solve the next block.

        Parameters
        ----------
        rows : ArrayRows
            The block.
        resumed : tuple of ndarray, optional
            Arcs of the block before that go on, and their numbers now.

        Returns
        -------
        EngineBlock
        """
        from .._kernels import array_engine as kernel
        from ..ambiguity.acceptance import chi2_limits

        n, m = rows.n_epochs, len(self._body_m)
        if self._origin_ns is None:
            self._origin_ns = int(rows.time_ns[0])
        number, value = np.zeros((2, rows.n_arcs), np.int64), np.full((2, rows.n_arcs), np.nan)
        if resumed is not None and not self._settings.single_epoch:
            was, now = resumed
            renumber = dict(zip(was.tolist(), now.tolist(), strict=True))
            self._unsure = [
                (time_ns, one, np.array([renumber.get(number, -1) for number in arc.tolist()]))
                for time_ns, one, arc in self._unsure
            ]
            number[:, now], value[:, now] = self._number[:, was], self._value[:, was]
        self._number, self._value = number, value
        table = np.empty((n, kernel.N_COLUMNS))
        status, reason = np.zeros(n, np.uint8), np.zeros(n, np.uint8)
        part = np.zeros((n, m), np.uint8)
        kept = n if self._keep_vectors else 0
        vector, cov = np.full((kept, m, 3), np.nan), np.full((kept, 3 * m, 3 * m), np.nan, np.float32)
        n_rows = len(rows.antenna)
        residual, integer, found = np.empty(n_rows), np.empty(n_rows), np.empty(n_rows)
        events, numbers = np.empty((20 * n + 100, 3), np.int64), np.empty((20 * n + 100, 2))
        counter = np.zeros(1, np.int64)
        widest = int(np.diff(rows.start).max(initial=1))
        limits = chi2_limits(self._settings.residual_significance, widest + 2)
        variance = self.factors[0] * rows.phase_variance_m2
        epoch, answer = 0, -1
        while epoch < n:
            epoch = kernel.run_array(
                epoch, answer, (rows.time_ns - self._origin_ns) / NS_PER_S, rows.start, rows.antenna,
                rows.satellite, rows.group, rows.arc, rows.phase_m, rows.design_ned, rows.wavelength_m,
                variance, self._body_m, float(self._position_sd_m) ** 2, limits, MAX_STRIKES,
                self._settings.single_epoch, self._number, self._value, self._carried, found, table, status,
                reason, part, vector, cov, residual, integer, events, numbers, counter,
            )  # fmt: skip
            if epoch < n:
                verdict = self._search(rows, epoch, limits, found, table[epoch])
                answer = int(verdict == Reason.OK)
                if reason[epoch] != Reason.HOLD_RELEASED or answer:
                    reason[epoch] = verdict
        n_events = int(counter[0])
        return EngineBlock(
            rows, table, status, reason, part, vector, cov, residual, integer,
            [self._event(rows, *events[k], *numbers[k]) for k in range(n_events)],
        )  # fmt: skip

    def _search(self, rows, epoch, limits, found, row):
        """Joint search of one epoch: integers into `found`, numbers into the result row, and the verdict."""
        from .._kernels import array_engine as kernel
        from .._kernels import joint_search as joint

        here = slice(int(rows.start[epoch]), int(rows.start[epoch + 1]))
        one = rows.epoch(epoch, self._body_m, self._position_sd_m, self.factors)
        n = len(one.antenna)
        code = one.code_m if self._settings.use_code else np.full(n, np.nan)
        integers, rot, cov = np.empty(n, np.int64), np.empty((3, 3)), np.empty((3, 3))
        result = np.empty(joint.N_COLUMNS)
        reach = CAP_FACTOR * limits[min(n, len(limits) - 1)] + MARGIN
        why = joint.search_array(
            one.antenna, one.satellite, one.group, one.phase_m, code, one.design_ned, one.wavelength_m,
            one.phase_variance_m2, one.code_variance_m2, self._body_m, float(self._position_sd_m), NO_PRIOR,
            NO_PRIOR, MARGIN, float(reach), MAX_NODES, integers, rot, cov, result,
            np.empty((0, n), np.int64), np.empty(0), np.empty(0),
        )  # fmt: skip
        found[here] = np.where(np.isfinite(one.phase_m), integers, np.nan)
        row[kernel.FOUND], row[kernel.SECOND_COST] = result[joint.N_CANDIDATES], result[joint.SECOND_COST]
        if why != Reason.OK:
            return Reason(int(why))
        freedom = int(result[joint.DOF])
        limit = limits[min(freedom, len(limits) - 1)] if freedom > 0 else np.inf
        row[kernel.CHI2], row[kernel.CHI2_DOF], row[kernel.CHI2_LIMIT] = result[joint.COST], freedom, limit
        row[kernel.PROBABILITY] = result[joint.PROBABILITY] * result[joint.ATTITUDE_SHARE]
        if result[joint.COST] > limit:
            return Reason.RESIDUAL_TEST
        if not row[kernel.PROBABILITY] >= self._min_probability:
            return self._search_together(rows, epoch, one, found, row)
        self._unsure.clear()
        return Reason.OK

    def _search_together(self, rows, epoch, one, found, row):
        """Joint search of an epoch that alone leaves doubts, with unsure ones before it; the verdict.

        Only epochs whose multipath is another one count, so none nearer than its correlation time.
        """
        from .._kernels import array_engine as kernel
        from ..ambiguity.joint import resolve_joint_epochs

        if self._settings.single_epoch:
            return Reason.PROBABILITY_TEST
        time_ns = int(rows.time_ns[epoch])
        spacing_ns = self._settings.stochastic.correlation_s * NS_PER_S
        if self._unsure and time_ns - self._unsure[-1][0] < spacing_ns:
            return Reason.PROBABILITY_TEST
        here = slice(int(rows.start[epoch]), int(rows.start[epoch + 1]))
        # A row without a phase has an arc of its own, which no other epoch knows.
        alone = -1 - np.arange(len(one.antenna)) - 1_000_000 * (epoch + 1)
        arc = np.where(np.isfinite(one.phase_m), rows.arc[here], alone)
        self._unsure.append((time_ns, one, arc))
        del self._unsure[:-MAX_UNSURE]
        if len(self._unsure) < 2:
            return Reason.PROBABILITY_TEST
        together = resolve_joint_epochs(
            [one for _, one, _ in self._unsure],
            [arc for _, _, arc in self._unsure],
            use_code=self._settings.use_code,
            success_probability=self._min_probability,
            residual_significance=self._settings.residual_significance,
            max_nodes=MAX_NODES,
        )
        if together.status != Status.FIXED:
            if together.reason == Reason.RESIDUAL_TEST:
                # Something slipped in between.
                del self._unsure[:-1]
            return Reason.PROBABILITY_TEST
        known = dict(
            zip(together.arcs[together.is_fixed], together.integers_cyc[together.is_fixed], strict=True)
        )
        found[here] = [known.get(number, np.nan) if number >= 0 else np.nan for number in arc]
        row[kernel.PROBABILITY] = together.success_probability
        self._unsure.clear()
        return Reason.OK

    def _event(self, rows, epoch, row, kind, statistic, limit):
        """One decision as the log keeps it."""
        satellite, signal, antenna = "", "", ""
        if row >= 0:
            satellite, signal = sat_name(int(rows.sat[row])), signal_name(int(rows.signal[row]))
            antenna = self._names[rows.antenna[row]]
        elif row < -1 or kind in (7, 8):
            antenna = self._names[-1 - row]
        name, text = EVENTS[int(kind)]
        text = text.format(
            name=f"{satellite} {signal}", antenna=antenna, statistic=float(statistic), limit=float(limit)
        )
        return int(rows.time_ns[epoch]), name, satellite, signal, float(statistic), float(limit), text
