r"""Maps of the phase residuals of each antenna over the sky as the body sees it.

What an antenna and its surroundings on the platform do to the phase (its pattern, rays mirrored by the deck)
stays where it is in the body frame. Residuals of the baselines from the reference antenna 0,

    r_i = M_i(direction) - M_0(direction) + noise,

are gathered in cells of the sky. Only differences between antennas are seen, and only they matter; the maps
are those whose sum over the antennas is zero. A rigid array and its clocks hide part of a map: rotations and
clocks of every epoch are adjusted together with the maps, in turns.

References: W. Wanninga and V. Frevert, "Carrier phase multipath calibration of GPS reference stations",
Navigation 48 (2001); G. Wübbena et al., "Automated absolute field calibration of GPS antennas in real-time",
Proc. ION GPS (2000).
"""

from __future__ import annotations

import os
from dataclasses import dataclass

import numpy as np

from ..errors import ConfigError, NoSolutionError
from ..observations import Observations
from .phase_centres import attitude_of_rows, correct_phases, direction_in_antenna, directions_of_rows

__all__ = ["PhaseMap", "map_residuals", "map_rows", "read_phase_maps"]

PASSES = 12
"""Turns of adjusting epochs and maps; more change a map by less than a tenth of its noise."""

MAX_TIME_DIFFERENCE_NS = 100_000_000
"""Between an epoch of a baseline and that of its attitude."""

MIN_CELLS = 20
"""Cells that two halves of a run have in common; with fewer their correlation says nothing."""

MIN_COUNT = 4
"""Residuals that a cell needs to be used."""


@dataclass(frozen=True, slots=True, eq=False)
class PhaseMap:
    """What one antenna adds to its phases in one band.

    Parameters
    ----------
    antenna : str
        Its name.
    band : int
        RINEX band digit.
    mean_m, sd_m : ndarray, shape (a, e)
        Mean residual of each cell and its standard deviation, by azimuth and elevation in the body
        frame; NaN in cells with fewer than four residuals.
    count : ndarray of int64, shape (a, e)
        Residuals.
    repeatability : float
        Correlation of the maps of the first and the second half of the run, over the cells that both have:
        1 for what stays where it is, 0 for noise; NaN where there are too few such cells.
    """

    antenna: str
    band: int
    mean_m: np.ndarray
    sd_m: np.ndarray
    count: np.ndarray
    repeatability: float = np.nan

    @property
    def share(self) -> float:
        """float: Part of the map that is taken for real, 2 r / (1 + r) of the repeatability r; else all."""
        r = self.repeatability
        return 1.0 if np.isnan(r) else float(2.0 * max(r, 0.0) / (1.0 + max(r, 0.0)))

    @property
    def azimuth_edges_rad(self) -> np.ndarray:
        """Ndarray, shape (a + 1,): from forward to the right."""
        return np.linspace(0.0, 2.0 * np.pi, self.mean_m.shape[0] + 1)

    @property
    def elevation_edges_rad(self) -> np.ndarray:
        """Ndarray, shape (e + 1,): above the horizon of the body."""
        return np.linspace(0.0, 0.5 * np.pi, self.mean_m.shape[1] + 1)

    @property
    def rms_m(self) -> float:
        """float: Root mean square over the residuals of the cells in use."""
        used = np.isfinite(self.mean_m)
        weight = self.count[used]
        return float(np.sqrt(np.sum(weight * self.mean_m[used] ** 2) / max(weight.sum(), 1)))

    def correction_m(self, azimuth_rad, elevation_rad) -> np.ndarray:
        """What the antenna adds to a phase, between the middles of the cells.

        Parameters
        ----------
        azimuth_rad, elevation_rad : ndarray
            Direction in the body frame.

        Returns
        -------
        ndarray
            Metres, that part of the map that comes back (`share`); zero where no cell around is in use.
        """
        n_azimuth, n_elevation = self.mean_m.shape
        place = np.mod(azimuth_rad, 2.0 * np.pi) * n_azimuth / (2.0 * np.pi) - 0.5
        height = np.asarray(elevation_rad) * n_elevation / (0.5 * np.pi) - 0.5
        column, row = np.floor(place), np.floor(height)
        total, weight = 0.0, 0.0
        value = np.nan_to_num(self.mean_m)
        is_used = np.isfinite(self.mean_m)
        for d_column in (0, 1):
            for d_row in (0, 1):
                i = np.mod(column + d_column, n_azimuth).astype(int)
                j = np.clip(row + d_row, 0, n_elevation - 1).astype(int)
                share = np.abs(1 - d_column - (place - column)) * np.abs(1 - d_row - (height - row))
                share = share * is_used[i, j]
                total, weight = total + share * value[i, j], weight + share
        return self.share * np.where(weight > 0.1, total / np.maximum(weight, 1e-9), 0.0)

    def to_csv(self) -> str:
        """Cells as lines of text, degrees and millimetres; of the means the part that is taken for real."""
        lines = []
        azimuth, elevation = np.degrees(self.azimuth_edges_rad), np.degrees(self.elevation_edges_rad)
        for i, j in np.argwhere(self.count > 0):
            numbers = [azimuth[i], azimuth[i + 1], elevation[j], elevation[j + 1]]
            text = ",".join(f"{x:g}" for x in numbers)
            numbers = [1e3 * self.share * self.mean_m[i, j], 1e3 * self.sd_m[i, j]]
            text += "".join(f",{x:.3f}" for x in numbers)
            lines.append(f"{self.antenna},L{self.band},{text},{self.count[i, j]}")
        return "\n".join(lines)


