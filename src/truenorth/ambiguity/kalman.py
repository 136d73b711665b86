"""Integers from the motion of the satellites: triple differences, then two Kalman filters (Oguz 2006).

The antennas stand still: the baseline b is constant in the local frame, so over minutes the changing
directions to the satellites separate it from the constant integers N of the double differences,

    z = H b / wavelength + N + v,       x = (b, N),  Phi = I,  Q = 0,  cov(v) = R.

The thesis prints this with N on the other side in (4.9) and (4.27), and on this side in (4.19); here
it is phase = range + wavelength * N throughout. The start is the triple difference

    z(t) - z(t0) = (H(t) - H(t0)) b / wavelength,     b = wavelength (dH' W dH)^-1 dH' W dz,

whose 1/wavelength is missing in (4.10)-(4.11). When the float integers are sharp and their rounding
has been stable, they are fixed, and the attitude estimator, three states with known integers,
takes over. With an infinite start covariance the triple difference cannot change the result; it is
offered because it is the thesis's first step, and as a cross-check.

References: Oguz 2006, *Implementation of Northfinding Techniques*, METU, sec. 4.1-4.4; Kim 1994;
van Graas & Braasch 1991.
"""

from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from ..errors import ConfigError, ModelError, Reason, Status
from .model import Resolution
from .outcome import chi2_limits, unresolved
from .row_identity import carry_matrix

__all__ = [
    "KalmanAttitudeEstimator",
    "KalmanIntegerEstimator",
    "KalmanOptions",
    "chain_covariance",
    "triple_difference_baseline",
]

_NORMAL = NormalDist()

_UNKNOWN_CYC = 1e4
"""Standard deviation of an integer of which nothing is known, cycles."""


def chain_covariance(n_rows, single_difference_variance):
    """Covariance of the chained double differences 1-2, 2-3, 3-4, ... (Oguz 2006, (4.21)-(4.24)).

    Parameters
    ----------
    n_rows : int
        Number of double differences.
    single_difference_variance : float
        Variance r of a single difference, in any unit squared.

    Returns
    -------
    ndarray, shape (n_rows, n_rows)
        2r on the diagonal, -r beside it.
    """
    return single_difference_variance * (2.0 * np.eye(n_rows) - np.eye(n_rows, k=1) - np.eye(n_rows, k=-1))


def triple_difference_baseline(phase_m, design, phase_start_m, design_start, cov_phase_m2):
    """Baseline from the change of double-difference phases between two instants; no integers enter.

    Parameters
    ----------
    phase_m, phase_start_m : ndarray, shape (m,)
        The same double differences at both instants, metres.
    design, design_start : ndarray, shape (m, 3)
        Their design rows.
    cov_phase_m2 : ndarray, shape (m, m)
        Covariance of one instant's phases.

    Returns
    -------
    baseline_enu_m : ndarray, shape (3,)
        In the frame of the design.
    cov_m2 : ndarray, shape (3, 3)
        Its covariance; at a second of distance between the instants it is huge, at five minutes some
        decimetres.

    Raises
    ------
    ModelError
        If the directions did not change enough to give three coordinates.
    """
    change = np.asarray(design, dtype=float) - design_start
    weight = np.linalg.solve(2.0 * np.asarray(cov_phase_m2, dtype=float), change)
    normal = change.T @ weight
    if len(change) < 3 or np.linalg.cond(normal) > 1e14:
        raise ModelError(
            "differencing phases in time: the directions to the satellites changed too little for a "
            "baseline; take instants that are minutes apart"
        )
    cov = np.linalg.inv(normal)
    return cov @ (weight.T @ (np.asarray(phase_m) - phase_start_m)), cov


@dataclass(frozen=True, slots=True, kw_only=True)
class KalmanOptions:
    """Settings of the integer estimator.

    Parameters
    ----------
    start : {"diffuse", "triple_difference"}
        Start at the first epoch with a wide baseline, or after `start_epochs` with the triple
        difference of the first and the last of them.
    start_epochs : int
        Epochs between the two instants of the triple difference.
    baseline_sd_m : float or None
        Standard deviation of the wide start, metres; None takes ten lengths, or 1 km where the length
        is unknown.
    use_code : bool
        Pseudoranges are measurements too (the thesis has none).
    max_integer_sd_cyc : float
        All float integers have to be known better than that before they are rounded, cycles.
    stable_epochs : int
        Epochs over which the rounded integers have to stay.
    fix_significance : float
        False-alarm rate of the residual test of an epoch with its integers fixed.
    innovation_significance : float
        False-alarm rate of the innovation test; rows that fail it start a new integer.
    length_tolerance_m : float
        Allowed difference of the measured from the declared length, metres, beside four standard
        deviations.
    """

    start: str = "diffuse"
    start_epochs: int = 300
    baseline_sd_m: float | None = None
    use_code: bool = True
    max_integer_sd_cyc: float = 0.10
    stable_epochs: int = 10
    fix_significance: float = 1e-3
    innovation_significance: float = 1e-6
    length_tolerance_m: float = 0.02

    def __post_init__(self):
        if self.start not in ("diffuse", "triple_difference"):
            raise ConfigError(
                f"`start` is {self.start!r}; give diffuse or triple_difference", key="start", value=self.start
            )
        if not 0.0 < self.max_integer_sd_cyc < 0.5:
            raise ConfigError(
                f"`max_integer_sd_cyc` is {self.max_integer_sd_cyc!r}; give a value between 0 and 0.5",
                key="max_integer_sd_cyc",
                value=self.max_integer_sd_cyc,
            )
        if self.stable_epochs < 1 or self.start_epochs < 1:
            raise ConfigError("`stable_epochs` and `start_epochs` must be at least 1", key="stable_epochs")


