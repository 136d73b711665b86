"""Least-squares ambiguity search (Hatch) with the antenna separation known, epoch by epoch.

Four high satellites (three double differences) span the search: every integer triple whose baseline
lies in the search region is a candidate. The other, secondary integers follow by rounding, all rows
give the baseline and the residual quadratic form

    Omega = v' C^-1 v,        accepted if  Omega_1 <= chi2(1 - alpha, m - 3)
                              and  sum Omega_2 / sum Omega_1 > ratio,  sums over the epochs,

and a candidate whose baseline has the wrong length is dropped. Candidates live on from epoch to
epoch with their sums until one wins.

A rival that differs from the winner in secondary integers only is not enumerated: the method takes
one set per primary triple. With one degree of freedom left (five satellites) a ratio of 3 arises by
chance and protects little; the tables in ``docs/validation`` say how little.

References: Hatch 1990, "Instantaneous ambiguity resolution"; Harvey 1998, UCGE Report 20117,
ch. 4 (regions, RPDOP, tests, with (4.10)-(4.12) corrected); Wang & Lachapelle 2002 (shell, ratio,
minimum time to fix); Lu 1995, UCGE Report 20079 (spherical region).
"""

from dataclasses import dataclass

import numpy as np

from ..errors import ConfigError, ModelError, Reason, Status
from .model import Resolution
from .outcome import chi2_limits, code_baseline, unresolved
from .row_identity import carry_matrix

__all__ = [
    "LeastSquaresSearch",
    "LsastOptions",
    "aiding_box",
    "direction_prior",
    "primary_region_count",
    "resolve_lsast",
    "select_primaries",
]