CSV_HEAD = (
    "antenna,band,azimuth_from_deg,azimuth_to_deg,elevation_from_deg,elevation_to_deg,mean_mm,sd_mm,count"
)


def map_residuals(
    baselines,
    positions_body_m,
    time_ns,
    rot_ned_from_body,
    *,
    names,
    azimuth_step_deg: float = 7.5,
    elevation_step_deg: float = 5.0,
) -> tuple[PhaseMap, ...]:
    """Maps of the antennas of an array from the residuals of its baselines.

    Parameters
    ----------
    baselines : sequence of BaselineSolution
        From the reference antenna to each other one, with residuals.
    positions_body_m : ndarray, shape (m, 3)
        Body coordinates, the reference first.
    time_ns : ndarray of int64, shape (n,)
        Epochs of the attitude.
    rot_ned_from_body : ndarray, shape (n, 3, 3)
        Attitude; NaN where there is none.
    names : sequence of str
        Of the antennas.
    azimuth_step_deg, elevation_step_deg : float
        Size of the cells, about.

    Returns
    -------
    tuple of PhaseMap
        By antenna and band.

    Raises
    ------
    ConfigError
        If the cells are too large.
    NoSolutionError
        If there are no residuals of accepted epochs with an attitude.
    """
    if not 0.0 < azimuth_step_deg <= 90.0 or not 0.0 < elevation_step_deg <= 45.0:
        raise ConfigError("the cells of a phase map are to be between 0 and 90 by 45 degrees", key="step")
    shape = (max(round(360.0 / azimuth_step_deg), 4), max(round(90.0 / elevation_step_deg), 2))
    parts = [
        _rows_in_body(solution, time_ns, rot_ned_from_body, shape, positions_body_m[k] - positions_body_m[0])
        for k, solution in enumerate(baselines, start=1)
    ]
    if sum(len(part[0]) for part in parts) == 0:
        raise NoSolutionError(
            "could not map the residuals: no accepted epoch has both an attitude and phase residuals"
        )
    baseline = np.repeat(np.arange(len(parts)), [len(part[0]) for part in parts])
    epoch, clock, band, cell, residual, design = (
        np.concatenate(columns) for columns in zip(*parts, strict=True)
    )
    bands, band = np.unique(band, return_inverse=True)
    n_cells = shape[0] * shape[1]
    slot = (baseline * len(bands) + band) * n_cells + cell
    clock = np.stack([clock, baseline], axis=1)

    def sums(rows):
        """Sums of powers of the residuals of some rows by baseline, band and cell, adjusted by themselves."""
        left = _adjust_maps(residual[rows], design[rows], epoch[rows], clock[rows], slot[rows])
        n_slots = len(parts) * len(bands) * n_cells
        table = np.stack([np.bincount(slot[rows], left**power, n_slots) for power in range(3)], axis=1)
        return table.reshape(len(parts), len(bands), n_cells, 3)

    is_late = epoch > np.median(epoch)
    whole, halves = sums(np.ones(len(epoch), bool)), (sums(~is_late), sums(is_late))
    found = []
    for k, value in enumerate(bands):
        early, late = (_split(half[:, k], shape) for half in halves)
        for a, (name, maps) in enumerate(zip(names, _split(whole[:, k], shape), strict=True)):
            found.append(PhaseMap(name, int(value), *maps, _repeatability(early[a], late[a])))
    return tuple(found)


