"""Phases and codes of all antennas of an array, epoch by epoch, as rows of one antenna, satellite and signal.

Single differences against one receiver hold all that an array needs: with that receiver's own rows set to
zero and its noise kept, each satellite's constant is what it measured, and is eliminated with the rest
(`truenorth.ambiguity.array_model`). For satellites and epochs that the first receiver does not have, the next
one takes its place; integers belong to the arcs of single receivers, so nothing is lost by the change.
"""

from dataclasses import dataclass, field

import numpy as np

from ..errors import NoSolutionError
from ..observations import LLI_HALF_CYCLE, LLI_SLIP
from ..timescales import NS_PER_S
from .array_model import ArrayEpoch
from .differencing import build_single_differences, match_epochs, split_variances
from .slips import MAX_GAP_S

__all__ = ["ArcBook", "ArrayRows", "build_array_rows"]


@dataclass(frozen=True, slots=True, eq=False)
class ArrayRows:
    """Rows of a block of epochs, sorted by epoch, group, satellite, antenna.

    Parameters
    ----------
    time_ns : ndarray of int64, shape (n_epochs,)
        GPS time of the epochs: the tags of the receiver that the others are differenced with.
    position_ecef_m : ndarray, shape (n_epochs, 3)
        Single-point position of that receiver; NaN where there is none.
    start : ndarray of int64, shape (n_epochs + 1,)
        Row offsets.
    antenna : ndarray of int64, shape (n_rows,)
    sat, signal : ndarray of int64, shape (n_rows,)
        Satellite and the antenna's own signal.
    satellite, group : ndarray of int64, shape (n_rows,)
        Numbers that tell apart the constants of satellites and of clocks within an epoch.
    arc : ndarray of int64, shape (n_rows,)
        Unbroken phase of one antenna, satellite and signal.
    phase_m, code_m : ndarray, shape (n_rows,)
        Less what is modelled; NaN where missing. Phases whose ambiguity is no integer are missing.
    design_ned : ndarray, shape (n_rows, 3)
        -e.
    wavelength_m, phase_variance_m2, code_variance_m2 : ndarray, shape (n_rows,)
        Variances of the single receiver.
    elevation_rad, azimuth_rad : ndarray, shape (n_rows,)
        Direction of the satellite.
    n_arcs : int
        Arcs of the block.
    """

    time_ns: np.ndarray
    position_ecef_m: np.ndarray
    start: np.ndarray
    antenna: np.ndarray
    sat: np.ndarray
    signal: np.ndarray
    satellite: np.ndarray
    group: np.ndarray
    arc: np.ndarray
    phase_m: np.ndarray
    code_m: np.ndarray
    design_ned: np.ndarray
    wavelength_m: np.ndarray
    phase_variance_m2: np.ndarray
    code_variance_m2: np.ndarray
    elevation_rad: np.ndarray
    azimuth_rad: np.ndarray
    n_arcs: int = 0

    @property
    def n_epochs(self):
        """int: Number of epochs."""
        return len(self.time_ns)

    def epoch(self, k, positions_body_m, position_sd_m=0.0, factors=(1.0, 1.0)):
        """One epoch as the public joint search takes it.

        Parameters
        ----------
        k : int
            Index of the epoch.
        positions_body_m : ndarray, shape (n_antennas, 3)
            Body coordinates.
        position_sd_m : float
            Standard deviation of each of them.
        factors : tuple of float
            Variance factors of phases and codes.

        Returns
        -------
        ArrayEpoch
        """
        rows = slice(int(self.start[k]), int(self.start[k + 1]))
        new_group = np.diff(self.group[rows], prepend=-1) != 0
        new_satellite = new_group | (np.diff(self.satellite[rows], prepend=-1) != 0)
        return ArrayEpoch(
            antenna=self.antenna[rows],
            satellite=np.cumsum(new_satellite) - 1,
            group=np.cumsum(new_group) - 1,
            phase_m=self.phase_m[rows],
            code_m=self.code_m[rows],
            design_ned=self.design_ned[rows],
            wavelength_m=self.wavelength_m[rows],
            phase_variance_m2=factors[0] * self.phase_variance_m2[rows],
            code_variance_m2=factors[1] * self.code_variance_m2[rows],
            positions_body_m=np.asarray(positions_body_m, float),
            position_sd_m=position_sd_m,
        )