_EDGE = 1e-9
"""Relative widening of the walked ellipsoid, so that rounding loses no point on its border."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LsastOptions:
    """Settings of the least-squares ambiguity search.

    Parameters
    ----------
    region : {"shell", "sphere"}
        Keep primary baselines near the known length, or all inside the sphere.
    coarse_length_tolerance_m : float
        Half thickness of the shell, and what the sphere's radius exceeds the length by, metres.
        0.30 m is 2 cm of phase error times the largest RPDOP (Harvey 1998, sec. 4.2).
    fine_length_tolerance_m : float or None
        Limit on the length of the baseline of all rows, metres; None takes `length_tolerance_sd`.
    length_tolerance_sd : float
        Joint standard deviations of measured and declared length, used where the fine tolerance
        is None.
    max_rpdop : float
        Largest relative PDOP of the primaries.
    aid : {"ellipsoid", "box", "cone", "none"}
        How an a-priori baseline narrows the region.
    aid_sigmas : float
        Half width of that region in standard deviations.
    use_code : bool
        Pseudoranges narrow the region where they can.
    code_sigmas : float
        Half width of the pseudoranges' region in standard deviations.
    secondary_rounding : {"sequential", "primary"}
        Round the secondary rows one after the other, each with the baseline of all before it, or
        all of them from the primary baseline.
    residual_significance : float
        False-alarm rate of the chi-square test.
    drop_significance : float
        False-alarm rate of the same test where it drops a candidate from the memory; smaller, since
        one bad epoch should not lose the right set.
    residual_tails : {"upper", "both"}
        ``both`` also rejects residuals that are too small (Harvey 1998, (4.8)).
    ratio_threshold : float
        Sum of the second best over sum of the best that has to be exceeded.
    single_candidate : {"refuse", "accept"}
        What a lone survivor is worth: nothing (the ratio is void), or a fix (Harvey 1998).
    min_epochs : int
        Epochs that the winner must have led before it is declared fixed.
    n_keep : int
        Candidates carried at most.
    max_candidates : int
        Refuse searches that are expected to visit more lattice points.
    """

    region: str = "shell"
    coarse_length_tolerance_m: float = 0.30
    fine_length_tolerance_m: float | None = 0.02
    length_tolerance_sd: float = 4.0
    max_rpdop: float = 14.0
    aid: str = "ellipsoid"
    aid_sigmas: float = 3.0
    use_code: bool = True
    code_sigmas: float = 5.0
    secondary_rounding: str = "sequential"
    residual_significance: float = 1e-3
    drop_significance: float = 1e-5
    residual_tails: str = "upper"
    ratio_threshold: float = 3.0
    single_candidate: str = "refuse"
    min_epochs: int = 1
    n_keep: int = 200
    max_candidates: int = 3_000_000

    def __post_init__(self):
        words = {
            "region": ("shell", "sphere"),
            "aid": ("ellipsoid", "box", "cone", "none"),
            "secondary_rounding": ("sequential", "primary"),
            "residual_tails": ("upper", "both"),
            "single_candidate": ("refuse", "accept"),
        }
        for key, allowed in words.items():
            value = getattr(self, key)
            if value not in allowed:
                raise ConfigError(
                    f"`{key}` is {value!r}; give one of {', '.join(allowed)}", key=key, value=value
                )
        for key in ("coarse_length_tolerance_m", "aid_sigmas", "code_sigmas", "max_rpdop"):
            if not getattr(self, key) > 0.0:
                value = getattr(self, key)
                raise ConfigError(f"`{key}` is {value!r}; give a positive number", key=key, value=value)
        if not 0.0 < self.residual_significance < 1.0:
            raise ConfigError(
                f"`residual_significance` is {self.residual_significance!r}; give a rate between 0 and 1",
                key="residual_significance",
                value=self.residual_significance,
            )
        if self.n_keep < 2 or self.min_epochs < 1:
            raise ConfigError("`n_keep` must be at least 2 and `min_epochs` at least 1", key="n_keep")


def direction_prior(azimuth_rad, elevation_rad, length_m, azimuth_sd_rad, elevation_sd_rad, length_sd_m):
    """A-priori baseline and covariance from a compass, a tilt meter and a measured length.

    Parameters
    ----------
    azimuth_rad, elevation_rad, length_m : float
        Direction and length.
    azimuth_sd_rad, elevation_sd_rad, length_sd_m : float
        Standard deviations.

    Returns
    -------
    baseline_enu_m : ndarray, shape (3,)
        East, north, up.
    cov_m2 : ndarray, shape (3, 3)
        First-order covariance.
    """
    sa, ca = np.sin(azimuth_rad), np.cos(azimuth_rad)
    se, ce = np.sin(elevation_rad), np.cos(elevation_rad)
    along = np.array([sa * ce, ca * ce, se])
    # Columns: change of the baseline with azimuth, elevation and length.
    jacobian = np.column_stack(
        [length_m * np.array([ca * ce, -sa * ce, 0.0]), length_m * np.array([-sa * se, -ca * se, ce]), along]
    )
    cov = (jacobian * np.array([azimuth_sd_rad, elevation_sd_rad, length_sd_m]) ** 2) @ jacobian.T
    return length_m * along, cov


def aiding_box(azimuth_rad, length_m, azimuth_sd_rad, elevation_sd_rad, length_sd_m, *, sigmas=3.0):
    """Half widths of the aided search box of Harvey 1998, (4.10)-(4.12), in east, north, up.

    The printed sums of signed terms can vanish or turn negative; absolute values are meant:

        h_E = k (s_b |sin a| + s_a b |cos a|),  h_N = k (s_b |cos a| + s_a b |sin a|),  h_U = k s_e b

    Parameters
    ----------
    azimuth_rad, length_m : float
        Azimuth and length of the baseline; its elevation is taken as small.
    azimuth_sd_rad, elevation_sd_rad, length_sd_m : float
        Standard deviations s_a, s_e, s_b.
    sigmas : float
        The factor k.

    Returns
    -------
    ndarray, shape (3,)
        Half widths, metres.
    """
    sa, ca = abs(np.sin(azimuth_rad)), abs(np.cos(azimuth_rad))
    return sigmas * np.array(
        [
            length_sd_m * sa + azimuth_sd_rad * length_m * ca,
            length_sd_m * ca + azimuth_sd_rad * length_m * sa,
            elevation_sd_rad * length_m,
        ]
    )


def select_primaries(problem, max_rpdop=14.0):
    """Three rows of the first group whose satellites stand highest and see the baseline well.

    The lowest of them is replaced by the next lower satellite until the relative PDOP,
    ``sqrt(trace((H'H)^-1))``, is small enough (Harvey 1998, sec. 4.2); failing that, the best triple
    of the group is tried, and then of all rows.

    Parameters
    ----------
    problem : DoubleDifferences
        One epoch.
    max_rpdop : float
        Largest relative PDOP.

    Returns
    -------
    rows : ndarray of int64, shape (3,) or (0,)
        Chosen rows, highest first; empty where no triple will do.
    rpdop : float
        Their relative PDOP; NaN where there are fewer than three rows.
    """
    from itertools import combinations

    m = problem.n_phases
    if m < 3:
        return np.empty(0, dtype=np.int64), np.nan
    elevation = -np.arange(m, dtype=float) if problem.elevation_rad is None else problem.elevation_rad
    high_first = np.argsort(-elevation, kind="stable")
    pools = [high_first]
    if problem.group is not None:
        for group in np.unique(problem.group):
            rows = high_first[problem.group[high_first] == group]
            if len(rows) >= 3:
                pools.insert(0, rows)
                break

    def rpdop(rows):
        h = problem.design[list(rows)]
        if abs(np.linalg.det(h)) < 1e-9:
            return np.inf
        inverse = np.linalg.inv(h)
        return float(np.sqrt(np.sum(inverse**2)))

    best, best_rows = np.inf, None
    for pool in pools:
        for k in range(2, len(pool)):
            rows = [pool[0], pool[1], pool[k]]
            value = rpdop(rows)
            if value <= max_rpdop:
                return np.array(rows, dtype=np.int64), value
        for rows in combinations(pool[:12], 3):
            value = rpdop(rows)
            if value < best:
                best, best_rows = value, rows
        if best <= max_rpdop:
            return np.array(best_rows, dtype=np.int64), best
    return np.empty(0, dtype=np.int64), best


class _Region:
    """Where the primary baseline may lie: the ellipsoid that is walked, and the other conditions."""

    def __init__(self, problem, options, cov_primary, code, cov_code):
        self.length_low, self.length_high = 0.0, np.inf
        self.box_centre, self.box_half = np.zeros(3), np.full(3, np.inf)
        self.axis, self.cosine = np.zeros(3), -2.0
        ellipsoids = []
        if problem.length_m > 0.0:
            tolerance = options.coarse_length_tolerance_m
            self.length_high = problem.length_m + tolerance
            if options.region == "shell":
                self.length_low = max(0.0, problem.length_m - tolerance)
        prior, cov_prior = problem.prior_baseline_enu_m, problem.cov_prior_m2
        if options.aid != "none" and prior is not None and cov_prior is not None:
            prior = np.asarray(prior, dtype=float)
            # What is compared with the prior is the primary baseline, noise and all.
            cov = cov_prior + cov_primary
            if options.aid == "ellipsoid":
                ellipsoids.append((prior, np.linalg.inv(options.aid_sigmas**2 * cov)))
            elif options.aid == "box":
                self.box_centre = prior
                self.box_half = options.aid_sigmas * np.sqrt(np.diag(cov))
                # The smallest ellipsoid of these axes around the box.
                ellipsoids.append((prior, np.diag(1.0 / (3.0 * self.box_half**2))))
            else:
                length = np.linalg.norm(prior)
                self.axis = prior / length
                across = np.eye(3) - np.outer(self.axis, self.axis)
                sd = np.sqrt(np.linalg.eigvalsh(across @ cov @ across)[-1]) / length
                self.cosine = float(np.cos(min(options.aid_sigmas * sd, np.pi)))
        if options.use_code and np.isfinite(code).all():
            ellipsoids.append((code, np.linalg.inv(options.code_sigmas**2 * (cov_code + cov_primary))))
        self.ellipsoids = ellipsoids

    def walk(self, primary_map, phase_m, wavelength_m):
        """Choose the smallest of the regions, as arguments of the kernel and its expected size."""
        lattice = primary_map * wavelength_m
        shapes = [(centre, np.linalg.cholesky(weight).T, 0.0) for centre, weight in self.ellipsoids]
        if np.isfinite(self.length_high):
            hole = (self.length_low / self.length_high) ** 2
            shapes.append((np.zeros(3), np.eye(3) / self.length_high, hole))
        best = None
        for k, (centre, half, hole) in enumerate(shapes):
            factor = np.linalg.qr(half @ lattice, mode="r")
            size = 4.0 / 3.0 * np.pi * (1.0 - hole**1.5) / abs(np.prod(np.diag(factor)))
            if best is None or size < best[0]:
                best = (size, k, centre, factor, hole)
        if best is None:
            return None
        size, k, centre, factor, hole = best
        centre_integers = (phase_m - np.linalg.solve(primary_map, centre)) / wavelength_m
        others = [e for j, e in enumerate(self.ellipsoids) if j != k]
        region_centre = np.array([c for c, _ in others]).reshape(-1, 3)
        region_weight = np.array([w for _, w in others]).reshape(-1, 3, 3)
        return (
            size,
            np.ascontiguousarray(factor) * (1.0 - _EDGE),
            np.ascontiguousarray(centre_integers),
            hole * (1.0 - _EDGE) ** 3,
            region_centre,
            region_weight,
        )


@dataclass(frozen=True, slots=True)
class _Search:
    """Outcome of one enumeration, candidates best first and rows in the caller's order."""

    reason: Reason
    integers: np.ndarray
    baseline: np.ndarray
    objective: np.ndarray
    counts: np.ndarray


def _enumerate(problem, options):
    """Search one epoch without memory."""
    from .._kernels.lsast import recursion_gains, rounding_order, search_primaries

    m = problem.n_phases
    nothing = _Search(
        Reason.TOO_FEW_SATELLITES,
        np.empty((0, m), dtype=np.int64),
        np.empty((0, 3)),
        np.empty(0),
        np.zeros(4, dtype=np.int64),
    )

    def refused(reason):
        return _Search(reason, nothing.integers, nothing.baseline, nothing.objective, nothing.counts)

    if m < 4:
        return nothing
    primaries, _ = select_primaries(problem, options.max_rpdop)
    if len(primaries) == 0:
        return refused(Reason.WEAK_GEOMETRY)
    cov_phase = np.asarray(problem.cov_phase_m2, dtype=float)
    rest = np.setdiff1d(np.arange(m), primaries)
    order = np.concatenate([primaries, rest])
    primary_map = np.ascontiguousarray(np.linalg.inv(problem.design[primaries]))
    cov_primary = primary_map @ cov_phase[np.ix_(primaries, primaries)] @ primary_map.T
    order = order[
        rounding_order(
            np.ascontiguousarray(problem.design[order], dtype=float),
            np.ascontiguousarray(np.diag(cov_phase)[order]),
            np.ascontiguousarray(problem.wavelength_m[order], dtype=float),
            np.ascontiguousarray(cov_primary),
        )
    ]
    phase = np.ascontiguousarray(problem.phase_m[order], dtype=float)
    design = np.ascontiguousarray(problem.design[order], dtype=float)
    wavelength = np.ascontiguousarray(problem.wavelength_m[order], dtype=float)
    try:
        lower = np.linalg.cholesky(cov_phase[np.ix_(order, order)])
    except np.linalg.LinAlgError as error:
        raise ModelError(
            "searching integers: the covariance of the double-difference phases is not positive definite; "
            "check the noise settings"
        ) from error
    code, cov_code = code_baseline(problem)
    walk = _Region(problem, options, cov_primary, code, cov_code)
    chosen = walk.walk(primary_map, phase[:3], wavelength[:3])
    if chosen is None:
        return refused(Reason.NO_CODE if options.use_code else Reason.SEARCH_VOLUME_TOO_LARGE)
    size, factor, centre_integers, hole, region_centre, region_weight = chosen
    if size > options.max_candidates:
        return refused(Reason.SEARCH_VOLUME_TOO_LARGE)

    whitened = np.ascontiguousarray(np.linalg.solve(lower, design))
    gain, variance, cov = recursion_gains(whitened, np.ascontiguousarray(cov_primary))
    fine_low, fine_high = 0.0, np.inf
    if problem.length_m > 0.0:
        # With a tolerance in sigmas the kernel uses the worst direction; the exact test follows.
        tolerance = _fine_tolerance(problem, options, np.sqrt(np.linalg.eigvalsh(cov)[-1]))
        fine_low, fine_high = problem.length_m - tolerance, problem.length_m + tolerance
    integers, baseline, objective, counts = search_primaries(
        phase,
        design,
        wavelength,
        np.ascontiguousarray(lower),
        whitened,
        gain,
        variance,
        primary_map,
        factor,
        centre_integers,
        float(hole),
        region_centre,
        region_weight,
        walk.box_centre,
        walk.box_half,
        walk.axis,
        float(walk.cosine),
        float(walk.length_low),
        float(walk.length_high),
        float(fine_low),
        float(fine_high),
        options.secondary_rounding == "primary",
        int(options.n_keep),
        # The expected size is an average over the lattice's position; small regions scatter about it.
        int(10 * options.max_candidates),
    )
    kept = int(counts[3])
    best_first = np.argsort(objective[:kept], kind="stable")
    unsorted = np.empty((kept, m), dtype=np.int64)
    unsorted[:, order] = integers[best_first]
    baseline, objective = baseline[best_first], objective[best_first]
    if problem.length_m > 0.0 and options.fine_length_tolerance_m is None:
        passed = _length_passes(problem, options, baseline, cov)
        unsorted, baseline, objective = unsorted[passed], baseline[passed], objective[passed]
    reason = Reason.OK if len(objective) else Reason.NO_CANDIDATE
    return _Search(reason, unsorted, baseline, objective, counts)


def _fine_tolerance(problem, options, measured_sd):
    """Limit on the length of the full solution, metres."""
    if options.fine_length_tolerance_m is not None:
        return options.fine_length_tolerance_m
    declared_sd = problem.length_sd_m if np.isfinite(problem.length_sd_m) else 0.0
    return options.length_tolerance_sd * np.hypot(measured_sd, declared_sd)


def _length_passes(problem, options, baseline, cov):
    """Fine length test of candidates, shape (c,) of bool."""
    length = np.linalg.norm(baseline, axis=1)
    direction = baseline / np.maximum(length, 1e-12)[:, None]
    sd = np.sqrt(np.einsum("ci,ij,cj->c", direction, cov, direction))
    return np.abs(length - problem.length_m) <= _fine_tolerance(problem, options, sd)


def primary_region_count(problem, options=None):
    """Number of primary integer triples that the coarse tests leave.

    Parameters
    ----------
    problem : DoubleDifferences
        One epoch.
    options : LsastOptions, optional
        Settings; the region is described by them.

    Returns
    -------
    int
        Candidates whose primary baseline lies in the region.
    """
    return int(_enumerate(problem, options or LsastOptions()).counts[1])


class LeastSquaresSearch:
    """The search with its memory: candidates and their residual sums, from epoch to epoch.

    Parameters
    ----------
    options : LsastOptions, optional
        Settings.
    """

    def __init__(self, options=None):
        self.options = options or LsastOptions()
        self.reset()

    def reset(self):
        """Forget all candidates."""
        self._integers = None
        self._sums = None
        self._epochs = 0
        self._leader = None
        self._led = 0
        self._has_won = False
        self._rows = None

    @property
    def n_epochs(self):
        """int: Epochs in the present sums."""
        return self._epochs

    def update(self, problem, row_key=None, reference_key=None):
        """Take one epoch.

        Parameters
        ----------
        problem : DoubleDifferences
            The epoch.
        row_key : ndarray of int, shape (m,), optional
            Identity of each row's satellite and signal. Without it, rows are taken to be those of
            the last epoch as long as their number, groups and wavelengths stay; else all starts anew.
        reference_key : ndarray of int, shape (m,), optional
            The same identity for the row's reference satellite; with it candidates survive a change
            of the reference.

        Returns
        -------
        Resolution
            Candidates best first by their sums; `Status.FIXED` when the best passes all tests.
        """
        survivors = self._carry(problem, row_key, reference_key)
        n_candidates = 0
        if survivors is not None:
            survivors = self._weigh(problem, survivors)
            n_candidates = 0 if survivors is None else len(survivors[0])
        if survivors is None:
            self.reset()
            found = _enumerate(problem, self.options)
            n_candidates = int(found.counts[1])
            if found.reason != Reason.OK:
                return unresolved(problem, found.reason, n_candidates)
            survivors = (found.integers, found.objective, found.baseline, found.objective)
        integers, sums, baseline, objective = survivors
        self._integers, self._sums = integers, sums
        self._epochs += 1
        self._rows = (row_key, reference_key, problem.group, problem.wavelength_m)
        return self._decide(problem, integers, sums, baseline, objective, n_candidates)

    def _carry(self, problem, row_key, reference_key):
        """Candidates of the last epoch on this epoch's rows, with their sums; None to start anew."""
        if self._integers is None or problem.n_phases < 3:
            return None
        old_key, old_reference, old_group, old_wavelength = self._rows
        if row_key is None or old_key is None:
            same = problem.n_phases == len(old_wavelength) and np.array_equal(
                problem.wavelength_m, old_wavelength
            )
            if same and problem.group is not None and old_group is not None:
                same = np.array_equal(problem.group, old_group)
            return (self._integers, self._sums) if same else None
        matrix, known = carry_matrix(old_key, old_reference, row_key, reference_key)
        if np.count_nonzero(known) < 3 or np.linalg.matrix_rank(problem.design[known], tol=1e-3) < 3:
            return None
        integers = np.rint(self._integers @ matrix.T).astype(np.int64)
        if not known.all():
            baseline = _adjust(problem, integers, known)[0]
            free = ~known
            predicted = baseline @ problem.design[free].T
            integers[:, free] = np.rint((problem.phase_m[free] - predicted) / problem.wavelength_m[free])
        # Sets that only differed in rows now gone are one set: the best sum stands for it.
        order = np.argsort(self._sums, kind="stable")
        integers, sums = integers[order], self._sums[order]
        _, first = np.unique(integers, axis=0, return_index=True)
        first.sort()
        if self._leader is not None:
            leader = np.rint(matrix @ self._leader).astype(np.int64)
            match = np.flatnonzero((integers[:, known] == leader[known]).all(axis=1))
            self._leader = integers[match[0]] if len(match) else None
        return integers[first], sums[first]

    def _weigh(self, problem, carried):
        """Add this epoch's residuals to the sums and drop what fails; None when nothing is left."""
        integers, sums = carried
        baseline, objective, cov = _adjust(problem, integers, np.ones(problem.n_phases, dtype=bool))
        keep = np.ones(len(sums), dtype=bool)
        if problem.length_m > 0.0:
            keep &= _length_passes(problem, self.options, baseline, cov)
        if not keep.any():
            return None
        integers, sums = integers[keep], sums[keep] + objective[keep]
        baseline, objective = baseline[keep], objective[keep]
        low, high = chi2_limits(
            problem.n_phases - 3, self.options.drop_significance, self.options.residual_tails
        )
        order = np.argsort(sums, kind="stable")
        passed = (objective[order] >= low) & (objective[order] <= high)
        if not passed.any():
            return None
        # The ratio needs a rival, so the two best stay whatever their residuals; a best set
        # that fails is told apart in the decision.
        passed[:2] = True
        order = order[passed]
        return integers[order], sums[order], baseline[order], objective[order]

    def _limits(self, problem):
        return chi2_limits(
            problem.n_phases - 3, self.options.residual_significance, self.options.residual_tails
        )

    def _decide(self, problem, integers, sums, baseline, objective, n_candidates):
        options = self.options
        low, high = self._limits(problem)
        leader = integers[0]
        if self._leader is not None and np.array_equal(leader, self._leader):
            self._led += 1
        else:
            self._led, self._has_won = 1, False
        self._leader = leader
        ratio = np.nan
        if len(sums) > 1:
            ratio = min(float(sums[1] / sums[0]) if sums[0] > 0.0 else np.inf, 999.9)
        passing = (objective >= low) & (objective <= high)
        alone = options.single_candidate == "accept" and np.count_nonzero(passing) == 1
        if not passing[0]:
            reason = Reason.RESIDUAL_TEST
        elif (self._has_won and problem.n_phases > 3) or alone:
            reason = Reason.OK
        elif len(sums) == 1:
            reason = Reason.SINGLE_CANDIDATE
        elif not ratio > options.ratio_threshold:
            reason = Reason.RATIO_TEST
        else:
            reason = Reason.OK
        if reason == Reason.OK and self._led < options.min_epochs:
            reason = Reason.NOT_PERSISTENT
        code, _ = code_baseline(problem)
        if reason == Reason.OK:
            status, self._has_won = Status.FIXED, True
        else:
            status = Status.FLOAT if np.isfinite(code).all() else Status.NONE
            if reason == Reason.RESIDUAL_TEST:
                self._has_won = False
        normal = problem.design.T @ np.linalg.solve(problem.cov_phase_m2, problem.design)
        return Resolution(
            status=status,
            reason=reason,
            integers_cyc=integers,
            objective=sums,
            baseline_enu_m=baseline,
            cov_baseline_m2=np.linalg.inv(normal),
            float_baseline_enu_m=code,
            is_fixed=np.ones(problem.n_phases, dtype=bool),
            ratio=ratio,
            success_probability=np.nan,
            chi2=float(objective[0]),
            chi2_limit=high,
            n_candidates=n_candidates,
        )


def _adjust(problem, integers, rows):
    """Least-squares baseline of each candidate over some rows, with residuals and covariance.

    Returns
    -------
    baseline : ndarray, shape (c, 3)
    objective : ndarray, shape (c,)
    cov : ndarray, shape (3, 3)
    """
    lower = np.linalg.cholesky(problem.cov_phase_m2[np.ix_(rows, rows)])
    design = np.linalg.solve(lower, problem.design[rows])
    free = problem.phase_m[rows] - problem.wavelength_m[rows] * integers[:, rows]
    free = np.linalg.solve(lower, free.T)
    cov = np.linalg.inv(design.T @ design)
    baseline = cov @ (design.T @ free)
    residual = free - design @ baseline
    return baseline.T, np.sum(residual**2, axis=0), cov


def resolve_lsast(problem, options=None):
    """Search one epoch by itself.

    Parameters
    ----------
    problem : DoubleDifferences
        The epoch.
    options : LsastOptions, optional
        Settings.

    Returns
    -------
    Resolution
        As `LeastSquaresSearch.update`.
    """
    return LeastSquaresSearch(options).update(problem)