class KalmanAttitudeEstimator:
    """Three states, the constant baseline, from phases whose integers are known (Oguz 2006, (4.27)).

    An information filter: it starts with nothing.
    """

    def __init__(self):
        self.normal = np.zeros((3, 3))
        self.right = np.zeros(3)

    def update(self, free_phase_m, design, cov_phase_m2):
        """Take one epoch.

        Parameters
        ----------
        free_phase_m : ndarray, shape (m,)
            Double differences less their integers, metres.
        design : ndarray, shape (m, 3)
            Design rows.
        cov_phase_m2 : ndarray, shape (m, m)
            Covariance.

        Returns
        -------
        baseline_m : ndarray, shape (3,)
            Estimate so far, in the frame of the design; NaN while it is not determined.
        cov_m2 : ndarray, shape (3, 3)
            Its covariance for noise that is white in time.
        """
        weight = np.linalg.solve(cov_phase_m2, design)
        self.normal = self.normal + design.T @ weight
        self.right = self.right + weight.T @ free_phase_m
        if np.linalg.matrix_rank(self.normal) < 3:
            return np.full(3, np.nan), np.full((3, 3), np.nan)
        cov = np.linalg.inv(self.normal)
        return cov @ self.right, cov


class KalmanIntegerEstimator:
    """Float integers of a standing baseline, epoch by epoch, until they can be rounded.

    The antennas must stand still in the local frame; a platform that turns needs another method.

    Parameters
    ----------
    options : KalmanOptions, optional
        Settings.
    """

    def __init__(self, options=None):
        self.options = options or KalmanOptions()
        self.reset()

    def reset(self):
        """Forget everything."""
        self._first = None
        self._waited = 0
        self._state = None
        self._cov = None
        self._rows = None
        self._rounded = None
        self._stable = 0
        self._attitude = KalmanAttitudeEstimator()
        self._refused = 0
        self._fresh = None

    @property
    def float_integers_cyc(self):
        """Ndarray, shape (m,): float integers of the last epoch's rows; empty before the start."""
        return np.empty(0) if self._state is None else self._state[3:].copy()

    @property
    def float_integer_sd_cyc(self):
        """Ndarray, shape (m,): their standard deviations."""
        return np.empty(0) if self._state is None else np.sqrt(np.diag(self._cov)[3:])

    def update(self, problem, row_key=None, reference_key=None):
        """Take one epoch.

        Parameters
        ----------
        problem : DoubleDifferences
            The epoch.
        row_key : ndarray of int, shape (m,), optional
            Identity of each row's satellite and signal. Without it, rows are taken to be those of
            the last epoch as long as their number and wavelengths stay.
        reference_key : ndarray of int, shape (m,), optional
            The same identity for the row's reference satellite; with it a change of the reference
            transforms the states exactly.

        Returns
        -------
        Resolution
            `Status.FLOAT` until the integers are sharp and stable, then `Status.FIXED` with the
            baseline of the attitude estimator.
        """
        if problem.n_phases < 3:
            return unresolved(problem, Reason.TOO_FEW_SATELLITES)
        try:
            np.linalg.cholesky(problem.cov_phase_m2)
        except np.linalg.LinAlgError as error:
            raise ModelError(
                "filtering integers: the covariance of the double-difference phases is not positive "
                "definite; check the noise settings"
            ) from error
        rows = (row_key, reference_key, np.array(problem.wavelength_m, dtype=float))
        if self._state is not None:
            self._carry(problem, rows)
        if self._state is None and not self._begin(problem, rows):
            return unresolved(problem, Reason.NOT_PERSISTENT)
        self._rows = rows
        self._filter(problem)
        return self._decide(problem)

    def _begin(self, problem, rows):
        """Set up the states; false while the triple difference still waits for its second instant."""
        options = self.options
        length = problem.length_m if problem.length_m > 0.0 else np.nan
        sd = options.baseline_sd_m
        if sd is None:
            sd = 10.0 * length if np.isfinite(length) else 1000.0
        baseline, cov = np.zeros(3), np.eye(3) * sd**2
        if problem.prior_baseline_enu_m is not None and problem.cov_prior_m2 is not None:
            baseline, cov = np.asarray(problem.prior_baseline_enu_m, dtype=float), problem.cov_prior_m2
        if options.start == "triple_difference":
            if self._first is not None:
                matrix, known = carry_matrix(*_identities(self._first[1], rows))
                same = np.array_equal(matrix, np.eye(len(matrix))) and known.all()
                if not same:
                    self._first = None
            if self._first is None:
                self._first, self._waited = (problem, rows), 0
                return False
            self._waited += 1
            if self._waited < options.start_epochs:
                return False
            start = self._first[0]
            baseline, cov = triple_difference_baseline(
                problem.phase_m, problem.design, start.phase_m, start.design, problem.cov_phase_m2
            )
            self._first = None
        self._state = np.concatenate([baseline, np.zeros(problem.n_phases)])
        self._cov = np.zeros((3 + problem.n_phases, 3 + problem.n_phases))
        self._cov[:3, :3] = cov
        self._introduce(problem, np.ones(problem.n_phases, dtype=bool))
        self._rounded, self._stable = None, 0
        return True

    def _carry(self, problem, rows):
        """Move the states to this epoch's rows."""
        old_key, _, new_key, _ = identities = _identities(self._rows, rows)
        if old_key is None:
            self.reset()
            return
        if old_key is new_key:
            return
        matrix, known = carry_matrix(*identities)
        if np.count_nonzero(known) == 0:
            self.reset()
            return
        if np.array_equal(matrix, np.eye(len(known))):
            return
        full = np.zeros((3 + len(known), len(self._state)))
        full[:3, :3] = np.eye(3)
        full[3:, 3:] = matrix
        self._state = full @ self._state
        self._cov = full @ self._cov @ full.T
        if self._rounded is not None:
            self._rounded = np.rint(matrix @ self._rounded).astype(np.int64)
        self._introduce(problem, ~known)
        if not known.all():
            # A new integer has to prove itself before the set as a whole is trusted.
            self._rounded, self._stable = None, 0

    def _introduce(self, problem, new):
        """Give rows an integer of which nothing is known."""
        place = 3 + np.flatnonzero(new)
        self._state[place] = (problem.phase_m[new] - problem.design[new] @ self._state[:3]) / (
            problem.wavelength_m[new]
        )
        self._cov[place, :] = 0.0
        self._cov[:, place] = 0.0
        self._cov[place, place] = _UNKNOWN_CYC**2
        self._fresh = new if self._fresh is None else self._fresh | new

    def _filter(self, problem):
        """Update with the phases and the code; rows that cannot be what they were start a new integer."""
        m = problem.n_phases
        fresh = np.zeros(m, dtype=bool) if self._fresh is None else self._fresh
        self._fresh = None
        observation = np.zeros((m, 3 + m))
        observation[:, :3] = problem.design
        observation[:, 3:] = np.diag(problem.wavelength_m)
        slipped, inflation = self._slips(problem, observation, ~fresh)
        if slipped.any():
            self._introduce(problem, slipped)
            self._fresh = None
            self._rounded, self._stable = None, 0
        innovation = problem.phase_m - observation @ self._state
        self._measure(innovation, observation, inflation * problem.cov_phase_m2)
        if self.options.use_code and len(problem.code_m):
            observation = np.zeros((len(problem.code_m), 3 + m))
            observation[:, :3] = problem.code_design
            self._measure(problem.code_m - observation @ self._state, observation, problem.cov_code_m2)

    def _slips(self, problem, observation, rows):
        """Rows whose innovation cannot be noise, found one by one; and a factor for the noise.

        Returns
        -------
        slipped : ndarray of bool, shape (m,)
        inflation : float
            Above 1 where the innovations as a whole are too large but no row stands out.
        """
        significance = self.options.innovation_significance
        edge = -_NORMAL.inv_cdf(significance / 2.0)
        rows = rows.copy()
        slipped = np.zeros(len(rows), dtype=bool)
        while rows.any():
            part = observation[rows]
            innovation = problem.phase_m[rows] - part @ self._state
            spread = part @ self._cov @ part.T + problem.cov_phase_m2[np.ix_(rows, rows)]
            inverse = np.linalg.inv(spread)
            pull = inverse @ innovation
            statistic = float(innovation @ pull)
            limit = chi2_limits(int(np.count_nonzero(rows)), significance)[1]
            if statistic <= limit:
                break
            score = np.abs(pull) / np.sqrt(np.diag(inverse))
            worst = int(np.argmax(score))
            if score[worst] < edge:
                return slipped, statistic / limit
            where = np.flatnonzero(rows)[worst]
            slipped[where], rows[where] = True, False
        return slipped, 1.0

    def _measure(self, innovation, observation, noise):
        """Kalman update in the form that keeps the covariance positive."""
        # Cholesky does not mind that unknown integers make the scales of the rows differ wildly.
        lower = np.linalg.cholesky(observation @ self._cov @ observation.T + noise)
        half = np.linalg.solve(lower, observation @ self._cov)
        gain = np.linalg.solve(lower.T, half).T
        self._state = self._state + gain @ innovation
        rest = np.eye(len(self._state)) - gain @ observation
        self._cov = rest @ self._cov @ rest.T + gain @ noise @ gain.T

    def _decide(self, problem):
        options = self.options
        m = problem.n_phases
        floats = self._state[3:]
        rounded = np.rint(floats).astype(np.int64)
        sharp = self.float_integer_sd_cyc.max() <= options.max_integer_sd_cyc
        if sharp and self._rounded is not None and np.array_equal(rounded, self._rounded):
            self._stable += 1
        else:
            # The filtered baseline of other integers is worth nothing.
            if self._rounded is None or not np.array_equal(rounded, self._rounded):
                self._attitude = KalmanAttitudeEstimator()
            self._stable = 1 if sharp else 0
        self._rounded = rounded
        free_phase = problem.phase_m - problem.wavelength_m * rounded
        weight = np.linalg.solve(problem.cov_phase_m2, problem.design)
        cov_epoch = np.linalg.inv(problem.design.T @ weight)
        epoch_baseline = cov_epoch @ (weight.T @ free_phase)
        residual = free_phase - problem.design @ epoch_baseline
        chi2 = float(residual @ np.linalg.solve(problem.cov_phase_m2, residual))
        limit = chi2_limits(m - 3, options.fix_significance)[1]
        off = floats - rounded
        objective = float(off @ np.linalg.solve(self._cov[3:, 3:], off))
        baseline, cov = self._state[:3].copy(), self._cov[:3, :3].copy()
        status = Status.FLOAT
        if not sharp or self._stable < options.stable_epochs:
            reason = Reason.NOT_PERSISTENT
        elif chi2 > limit:
            reason = Reason.RESIDUAL_TEST
        else:
            fixed, cov_fixed = self._attitude.update(free_phase, problem.design, problem.cov_phase_m2)
            length = np.linalg.norm(fixed)
            along = fixed / length
            declared = problem.length_sd_m if np.isfinite(problem.length_sd_m) else 0.0
            tolerance = options.length_tolerance_m + 4.0 * np.hypot(
                np.sqrt(along @ cov_fixed @ along), declared
            )
            if problem.length_m > 0.0 and abs(length - problem.length_m) > tolerance:
                reason = Reason.LENGTH_TEST
            else:
                reason, status = Reason.OK, Status.FIXED
                baseline, cov = fixed, cov_fixed
        # A set that stays sharp and keeps failing is wrong: nothing but a new start will mend it.
        failing = reason in (Reason.RESIDUAL_TEST, Reason.LENGTH_TEST)
        self._refused = self._refused + 1 if failing else 0
        resolution = Resolution(
            status=status,
            reason=reason,
            integers_cyc=rounded[None, :],
            objective=np.array([objective]),
            baseline_enu_m=baseline[None, :],
            cov_baseline_m2=cov,
            float_baseline_enu_m=self._state[:3].copy(),
            is_fixed=np.full(m, status == Status.FIXED),
            ratio=np.nan,
            success_probability=self._rounding_success() if sharp else np.nan,
            chi2=chi2,
            chi2_limit=limit,
            n_candidates=1,
        )
        if self._refused >= 10 * options.stable_epochs:
            self.reset()
        return resolution

    def _rounding_success(self):
        """Lower bound of the probability that rounding every float integer is right (Teunissen 1998)."""
        from scipy.special import erf

        return float(np.prod(erf(0.5 / (np.sqrt(2.0) * self.float_integer_sd_cyc))))


def _identities(old, new):
    """Keys and references of two epochs' rows; row numbers stand in where no keys were given."""
    old_key, old_reference, old_wavelength = old
    new_key, new_reference, new_wavelength = new
    if old_key is None or new_key is None:
        if len(old_wavelength) == len(new_wavelength) and np.array_equal(old_wavelength, new_wavelength):
            numbers = np.arange(len(new_wavelength))
            return numbers, None, numbers, None
        return None, None, None, None
    return np.asarray(old_key), old_reference, np.asarray(new_key), new_reference