@dataclass(slots=True, eq=False)
class ArcBook:
    """Arcs of unbroken phase of every receiver, numbered over the blocks of a run.

    An arc ends where its receiver flags a loss of lock and where the phase is missing for longer than
    `truenorth.ambiguity.slips.MAX_GAP_S`. Slips without a flag show in the residuals of the array.
    """

    last: dict = field(default_factory=dict)
    """(antenna, satellite and signal) -> (time of its last row, number of its arc)."""

    def enter_block(self, receivers):
        """Number the arcs of a block of observations.

        Parameters
        ----------
        receivers : sequence of Observations or None
            One for each antenna.

        Returns
        -------
        arcs : list of ndarray of int64
            Arc of each row of each receiver; -1 where there is no phase.
        was, now : ndarray of int64, shape (k,)
            Numbers that arcs of the block before go on with.
        n_arcs : int
            Arcs of the block.
        """
        arcs, was, now, book, n_arcs = [], [], [], {}, 0
        end_ns = max((o.time_ns[-1] for o in receivers if o is not None and o.n_epochs), default=0)
        for antenna, o in enumerate(receivers):
            if o is None or o.n_epochs == 0:
                arcs.append(np.empty(0, np.int64))
                continue
            key = o.sat.astype(np.int64) * 1000 + o.signal
            time_ns = o.time_ns[o.epoch_of_row]
            order = np.lexsort((time_ns, key))
            flagged = np.cumsum((o.lli[order] & LLI_SLIP) > 0)
            has_phase = np.isfinite(o.phase_cyc[order])
            rows, losses = order[has_phase], flagged[has_phase]
            arc = np.full(len(key), -1, np.int64)
            if len(rows):
                is_new = np.ones(len(rows), bool)
                is_new[1:] = key[rows][1:] != key[rows][:-1]
                first = np.flatnonzero(is_new)
                # Flags before the first phase of a signal in this block break the arc from the last one.
                begin = np.searchsorted(key[order], key[rows][first])
                before = losses[first] - flagged[begin] + ((o.lli[order[begin]] & LLI_SLIP) > 0)
                gap = np.diff(time_ns[rows], prepend=0) > MAX_GAP_S * NS_PER_S
                begins = is_new | gap | (np.diff(losses, prepend=0) > 0)
                number = n_arcs + np.cumsum(begins) - 1
                for k, lost in zip(first, before, strict=True):
                    known = self.last.get((antenna, int(key[rows[k]])))
                    if known and not lost and time_ns[rows[k]] - known[0] <= MAX_GAP_S * NS_PER_S:
                        was.append(known[1])
                        now.append(int(number[k]))
                arc[rows] = number
                n_arcs = int(number[-1]) + 1
                for k in np.append(first[1:], len(rows)) - 1:
                    book[antenna, int(key[rows[k]])] = (int(time_ns[rows[k]]), int(number[k]))
            arcs.append(arc)
        # What paused in this block may go on in the next.
        for name, (time_ns, number) in self.last.items():
            if name not in book and end_ns - time_ns <= MAX_GAP_S * NS_PER_S:
                was.append(number)
                now.append(n_arcs)
                book[name] = (time_ns, n_arcs)
                n_arcs += 1
        self.last = book
        return arcs, np.array(was, np.int64), np.array(now, np.int64), n_arcs


