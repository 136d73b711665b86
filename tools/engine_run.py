"""Drive the compiled engine with simulated single differences: one place for its long argument list."""

from dataclasses import dataclass

import numpy as np

from truenorth._kernels import engine
from truenorth.ambiguity.acceptance import chi2_limits
from truenorth.ambiguity.carried import EngineState

WAVELENGTH_M = 299_792_458.0 / 1575.42e6


@dataclass(frozen=True, eq=False)
class Run:
    """What the engine wrote: result rows, codes, residuals and integers per phase row, events."""

    table: np.ndarray
    status: np.ndarray
    reason: np.ndarray
    residual_m: np.ndarray
    integer_cyc: np.ndarray
    events: np.ndarray
    numbers: np.ndarray

    def __getattr__(self, name):
        """Column of the result rows by its name in the engine, in lower case."""
        return self.table[:, getattr(engine, name.upper())]

    @property
    def baseline_m(self):
        """Ndarray, shape (n_epochs, 3): baselines."""
        return self.table[:, engine.BX : engine.BZ + 1]

    @property
    def cov_m2(self):
        """Ndarray, shape (n_epochs, 3, 3): their covariances."""
        return self.table[:, engine.COV + np.array([[0, 3, 4], [3, 1, 5], [4, 5, 2]])]


@dataclass(frozen=True, eq=False)
class Rows:
    """Single differences, row by row: metres, design in ENU, variances, clock groups and arcs."""

    start: np.ndarray
    phase_m: np.ndarray
    code_m: np.ndarray
    design: np.ndarray
    wavelength_m: np.ndarray
    phase_variance_m2: np.ndarray
    code_variance_m2: np.ndarray
    group: np.ndarray
    arc: np.ndarray


def single_frequency(direction, phase_m, code_m, phase_sd_m, code_sd_m):
    """Rows of epochs that all see the same number of satellites on one frequency.

    `direction` (n_epochs, n_sats, 3) or (n_sats, 3), `phase_m` and `code_m` (n_epochs, n_sats); the
    standard deviations are undifferenced.
    """
    n_epochs, n_sats = phase_m.shape
    n = n_epochs * n_sats
    design = -np.broadcast_to(direction, (n_epochs, n_sats, 3)).reshape(n, 3)
    return Rows(
        start=np.arange(n_epochs + 1) * n_sats,
        phase_m=phase_m.ravel(),
        code_m=code_m.ravel(),
        design=design,
        wavelength_m=np.full(n, WAVELENGTH_M),
        phase_variance_m2=np.full(n, 2.0 * phase_sd_m**2),
        code_variance_m2=np.full(n, 2.0 * code_sd_m**2),
        group=np.zeros(n, np.int64),
        arc=np.tile(np.arange(n_sats), n_epochs),
    )


def run_engine(
    rows, *, use_code=True, length_m=np.nan, length_sd_m=0.0, use_length=True, check_length=True,
    length_tolerance_sd=4.0, probability=0.99, margin=20.0, cap_factor=5.0, max_nodes=10**7, max_exclusions=0,
    significance=1e-4, ratio_mode=0, ratio_limit=3.0, carry=False, hold=False, time_s=None, correlation_s=1.0,
    memory_epochs=1e9, min_epochs_to_fix=1, prior_information=None, prior_rhs=None,
    state=None,
):  # fmt: skip
    """One pass of the engine over `rows`; see `truenorth._kernels.engine.run_engine`."""

    def columns(*arrays):
        return [np.array(a, dtype=np.int64 if a.dtype.kind == "i" else np.float64) for a in arrays]

    n_epochs = len(rows.start) - 1
    start, phase, design, wavelength, variance, group, arc = columns(
        rows.start, rows.phase_m, rows.design, rows.wavelength_m, rows.phase_variance_m2, rows.group, rows.arc
    )
    has_code = np.isfinite(rows.code_m) & use_code
    code_start = np.concatenate(([0], np.cumsum(has_code)))[rows.start].astype(np.int64)
    table = np.empty((n_epochs, engine.N_COLUMNS))
    status, reason = np.zeros(n_epochs, np.uint8), np.zeros(n_epochs, np.uint8)
    residual, integer = np.empty(len(phase)), np.empty(len(phase))
    events, numbers = np.empty((20 * n_epochs + 100, 3), np.int64), np.empty((20 * n_epochs + 100, 2))
    widest = int(max(np.diff(start).max(initial=1), np.diff(code_start).max(initial=1)))
    state = EngineState.begin(0, int(arc.max(initial=0)) + 1, widest) if state is None else state
    constrain = bool(use_length and np.isfinite(length_m))
    n_events = engine.run_engine(
        np.arange(n_epochs, dtype=float) if time_s is None else np.array(time_s, dtype=float),
        start, phase, design, wavelength, variance, group, arc, code_start,
        *columns(rows.code_m[has_code], rows.design[has_code], rows.code_variance_m2[has_code]),
        *columns(rows.group[has_code]),
        np.zeros((3, 3)) if prior_information is None else np.array(prior_information, dtype=float),
        np.zeros(3) if prior_rhs is None else np.array(prior_rhs, dtype=float),
        float(length_m), float(length_sd_m) ** 2, constrain, bool(check_length and np.isfinite(length_m)),
        float(length_tolerance_sd), 10.0, float(cap_factor), float(margin), int(max_nodes),
        chi2_limits(significance, 200), float(probability), int(ratio_mode), np.full(200, float(ratio_limit)),
        int(max_exclusions), bool(carry), bool(hold), float(correlation_s), float(memory_epochs),
        int(min_epochs_to_fix), np.nan,
        state.memory, state.vector, state.slot_arc, state.arc_number, state.arc_value, state.carried,
        residual, integer, table, status, reason, events, numbers,
    )  # fmt: skip
    return Run(table, status, reason, residual, integer, events[:n_events], numbers[:n_events])
