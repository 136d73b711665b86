"""Colours and words that every figure shares.

The colours are those of Okabe and Ito, which people with any colour vision can tell apart.

References
----------
M. Okabe and K. Ito, "Color Universal Design", 2008.
"""

from dataclasses import fields, replace

import numpy as np

from ..attitude.array_solution import AttitudeSolution
from ..errors import Status
from ..timescales import format_gpst

__all__ = [
    "BAND_ALPHA",
    "STATUS_COLORS",
    "SYSTEM_COLORS",
    "accepted_rows",
    "azimuth_for_plot",
    "caption",
    "length_for_plot",
    "runs_of_epochs",
    "thin_epochs",
    "thin_rows",
]

STATUS_COLORS = {
    Status.FIXED: "#0072B2",
    Status.HELD: "#56B4E9",
    Status.FLOAT: "#E69F00",
    Status.NONE: "#999999",
}
"""The one palette of the status, in every figure."""

SYSTEM_COLORS = {
    "G": "#0072B2",
    "R": "#D55E00",
    "E": "#009E73",
    "C": "#CC79A7",
    "J": "#56B4E9",
    "I": "#E69F00",
    "S": "#000000",
}

BAND_ALPHA = 0.2

MAX_EPOCHS_DRAWN = 12_000
"""On an interactive page; more make browsers slow."""


def caption(solution):
    """What a figure shows: data set, epochs, share accepted.

    Parameters
    ----------
    solution : BaselineSolution
        Result of `truenorth.solve_baseline`.

    Returns
    -------
    str
        One line.
    """
    if isinstance(solution, AttitudeSolution):
        source = f"{len(solution.antennas)} antennas ({', '.join(solution.antennas)}), "
    else:
        from ..export.rtklib_pos import input_paths

        names = [name.replace("\\", "/").rsplit("/", 1)[-1] for name in input_paths(solution)[:2]]
        rover, base = (*names, "", "")[:2]
        source = f"{base} to {rover}, " if base and rover else ""
    if solution.n_epochs == 0:
        return f"{source}no epochs"
    share = 100.0 * np.count_nonzero(solution.is_accepted) / solution.n_epochs
    method = solution.settings.get("method")
    how = f", method {method}" if method else ""
    return (
        f"{source}{format_gpst(solution.time_ns[0], decimals=0)} to "
        f"{format_gpst(solution.time_ns[-1], decimals=0)} GPST, {solution.n_epochs} epochs, "
        f"{share:.1f} % accepted{how}"
    )


def azimuth_for_plot(solution, azimuth_rad=None):
    """Azimuths in degrees on a scale that is not broken where it need not be.

    When all accepted azimuths lie within half a turn, they are given around their circular mean
    (so they may be negative or above 360; label them modulo 360). Otherwise they stay in [0, 360).

    Parameters
    ----------
    solution : BaselineSolution or AttitudeSolution
        Result of `truenorth.solve_session`.
    azimuth_rad : ndarray, shape (n,), optional
        An angle of the whole circle; that of the baseline by default.

    Returns
    -------
    azimuth_deg : ndarray, shape (n,)
    is_whole_circle : bool
        Whether the scale is [0, 360).
    """
    azimuth_deg = np.degrees(solution.azimuth_rad if azimuth_rad is None else azimuth_rad)
    good = solution.is_accepted & np.isfinite(azimuth_deg)
    if not np.any(good):
        good = np.isfinite(azimuth_deg)
    if not np.any(good):
        return azimuth_deg, True
    mean_deg = np.degrees(np.angle(np.mean(np.exp(1j * np.radians(azimuth_deg[good])))))
    off_deg = (azimuth_deg - mean_deg + 180.0) % 360.0 - 180.0
    if np.ptp(off_deg[good]) > 180.0:
        return azimuth_deg, True
    centre_deg = mean_deg % 360.0
    return centre_deg + off_deg, False


def length_for_plot(solution):
    """Measured length less the declared one, or less its median, or itself where it varies by metres.

    Parameters
    ----------
    solution : BaselineSolution
        Result of `truenorth.solve_baseline`.

    Returns
    -------
    value, sd : ndarray, shape (n,)
        What to draw and its standard deviation.
    label : str
        Name and unit of the axis.
    """
    declared_m = solution.settings.get("length_m")
    use = solution.is_accepted if np.any(solution.is_accepted) else np.isfinite(solution.length_m)
    measured_m = solution.length_m[use & np.isfinite(solution.length_m)]
    if declared_m is not None:
        reference_m, name = float(declared_m), "declared"
    elif len(measured_m) and np.ptp(measured_m) > 1.0:
        return solution.length_m, solution.length_sd_m, "length, m"
    else:
        reference_m, name = (float(np.median(measured_m)) if len(measured_m) else np.nan), "median"
    value_mm = 1e3 * (solution.length_m - reference_m)
    return value_mm, 1e3 * solution.length_sd_m, f"length less {name}, mm"


def accepted_rows(solution):
    """Rows of the phase residuals that belong to accepted epochs and exist, as indices."""
    shown = solution.is_accepted[solution.residual_epoch] & np.isfinite(solution.residual_m)
    return np.flatnonzero(shown)


def thin_rows(n_rows, limit):
    """Rows to draw so that there are no more than about `limit`, evenly taken."""
    return np.arange(0, n_rows, max(1, -(-n_rows // limit)))


def thin_epochs(epochs, limit=MAX_EPOCHS_DRAWN, *, keep=None):
    """Thin epochs so that a page stays light: every few of them, and those that must be seen.

    Parameters
    ----------
    epochs : AttitudeSolution or Comparison
        What is to be drawn.
    limit : int
        About so many epochs remain.
    keep : ndarray of bool, shape (n,), optional
        Epochs that stay in any case.

    Returns
    -------
    AttitudeSolution or Comparison
        With the chosen rows of every array that has one row per epoch; the same object where nothing is
        left out.
    step : int
        Every so many epochs were taken.
    """
    n = epochs.n_epochs
    step = max(1, -(-n // limit))
    if step == 1:
        return epochs, 1
    chosen = np.arange(n) % step == 0
    if keep is not None:
        chosen |= keep
    rows = np.flatnonzero(chosen)
    values = {entry.name: getattr(epochs, entry.name) for entry in fields(epochs)}
    thinned = {
        name: value[rows]
        for name, value in values.items()
        if isinstance(value, np.ndarray) and value.shape[:1] == (n,)
    }
    return replace(epochs, **thinned), step


def runs_of_epochs(time_ns, value, *, jump=np.inf):
    """Split epochs where a line through them would lie.

    Parameters
    ----------
    time_ns : ndarray of int64, shape (n,)
        GPS time, nanoseconds.
    value : ndarray of float64, shape (n,)
        What is drawn; NaN where nothing is.
    jump : float
        Neighbours further apart are not joined; 180 for azimuths in degrees.

    Returns
    -------
    list of ndarray of int
        Epochs of each run without gap, missing value or jump.
    """
    known = np.flatnonzero(np.isfinite(value))
    if len(known) == 0:
        return []
    spacing_ns = np.median(np.diff(time_ns)) if len(time_ns) > 1 else 0
    step_ns, step = np.diff(time_ns[known]), np.abs(np.diff(value[known]))
    cut = (step_ns > 1.5 * spacing_ns) | (step > jump) | (np.diff(known) > 1)
    return np.split(known, np.flatnonzero(cut) + 1)
