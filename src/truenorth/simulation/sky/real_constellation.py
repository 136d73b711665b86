"""The real constellation of a day, from RINEX navigation and SP3 files.

Moved in time by whole days every satellite stands at the same place over the Earth at the same time of day:
reference times move, and the node of an ephemeris, which counts from the start of the week, is turned by the
Earth rate times the change of its seconds of the week.

Between the reference times t_k and t_(k+1) of two ephemerides the true orbit is

    (1 - s(x)) r_k(t) + s(x) r_(k+1)(t),    x = (t - t_k) / (t_(k+1) - t_k),    s = 6 x^5 - 15 x^4 + 10 x^3

so that position and velocity, and the clock, have no steps where receivers change ephemerides.
"""

import os
from dataclasses import dataclass, replace

import numpy as np

from ...constants import BEIDOU, SYSTEMS
from ...errors import ConfigError
from ...navigation import KEPLER_COLUMNS, Navigation, keep_satellites, merge_navigation
from ...timescales import BDT_OFFSET_NS, NS_PER_DAY, NS_PER_S, NS_PER_WEEK, format_gpst, leap_seconds
from .broadcast import BroadcastTruth

__all__ = ["PreciseTruth", "SmoothTruth", "real_constellation", "shift_days"]


def real_constellation(section, *, start_ns, duration_s, folder=""):
    """Read the files and bring them to the scenario's time.

    Parameters
    ----------
    section : truenorth.simulation.sky.FileSky
        The files and what to do with them.
    start_ns : int
        GPS time of the start, nanoseconds.
    duration_s : float
        Length, seconds.
    folder : str or path-like
        What relative file names start from.

    Returns
    -------
    navigation : Navigation
        Broadcast ephemerides.
    truth : BroadcastTruth, SmoothTruth or PreciseTruth
    source : str

    Raises
    ------
    ConfigError
        If the files hold nothing for the scenario's time.
    FormatError
        If a file cannot be read.
    """
    from ...formats import read_navigation

    paths = [os.path.join(folder, name) for name in section.files]
    navigation = merge_navigation(*(read_navigation(path) for path in paths))
    wanted = [SYSTEMS.index(letter) for letter in section.systems]
    sats = np.concatenate([navigation.kepler.sat, navigation.states.sat])
    navigation = keep_satellites(navigation, np.unique(sats[np.isin(sats // 100, wanted)]))
    if navigation.precise is not None:
        keep = np.isin(navigation.precise.sat // 100, wanted)
        navigation = replace(navigation, precise=_columns(navigation.precise, keep))
    first_ns, last_ns = _span(navigation, section)
    n_days = 0
    middle_ns = start_ns + round(0.5 * duration_s * NS_PER_S)
    if section.time_shift == "days" and not first_ns <= middle_ns <= last_ns:
        n_days = round((middle_ns - (first_ns + last_ns) // 2) / NS_PER_DAY)
        navigation = replace(shift_days(navigation, n_days), leap_seconds=int(leap_seconds(start_ns)))
    source = "files " + ", ".join(os.path.basename(name) for name in section.files)
    if n_days:
        source += f", moved by {n_days:+d} days"
    broadcast = replace(navigation, precise=None)
    if navigation.precise is not None and len(navigation.kepler) + len(navigation.states) == 0:
        from .orbit_fit import fit_broadcast

        broadcast = fit_broadcast(navigation.precise, start_ns=start_ns, duration_s=duration_s)
    truth = SmoothTruth.of(broadcast) if section.smooth else BroadcastTruth(broadcast)
    if navigation.precise is not None:
        truth = PreciseTruth(navigation.precise, truth)
    known = np.unique(np.concatenate([broadcast.kepler.sat, broadcast.states.sat])).astype(np.int64)
    status = truth.states(known, np.full(len(known), start_ns), np.zeros(len(known)))[4]
    if not np.any(status == 0):
        first, last, start = (
            format_gpst(time_ns, decimals=0)
            for time_ns in (first_ns + n_days * NS_PER_DAY, last_ns + n_days * NS_PER_DAY, start_ns)
        )
        raise ConfigError(
            f"`files` hold orbits from {first} to {last} and none at the start, {start}; "
            "give another start, or other files",
            key="files",
            value=section.files,
        )
    return broadcast, truth, source


def _columns(precise, keep):
    return replace(
        precise,
        sat=precise.sat[keep],
        position_ecef_m=precise.position_ecef_m[:, keep],
        clock_s=precise.clock_s[:, keep],
        sd_m=precise.sd_m[keep],
    )


def _span(navigation, section):
    """First and last time of the data: of the precise orbits where there are any."""
    if navigation.precise is not None and navigation.precise.n_epochs:
        return int(navigation.precise.time_ns[0]), int(navigation.precise.time_ns[-1])
    toe_ns = np.concatenate([navigation.kepler.toe_ns, navigation.states.toe_ns])
    if len(toe_ns) == 0:
        raise ConfigError(
            f"`files` hold no orbits of the systems {section.systems}; give others",
            key="files",
            value=section.files,
        )
    # A few ephemerides of many files are hours off the rest.
    return tuple(int(time_ns) for time_ns in np.quantile(toe_ns, (0.02, 0.98), method="nearest"))


def shift_days(navigation, n_days):
    """Move navigation data by whole days, with the satellites over the same places of the Earth.

    Parameters
    ----------
    navigation : Navigation
        Broadcast ephemerides and precise orbits.
    n_days : int
        Days, positive into the future.

    Returns
    -------
    Navigation
    """
    from ...orbits.selection import ephemeris_table

    shift_ns = int(n_days) * NS_PER_DAY
    kepler, states = navigation.kepler, navigation.states
    own_ns = kepler.toe_ns - np.where(kepler.sat // 100 == BEIDOU, BDT_OFFSET_NS, 0)
    later_s = ((own_ns + shift_ns) % NS_PER_WEEK - own_ns % NS_PER_WEEK) / NS_PER_S
    omega_e = ephemeris_table(navigation).omega_e[: len(kepler)]
    elements = kepler.elements.copy()
    node = KEPLER_COLUMNS.index("omega0_rad")
    turned = elements[:, node] + omega_e * later_s
    elements[:, node] = np.where(later_s == 0.0, elements[:, node], (turned + np.pi) % (2.0 * np.pi) - np.pi)
    precise = navigation.precise
    return replace(
        navigation,
        kepler=replace(
            kepler,
            toe_ns=kepler.toe_ns + shift_ns,
            toc_ns=kepler.toc_ns + shift_ns,
            transmission_ns=kepler.transmission_ns + shift_ns,
            elements=elements,
        ),
        states=replace(
            states, toe_ns=states.toe_ns + shift_ns, transmission_ns=states.transmission_ns + shift_ns
        ),
        precise=None if precise is None else replace(precise, time_ns=precise.time_ns + shift_ns),
    )


@dataclass(frozen=True, slots=True, eq=False)
class SmoothTruth:
    """True orbits and clocks that pass smoothly from one broadcast ephemeris to the next.

    Parameters
    ----------
    navigation : Navigation
        The ephemerides.
    row, toe_ns, window_ns : ndarray of int64, shape (n,)
        Those used, one for each satellite and reference time, in this order.
    key : ndarray of int64, shape (n,)
        Satellite and whole seconds of toe in one increasing number.
    """

    navigation: Navigation
    row: np.ndarray
    toe_ns: np.ndarray
    window_ns: np.ndarray
    key: np.ndarray

    @classmethod
    def of(cls, navigation):
        """Choose the ephemerides: at each reference time the one that a receiver would take."""
        from ...orbits import select_ephemerides
        from ...orbits.selection import ephemeris_table

        table = ephemeris_table(navigation)
        sat = np.concatenate([navigation.kepler.sat, navigation.states.sat]).astype(np.int64)
        row, status = select_ephemerides(navigation, sat, table.toe_ns)
        row = np.unique(row[status == 0])
        key = _key(sat[row], table.toe_ns[row])
        order = np.argsort(key, kind="stable")
        row, key = row[order], key[order]
        window_ns = np.empty(len(sat), dtype=np.int64)
        window_ns[table.rows] = table.choice_window_ns
        return cls(navigation, row, table.toe_ns[row], window_ns[row], key)

    def states(self, sat, time_ns, delay_s):
        """Position, velocity, clock, clock drift, status: see `truenorth.simulation.sky.Sky.true_states`."""
        from ...orbits import OrbitStatus, compute_satellite_states

        n = len(self.row)
        after = np.searchsorted(self.key, _key(sat, time_ns), side="right")
        before = after - 1
        sat_of = self.key >> _SECONDS_BITS
        has_before = (before >= 0) & (sat_of[np.maximum(before, 0)] == sat)
        has_after = (after < n) & (sat_of[np.minimum(after, n - 1)] == sat)
        before, after = np.maximum(before, 0), np.minimum(after, n - 1)
        gap_ns = np.where(has_before & has_after, self.toe_ns[after] - self.toe_ns[before], 1)
        # Over longer gaps receivers have no valid ephemeris in between.
        joined = has_before & has_after & (gap_ns <= 2 * self.window_ns[before])
        near_before = has_before & (time_ns - self.toe_ns[before] <= self.window_ns[before])
        near_after = has_after & (self.toe_ns[after] - time_ns <= self.window_ns[after])
        first = np.where(joined | near_before, self.row[before], np.where(near_after, self.row[after], -1))
        states = compute_satellite_states(
            self.navigation, sat, time_ns, delay_s=delay_s, ephemeris=first, include_unhealthy=True
        )
        position, velocity = states.position_ecef_m, states.velocity_ecef_mps
        clock, drift, status = states.clock_s, states.clock_drift_sps, states.status
        known = np.isin(sat, sat_of)
        status[(first < 0) & known] = OrbitStatus.TOO_OLD
        both = np.flatnonzero(joined)
        if len(both):
            later = compute_satellite_states(
                self.navigation,
                sat[both],
                time_ns[both],
                delay_s=delay_s[both],
                ephemeris=self.row[after[both]],
                include_unhealthy=True,
            )
            gap_s = gap_ns[both] * 1e-9
            x = ((time_ns[both] - self.toe_ns[before[both]]) * 1e-9 - delay_s[both]) / gap_s
            x = np.clip(x, 0.0, 1.0)
            s = x**3 * (x * (6.0 * x - 15.0) + 10.0)
            s_rate = 30.0 * (x * (x - 1.0)) ** 2 / gap_s
            step = later.position_ecef_m - position[both]
            clock_step = later.clock_s - clock[both]
            velocity[both] += s[:, None] * (later.velocity_ecef_mps - velocity[both]) + s_rate[:, None] * step
            position[both] += s[:, None] * step
            drift[both] += s * (later.clock_drift_sps - drift[both]) + s_rate * clock_step
            clock[both] += s * clock_step
            status[both] = np.maximum(status[both], later.status)
        return position, velocity, clock, drift, status


_SECONDS_BITS = 40


def _key(sat, time_ns):
    return (np.asarray(sat, dtype=np.int64) << _SECONDS_BITS) + np.asarray(time_ns) // NS_PER_S


@dataclass(frozen=True, slots=True, eq=False)
class PreciseTruth:
    """True orbits and clocks of an SP3 file; of satellites that it does not hold, those of the broadcast."""

    precise: object
    broadcast: object

    def states(self, sat, time_ns, delay_s):
        """Position, velocity, clock, clock drift, status: see `truenorth.simulation.sky.Sky.true_states`."""
        from ...orbits import OrbitStatus, interpolate_precise

        columns = interpolate_precise(self.precise, sat, time_ns, delay_s=delay_s)
        other = np.flatnonzero(columns[4] == OrbitStatus.NO_EPHEMERIS)
        if len(other):
            found = self.broadcast.states(sat[other], time_ns[other], delay_s[other])
            for column, values in zip(columns, found, strict=True):
                column[other] = values
        return columns