def build_array_rows(receivers, points, settings, arcs, n_arcs):
    """Rows of all antennas at all epochs of a block.

    Parameters
    ----------
    receivers : sequence of Observations or None
        Of each antenna; None or no epochs where one is silent.
    points : sequence of PointSolution or None
        Their single-point solutions.
    settings : GnssSettings
        Systems, bands, masks and the stochastic model.
    arcs : sequence of ndarray of int64
        Of `ArcBook.enter_block`.
    n_arcs : int
        Likewise.

    Returns
    -------
    ArrayRows or None
        None where no two receivers have an epoch in common.
    """
    half_ns = round(settings.max_time_difference_s * NS_PER_S)
    taken = np.empty(0, np.int64)
    seen = np.empty(0, np.int64)
    pieces, times = [], []
    for reference, base in enumerate(receivers):
        if base is None or base.n_epochs == 0 or reference == len(receivers) - 1:
            continue
        early, at = match_epochs(base.time_ns, taken, settings.max_time_difference_s)
        time_ns = base.time_ns.copy()
        time_ns[early] = taken[at]
        # Where an earlier receiver has the epoch, only what it does not see is differenced with this one.
        key, has_phase = _phase_keys(base, time_ns, half_ns)
        fresh = has_phase & ~np.isin(key, seen)
        wanted = np.ones(base.n_epochs, bool)
        wanted[early] = False
        wanted[base.epoch_of_row[fresh]] = True
        taken = np.union1d(taken, time_ns[wanted])
        seen = np.union1d(seen, key[has_phase])
        own = np.flatnonzero(wanted)
        if len(own) == 0:
            continue
        for rover in range(reference + 1, len(receivers)):
            other = receivers[rover]
            if other is None or other.n_epochs == 0:
                continue
            epochs = match_epochs(base.time_ns[own], other.time_ns, settings.max_time_difference_s)
            if len(epochs[0]):
                epochs = own[epochs[0]], epochs[1]
                piece = _pair_rows(receivers, points, settings, arcs, reference, rover, epochs, time_ns)
                if piece is not None:
                    pieces.append(piece)
                    times.append(time_ns[epochs[0]])
    if not pieces:
        return None
    joined = {name: np.concatenate([piece[name] for piece in pieces]) for name in pieces[0]}
    # Epochs without a satellite are epochs, too.
    time_ns = np.unique(np.concatenate(times))
    epoch = np.searchsorted(time_ns, joined.pop("time_ns"))
    # A satellite and signal is differenced with one receiver: the first by which two antennas have a phase.
    chain = joined.pop("reference")
    place = epoch * 1_000_000 + joined["satellite"]
    _, kind = np.unique(place * 100 + chain, return_inverse=True)
    phases = np.bincount(kind, np.isfinite(joined["phase_m"]), minlength=1)[kind]
    rank = chain + 100 * (phases < 2)
    _, place = np.unique(place, return_inverse=True)
    least = np.full(len(place), 1000)
    np.minimum.at(least, place, rank)
    keep = rank == least[place]
    joined = {name: column[keep] for name, column in joined.items()}
    epoch = epoch[keep]
    # The reference's own rows are said once for each rover; one of each stays, with a code if any has one.
    order = np.lexsort(
        (np.isnan(joined["code_m"]), np.isnan(joined["phase_m"]), joined["antenna"], joined["satellite"],
         joined["group"], epoch)
    )  # fmt: skip
    keys = [epoch[order], *(joined[name][order] for name in ("group", "satellite", "antenna"))]
    fresh = np.ones(len(order), bool)
    fresh[1:] = np.any([key[1:] != key[:-1] for key in keys], axis=0)
    order = order[fresh]
    position = np.full((len(time_ns), 3), np.nan)
    position[epoch] = joined.pop("position_ecef_m")
    start = np.concatenate(([0], np.cumsum(np.bincount(epoch[order], minlength=len(time_ns)))))
    return ArrayRows(
        time_ns=time_ns,
        position_ecef_m=position,
        start=start.astype(np.int64),
        n_arcs=n_arcs,
        **{name: np.ascontiguousarray(column[order]) for name, column in joined.items()},
    )


def _phase_keys(observations, time_ns, step_ns):
    """Numbers of epoch, satellite and signal of every row, and whether it has a phase to use."""
    o = observations
    epoch = (time_ns // max(step_ns, 1))[o.epoch_of_row]
    key = (epoch * 1000 + o.sat) * 1000 + o.signal
    return key, np.isfinite(o.phase_cyc) & ((o.lli & LLI_HALF_CYCLE) == 0)


def _pair_rows(receivers, points, settings, arcs, reference, rover, epochs, time_ns):
    """Rows of one rover and of the receiver it is differenced with, at the times of the run's epochs."""
    base, other = receivers[reference], receivers[rover]
    try:
        d = build_single_differences(
            base, other, points[reference], points[rover], settings, epochs=epochs, at_code_baseline=False
        )
    except NoSolutionError:
        return None
    ned = d.design_enu[:, [1, 0, 2]] * np.array([1.0, 1.0, -1.0])
    band_signal = d.sat.astype(np.int64) // 100 * 1000 + base.signal[d.base_row]
    epoch = d.epoch_of_row
    phase = np.where(d.integer_ok, d.phase_m, np.nan)
    of_base, own = split_variances(d, base, other, settings)
    zero_phase, zero_code = (np.where(np.isfinite(value), 0.0, np.nan) for value in (phase, d.code_m))
    n = len(phase)
    both = {
        "antenna": np.repeat([rover, reference], n),
        "signal": np.concatenate((d.signal, base.signal[d.base_row])).astype(np.int64),
        "arc": np.concatenate((arcs[rover][d.rover_row], arcs[reference][d.base_row])),
        "phase_m": np.concatenate((phase, zero_phase)),
        "code_m": np.concatenate((d.code_m, zero_code)),
        "phase_variance_m2": np.concatenate((own[0], of_base[0])),
        "code_variance_m2": np.concatenate((own[1], of_base[1])),
    }
    shared = {
        "time_ns": time_ns[d.base_epoch][epoch],
        "reference": np.full(n, reference),
        "position_ecef_m": np.where(d.has_position[:, None], d.position_ecef_m, np.nan)[epoch],
        "sat": d.sat.astype(np.int64),
        "satellite": d.sat.astype(np.int64) * 1000 + base.signal[d.base_row],
        "group": band_signal,
        "design_ned": ned,
        "wavelength_m": d.wavelength_m,
        "elevation_rad": d.elevation_rad,
        "azimuth_rad": d.azimuth_rad,
    }
    return both | {name: np.concatenate((column, column)) for name, column in shared.items()}