def _repeatability(early, late):
    """Correlation of two maps over their common cells, weighted by the residuals of the poorer one."""
    both = np.isfinite(early[0]) & np.isfinite(late[0])
    if np.count_nonzero(both) < MIN_CELLS:
        return np.nan
    weight = np.minimum(early[2], late[2])[both]
    first, second = early[0][both], late[0][both]
    size = np.sqrt((weight @ first**2) * (weight @ second**2))
    return float(weight @ (first * second) / size) if size > 0.0 else np.nan


def _rows_in_body(solution, time_ns, rot_ned_from_body, shape, body_m):
    """Epoch, clock, band, cell, residual and design of the integer phases of a baseline's accepted epochs."""
    s = solution
    at = np.clip(np.searchsorted(time_ns, s.time_ns), 0, max(len(time_ns) - 1, 0))
    before = np.maximum(at - 1, 0)
    at = np.where(np.abs(time_ns[before] - s.time_ns) < np.abs(time_ns[at] - s.time_ns), before, at)
    known = s.is_accepted & np.isfinite(rot_ned_from_body[at, 0, 0])
    known &= np.abs(time_ns[at] - s.time_ns) < MAX_TIME_DIFFERENCE_NS
    rows = np.flatnonzero(
        known[s.residual_epoch]
        & np.isfinite(s.residual_m)
        & (np.isfinite(s.residual_integer_cyc) | s.residual_is_reference)
    )
    own = s.residual_epoch[rows]
    rot = rot_ned_from_body[at[own]]
    level = np.cos(s.residual_elevation_rad[rows])
    direction = np.stack(
        [
            level * np.cos(s.residual_azimuth_rad[rows]),
            level * np.sin(s.residual_azimuth_rad[rows]),
            -np.sin(s.residual_elevation_rad[rows]),
        ],
        axis=1,
    )
    # Against the vector of the rigid array, which hides less of a map than a baseline that follows it.
    ned_m = s.baseline_enu_m[own][:, [1, 0, 2]] * [1.0, 1.0, -1.0]
    arm_m = rot @ body_m
    residual = s.residual_m[rows] + np.einsum("ni,ni->n", direction, arm_m - ned_m)
    # A turn p of the array changes -e.(R l) by -e.(p x R l) = -p.(R l x e).
    design = -np.cross(arm_m, direction)
    clock = (at[own] * 10 + s.residual_sat[rows] // 100) * 1000 + s.residual_signal[rows]
    azimuth, elevation = direction_in_antenna(rot, direction)
    column = np.minimum((azimuth / (2.0 * np.pi) * shape[0]).astype(int), shape[0] - 1)
    row = np.clip((elevation / (0.5 * np.pi) * shape[1]).astype(int), 0, shape[1] - 1)
    keep = elevation > 0.0
    values = (at[own], clock, s.residual_signal[rows] // 100, column * shape[1] + row, residual, design)
    return tuple(value[keep] for value in values)


def _adjust_maps(residual, design, epoch, clock, slot):
    """Residuals less clocks and turns of their epochs, adjusted with the means of the cells in turns."""
    if len(residual) == 0:
        return residual
    _, clock = np.unique(clock, axis=0, return_inverse=True)
    clock = clock.ravel()
    _, epoch = np.unique(epoch, return_inverse=True)
    per_clock = np.bincount(clock)
    n_epochs = int(epoch.max()) + 1

    def without_clock(values):
        return values - (np.bincount(clock, values) / per_clock)[clock]

    design = np.stack([without_clock(column) for column in design.T], axis=1)
    normal = np.stack(
        [np.bincount(epoch, design[:, i] * design[:, j], n_epochs) for i in range(3) for j in range(3)],
        axis=1,
    ).reshape(-1, 3, 3)
    inverse = np.linalg.pinv(normal, rcond=1e-6, hermitian=True)
    counts = np.maximum(np.bincount(slot), 1)
    mean = np.zeros(len(counts))
    free = residual
    for _ in range(PASSES):
        left = residual - mean[slot]
        clocks = left - without_clock(left)
        rhs = np.stack(
            [np.bincount(epoch, column * (left - clocks), n_epochs) for column in design.T], axis=1
        )
        turn = np.einsum("nij,nj->ni", inverse, rhs)
        turned = np.einsum("ni,ni->n", design, turn[epoch])
        free = residual - clocks - turned
        mean = np.bincount(slot, free) / counts
    return free


def _split(table, shape):
    """Maps of the antennas, whose sum is zero, from sums of powers of the baselines' residuals."""
    count, total, square = np.moveaxis(table, 2, 0)
    enough = (count >= MIN_COUNT).all(0)
    safe = np.maximum(count, 1.0)
    mean = np.where(enough, total / safe, np.nan)
    variance = np.where(enough, np.maximum(square / safe - (total / safe) ** 2, 0.0), np.nan)
    reference = -mean.sum(0) / (len(mean) + 1)
    means = np.vstack([reference, mean + reference])
    # Half of the scatter of a difference is that of each antenna.
    spread = np.sqrt(0.5 * np.vstack([variance.mean(0), variance]))
    counts = np.vstack([count.min(0), count]).astype(np.int64)
    return [tuple(x[a].reshape(shape) for x in (means, spread, counts)) for a in range(len(means))]


def map_rows(observations: Observations, navigation, time_ns, rot_ned_from_body, maps) -> Observations:
    """Observations of one antenna without what its maps say that it adds.

    Parameters
    ----------
    observations : Observations
        Of the antenna.
    navigation : Navigation
        Ephemerides.
    time_ns : ndarray of int64, shape (n,)
        Epochs of the attitude.
    rot_ned_from_body : ndarray, shape (n, 3, 3)
        Attitude.
    maps : sequence of PhaseMap
        Of this antenna; signals of other bands stay as they are.

    Returns
    -------
    Observations
    """
    direction = directions_of_rows(observations, navigation)
    rot = attitude_of_rows(observations, time_ns, rot_ned_from_body)
    azimuth, elevation = direction_in_antenna(rot, direction)
    correction = np.full(observations.n_rows, np.nan)
    for one in maps:
        rows = np.flatnonzero((observations.signal // 100 == one.band) & np.isfinite(azimuth))
        correction[rows] = one.correction_m(azimuth[rows], elevation[rows])
    return correct_phases(observations, correction)


def read_phase_maps(path: str | os.PathLike[str]) -> tuple[PhaseMap, ...]:
    """Read maps that were written as a table.

    Parameters
    ----------
    path : str or path-like
        Table of ``truenorth calibrate array --phase-maps``.

    Returns
    -------
    tuple of PhaseMap

    Raises
    ------
    FormatError
        If it cannot be read.
    """
    from pathlib import Path

    from ..errors import FormatError

    try:
        lines = Path(path).read_text(encoding="utf-8").splitlines()
    except OSError as error:
        raise FormatError(f"could not read the phase maps: {error.strerror}", path=str(path)) from error
    if not lines or lines[0] != CSV_HEAD:
        raise FormatError("this is no table of phase maps; its first line is not theirs", path=str(path))
    tables: dict[tuple[str, int], tuple[np.ndarray, ...]] = {}
    for number, line in enumerate(lines[1:], start=2):
        try:
            name, band, *texts = line.split(",")
            low, high, bottom, top, mean, sd, count = map(float, texts)
            shape = (round(360.0 / (high - low)), round(90.0 / (top - bottom)))
            if (name, int(band[1:])) not in tables:
                tables[name, int(band[1:])] = (
                    np.full(shape, np.nan), np.full(shape, np.nan), np.zeros(shape, np.int64)
                )  # fmt: skip
            at = round(low / (high - low)), round(bottom / (top - bottom))
            table = tables[name, int(band[1:])]
            table[0][at], table[1][at], table[2][at] = 1e-3 * mean, 1e-3 * sd, count
        except (ValueError, IndexError, ZeroDivisionError):
            raise FormatError(
                "this line is no cell of a phase map", path=str(path), line_number=number
            ) from None
    return tuple(PhaseMap(name, band, *table) for (name, band), table in tables.items())
