r"""Body coordinates of the antennas of an array from its own phases: the self-survey.

The shape of the array is adjusted from the vectors of all epochs (`truenorth.calibration.shape`), its frame
is fixed by a rule (`truenorth.calibration.body_frame`), and what comes out is compared with what was declared
(`truenorth.calibration.declared`).

The covariance is not that of white noise. Of the contributions u_k of the epochs, which the adjustment gives,
the variance of each coordinate is measured, and increased by their correlation in time, pooled over the
coordinates (`truenorth.calibration.correlation`): multipath of a minute makes a minute count as one epoch. An
error that stays alike through the whole run, such as that of a phase centre or of a ray that the platform
mirrors, shows in no residual; what is allowed for it is added, and said.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from ..attitude.array_vectors import ArrayVectors
from ..errors import ConfigError, NoSolutionError
from .body_frame import axes_rule, best_fit, fit_rule, s_transformation
from .correlation import correlation_of, markov_inflation
from .declared import DeclaredCheck, check_declared
from .shape import fit_shape, is_at_rest, shape_from_distances

__all__ = ["ArrayCalibration", "Distance", "calibrate_array"]

MIN_EPOCHS = 10
"""Fewer do not say how much they scatter."""

MAX_EPOCHS = 100_000
"""Of a longer run epochs are taken at even intervals; neighbours say much the same."""


@dataclass(frozen=True, slots=True)
class Distance:
    """Distance of two antennas.

    Parameters
    ----------
    first, second : str
        Their names.
    distance_m, sd_m : float
        Measured.
    declared_m : float
        NaN where nothing was declared.
    """

    first: str
    second: str
    distance_m: float
    sd_m: float
    declared_m: float

    @property
    def difference_m(self) -> float:
        """float: Measured less declared."""
        return self.distance_m - self.declared_m


@dataclass(frozen=True, slots=True, eq=False)
class ArrayCalibration:
    """Body coordinates of the antennas of an array, as measured.

    Parameters
    ----------
    names : tuple of str
        Of the antennas.
    positions_body_m : ndarray, shape (m, 3)
        Forward, right, down; metres.
    cov_body_m2 : ndarray, shape (3 m, 3 m)
        Their joint covariance under the rule; what the rule fixes has none.
    scatter_sd_m : ndarray, shape (m, 3)
        Standard deviations by the scatter of the run alone.
    common_sd_m : float
        What was added for errors that stay alike through the run, each coordinate.
    rule : str
        ``declared`` or ``axes``, see `calibrate_array`.
    rule_text : str
        The rule in a sentence.
    is_static : bool
        Whether the platform was at rest.
    is_line : bool
        Whether the antennas stand on one line, so that only distances along it are known.
    n_epochs, n_used : int
        Epochs with vectors, and those that took part.
    span_s : float
        From the first to the last of them.
    variance_factor : float
        Square sum of the residuals over its degrees of freedom: 1 where the vectors are as good as stated.
    correlation_s : float
        Time in which epochs become independent; 0 where neighbours are.
    effective_epochs : float
        Number of independent epochs that say as much.
    distances : tuple of Distance
        Between all antennas.
    declared : DeclaredCheck or None
        Comparison with declared coordinates.
    time_ns : ndarray of int64, shape (n,)
        Epochs.
    rot_ned_from_body : ndarray, shape (n, 3, 3)
        Attitude of the calibrated frame; NaN where there was none.
    is_used : ndarray of bool, shape (n,)
        Epochs that took part.
    warnings : tuple of str
        Said once each.
    """

    names: tuple[str, ...]
    positions_body_m: np.ndarray
    cov_body_m2: np.ndarray
    scatter_sd_m: np.ndarray
    common_sd_m: float
    rule: str
    rule_text: str
    is_static: bool
    is_line: bool
    n_epochs: int
    n_used: int
    span_s: float
    variance_factor: float
    correlation_s: float
    effective_epochs: float
    distances: tuple[Distance, ...]
    declared: DeclaredCheck | None
    time_ns: np.ndarray
    rot_ned_from_body: np.ndarray
    is_used: np.ndarray
    warnings: tuple[str, ...] = field(default=())

    @property
    def sd_body_m(self) -> np.ndarray:
        """Ndarray, shape (m, 3): standard deviations of the coordinates."""
        return np.sqrt(np.maximum(np.diag(self.cov_body_m2), 0.0)).reshape(-1, 3)

    def to_dict(self) -> dict:
        """Plain values for JSON; metres."""
        return {
            "antennas": list(self.names),
            "positions_body_m": self.positions_body_m.tolist(),
            "sd_body_m": self.sd_body_m.tolist(),
            "cov_body_m2": self.cov_body_m2.tolist(),
            "scatter_sd_m": self.scatter_sd_m.tolist(),
            "common_sd_m": self.common_sd_m,
            "rule": self.rule,
            "rule_text": self.rule_text,
            "at_rest": self.is_static,
            "on_one_line": self.is_line,
            "epochs": self.n_epochs,
            "epochs_used": self.n_used,
            "span_s": self.span_s,
            "variance_factor": self.variance_factor,
            "correlation_s": self.correlation_s,
            "effective_epochs": self.effective_epochs,
            "distances": [
                {
                    "antennas": [pair.first, pair.second],
                    "distance_m": pair.distance_m,
                    "sd_m": pair.sd_m,
                    "declared_m": None if np.isnan(pair.declared_m) else pair.declared_m,
                }
                for pair in self.distances
            ],
            "declared": None if self.declared is None else self.declared.to_dict(),
            "warnings": list(self.warnings),
        }


def calibrate_array(
    vectors: ArrayVectors,
    *,
    declared_m=None,
    declared_sd_m: float = 0.003,
    moving: bool | Literal["auto"] = "auto",
    rule: Literal["auto", "declared", "axes"] = "auto",
    axes: tuple[int, ...] | None = None,
    correlation_s: float | None = None,
    common_sd_m: float = 0.001,
    significance: float = 1e-3,
) -> ArrayCalibration:
    """Measure the body coordinates of the antennas of a rigid array with its own phases.

    Parameters
    ----------
    vectors : ArrayVectors
        Between the antennas, as the phases alone give them: the integers must not rest on the coordinates
        that are to be found. Epochs may be missing antennas, and may be wrong; antennas that no epoch has
        are left out.
    declared_m : array_like, shape (m, 3), optional
        Declared body coordinates that are to be tested. They do not enter the measured shape.
    declared_sd_m : float
        Standard deviation of each.
    moving : bool or str
        Whether every epoch has an attitude of its own; ``"auto"`` looks.
    rule : str
        What the frame is. ``"declared"``: the one in which the antennas come nearest to their declared
        coordinates, those left out that contradict them. ``"axes"``: the first of `axes` is the origin, the
        second stands forward of it, the third at its height, and down is down. ``"auto"``: the first where
        coordinates are declared.
    axes : tuple of int, optional
        Three antennas for ``"axes"``; the first three, by default.
    correlation_s : float, optional
        Time in which errors fall to 1/e, at least; what the run shows is used where it is longer.
    common_sd_m : float
        Standard deviation of what stays alike through the whole run, each coordinate of each antenna: phase
        centres, and rays that the platform itself mirrors. It is added to what the scatter shows.
    significance : float
        False-alarm rate of the tests of the declared coordinates: of all together, and of single antennas.

    Returns
    -------
    ArrayCalibration

    Raises
    ------
    ConfigError
        If an option is impossible.
    NoSolutionError
        If the vectors do not determine the coordinates.

    Notes
    -----
    Two antennas, and antennas on one line while moving, give distances along the line only; at rest the
    coordinates beside the line are found, but for the turn about it.
    """
    m = len(vectors.positions_body_m)
    names = vectors.names or tuple(f"antenna {k}" for k in range(m))
    if rule == "auto":
        rule = "axes" if declared_m is None else "declared"
    options = {
        "declared_sd_m": declared_sd_m,
        "correlation_s": correlation_s or 0.0,
        "common_sd_m": common_sd_m,
    }
    _check_options(rule, declared_m, options, axes, significance, m)
    n_epochs = int(np.count_nonzero(vectors.is_present.any(1)))
    if n_epochs < MIN_EPOCHS:
        raise NoSolutionError(
            f"could not calibrate the array: {n_epochs} epochs have vectors between its antennas, "
            f"{MIN_EPOCHS} are needed"
        )
    warnings = []
    seen = vectors.is_present.any(0)
    seen[np.unique(vectors.reference[vectors.reference >= 0])] = True
    if not seen.all():
        unseen = [name for name, is_seen in zip(names, seen, strict=True) if not is_seen]
        if axes is not None and not all(seen[k] for k in axes):
            raise ConfigError(
                f"`axes` names antennas without any vector, of {', '.join(unseen)}; give others", key="axes"
            )
        warnings.append(f"{', '.join(unseen)} left out: no epoch has a vector there")
        vectors = _without(vectors, seen)
        names = tuple(name for name, is_seen in zip(names, seen, strict=True) if is_seen)
        declared_m = None if declared_m is None else np.asarray(declared_m)[seen]
        axes = None if axes is None else tuple(int(np.count_nonzero(seen[:k])) for k in axes)
        m = len(names)
    vectors = _thinned(vectors)
    start_m = shape_from_distances(vectors)
    is_static = moving is False
    fit = fit_shape(vectors, start_m, is_static=is_static)
    if moving == "auto" and is_at_rest(fit, vectors):
        is_static = True
        fit = fit_shape(vectors, start_m, is_static=True)

    # Contributions of the epochs to the coordinates in the frame of the adjustment.
    inverse = fit.free @ _pinv(fit.free.T @ fit.normal @ fit.free) @ fit.free.T
    influence = fit.score[fit.is_used] @ inverse
    time_ns = vectors.time_ns[fit.is_used]
    correlation = correlation_of(influence, time_ns)
    inflation = max(correlation.inflation, markov_inflation(time_ns, correlation_s or 0.0))
    effective = len(time_ns) / inflation
    # A variance measured from few independent epochs is itself uncertain: that of Student's distribution.
    freedom = max(effective - 1.0, 3.0)
    inflation *= freedom / (freedom - 2.0)
    if not correlation.is_resolved and inflation > 1.5:
        warnings.append(
            "errors of the vectors stay alike for much of the run: standard deviations are rough; "
            "observe longer"
        )

    check = None
    if rule == "declared":
        declared_m = np.asarray(declared_m, dtype=float)
        rot, shift = best_fit(fit.positions_m, declared_m)
        if not fit.is_line:
            found, turned = _moved(fit.positions_m, inverse, influence, rot, shift, inflation)
            turned = turned + common_sd_m**2 * np.eye(3 * m)
            check = check_declared(found, turned, declared_m, declared_sd_m, names, significance=significance)
            weight = np.where(check.is_wrong, 0.0, 1.0)
            rot, shift = best_fit(fit.positions_m, declared_m, weight)
        else:
            weight = np.ones(m)
        constraint = fit_rule(fit.positions_m @ rot.T + shift, weight)
        good = [name for name, w in zip(names, weight, strict=True) if w > 0.0]
        rule_text = "best fit to the declared coordinates of " + ", ".join(good)
    else:
        chosen = axes or tuple(range(min(m, 3)))
        chosen = tuple(chosen[:2]) if fit.is_line else tuple(chosen)
        down_body = _down(fit)
        rot, shift, constraint = axes_rule(fit.positions_m, chosen, down_body=down_body)
        rule_text = f"{names[chosen[0]]} is the origin, {names[chosen[1]]} is forward of it"
        if len(chosen) > 2:
            rule_text += f", {names[chosen[2]]} is at their height"
    positions_m, cov_m2 = _moved(
        fit.positions_m, inverse, influence, rot, shift, inflation, constraint=constraint
    )
    seen = fit.free @ fit.free.T if fit.is_line else np.eye(3 * m)
    change = s_transformation(positions_m, constraint) @ np.kron(np.eye(m), rot)
    common = common_sd_m**2 * change @ seen @ change.T
    scatter_sd_m = np.sqrt(np.maximum(np.diag(cov_m2), 0.0)).reshape(-1, 3)
    cov_m2 = cov_m2 + common
    if check is not None:
        check = check.in_frame(positions_m, cov_m2)
    elif rule == "declared" and fit.is_line:
        warnings.append(
            "the antennas stand on one line: only distances along it are compared with the declared ones"
        )
    declared_distances = declared_m if declared_m is not None else np.full((m, 3), np.nan)
    used = fit.misfit[fit.is_used].sum()
    freedom = fit.degrees[fit.is_used].sum()
    span_s = float(time_ns[-1] - time_ns[0]) * 1e-9
    return ArrayCalibration(
        names=tuple(names),
        positions_body_m=positions_m,
        cov_body_m2=cov_m2,
        scatter_sd_m=scatter_sd_m,
        common_sd_m=common_sd_m,
        rule=rule,
        rule_text=rule_text,
        is_static=is_static,
        is_line=fit.is_line,
        n_epochs=n_epochs,
        n_used=int(np.count_nonzero(fit.is_used)),
        span_s=span_s,
        variance_factor=float(used / freedom) if freedom else np.nan,
        correlation_s=correlation.time_s,
        effective_epochs=float(effective),
        distances=_distances(names, positions_m, cov_m2, np.asarray(declared_distances, dtype=float)),
        declared=check,
        time_ns=vectors.time_ns,
        rot_ned_from_body=fit.rot_ned_from_body @ rot.T,
        is_used=fit.is_used,
        warnings=tuple(warnings),
    )


def _check_options(rule, declared_m, options, axes, significance, m):
    def refuse(key, value, wanted):
        raise ConfigError(f"`{key}` is {value!r}; give {wanted}", key=key, value=value)

    if rule not in ("declared", "axes"):
        refuse("rule", rule, "auto, declared or axes")
    if rule == "declared" and declared_m is None:
        refuse("rule", rule, "`declared_m` with it, or the rule axes")
    if declared_m is not None and np.shape(declared_m) != (m, 3):
        refuse("declared_m", np.shape(declared_m), f"three coordinates for each of {m} antennas")
    for key, value in options.items():
        if not value >= 0.0:
            refuse(key, value, "0 or more")
    if axes is not None and (
        len(set(axes)) != len(axes) or len(axes) not in (2, 3) or not set(axes) <= set(range(m))
    ):
        refuse("axes", axes, f"three different antennas among 0 to {m - 1}")
    if not 0.0 < significance < 1.0:
        refuse("significance", significance, "a share between 0 and 1")


def _without(vectors, seen):
    """Vectors of the antennas that are seen."""
    at = np.flatnonzero(np.repeat(seen, 3))
    place = np.cumsum(seen) - 1
    return ArrayVectors(
        vectors.time_ns,
        np.where(vectors.reference >= 0, place[vectors.reference], -1),
        vectors.vector_ned_m[:, seen],
        vectors.cov_ned_m2[:, at[:, None], at],
        vectors.positions_body_m[seen],
        vectors.body_cov_m2[at[:, None], at],
        tuple(name for name, is_seen in zip(vectors.names, seen, strict=False) if is_seen),
    )


def _thinned(vectors):
    """At most `MAX_EPOCHS` epochs, at even intervals."""
    every = -(-vectors.n_epochs // MAX_EPOCHS)
    if every == 1:
        return vectors
    return ArrayVectors(
        vectors.time_ns[::every],
        vectors.reference[::every],
        vectors.vector_ned_m[::every],
        vectors.cov_ned_m2[::every],
        vectors.positions_body_m,
        vectors.body_cov_m2,
        vectors.names,
    )


def _moved(positions_m, inverse, influence, rot, shift, inflation, *, constraint=None):
    """Coordinates and covariance in another frame, under another rule."""
    moved_m = positions_m @ rot.T + shift
    turn = np.kron(np.eye(len(positions_m)), rot)
    if constraint is not None:
        turn = s_transformation(moved_m, constraint) @ turn
    formal = turn @ inverse @ turn.T
    measured = np.sum((influence @ turn.T) ** 2, axis=0)
    variance = np.diag(formal)
    known = variance > 1e-12 * max(variance.max(), 1e-30)
    stretch = np.where(known, np.sqrt(inflation * measured / np.where(known, variance, 1.0)), 0.0)
    return moved_m, stretch[:, None] * formal * stretch


def _pinv(normal):
    return np.linalg.pinv(0.5 * (normal + normal.T), rcond=1e-9, hermitian=True)


def _down(fit):
    """Which way is down in the frame of the adjustment, on average; the normal of a flat array for a tilt."""
    down = np.nanmean(fit.rot_ned_from_body[fit.is_used][:, 2, :], axis=0)
    return down if np.linalg.norm(down) > 0.1 else None


def _distances(names, positions_m, cov_m2, declared_m):
    found = []
    for i in range(len(names)):
        for j in range(i + 1, len(names)):
            apart = positions_m[j] - positions_m[i]
            length = float(np.linalg.norm(apart))
            gradient = np.zeros(len(cov_m2))
            gradient[3 * j : 3 * j + 3] = apart / length
            gradient[3 * i : 3 * i + 3] = -apart / length
            sd = float(np.sqrt(max(gradient @ cov_m2 @ gradient, 0.0)))
            declared = float(np.linalg.norm(declared_m[j] - declared_m[i]))
            found.append(Distance(names[i], names[j], length, sd, declared))
    return tuple(found)
