r"""Allan deviation of an inertial log, turned into the errors that an estimator and a budget need.

Of each gyro and accelerometer the overlapping Allan variance at averaging times :math:`\tau` of octaves is
described as a sum of noises (IEEE Std 952-1997, annex C; `truenorth.sensors.processes`),

.. math:: \sigma^2(\tau) = \frac{3Q^2}{\tau^2} + \frac{N^2}{\tau} + B^2 b(\tau) + \frac{K^2\tau}{3}
    + \frac{R^2\tau^2}{2},

quantisation Q, angle or velocity random walk N, bias instability B (the floor itself; :math:`b` is 1 but for
the shortest times), rate random walk K and drift R. The squares of the coefficients come from non-negative
least squares of the relative misfit, weighted with the covariance of the variances: their equivalent degrees
of freedom after Greenhall and Riley (2003), their correlation from the spectrum of the fitted model,
:math:`\mathrm{cov}_{ij} = T^{-1}\int S^2 |H_i|^2 |H_j|^2 df`. A coefficient is a number only where the record
determines it; otherwise it has an upper bound of 95 %.

A sum of such noises is convex on logarithmic axes. Where a curve is not, or does not fit at all, the record
holds something else: the platform moved. Motion only adds to the variance, so that bounds from below the
curve still hold:  each noise alone must not exceed it anywhere. Of axes across gravity a better one follows.
Rotation of the platform shows in the gyros and, as a turn of gravity, in the accelerometers; the difference
of the two holds no rotation, and averaged over long times no shaking either. Its modified Allan variance
bounds the noise of the gyros (white noise enters it halved, flicker with 0.675, a walk with 0.55), its
Hadamard variance, as an acceleration, that of the accelerometers (1, 0.811 and 0.5).

References
----------
IEEE Std 952-1997, IEEE standard specification format guide and test procedure for single-axis interferometric
fiber optic gyros, annex C.
W. J. Riley, Handbook of frequency stability analysis, NIST Special Publication 1065 (2008).
C. A. Greenhall and W. J. Riley, "Uncertainty of stability variances based on finite differences", Proc. 35th
Precise Time and Time Interval Meeting (2003).
S. Guerrier, J. Skaloud, Y. Stebler, M.-P. Victoria-Feser, "Wavelet-variance-based estimation for composite
stochastic processes", J. American Statistical Association 108 (2013) 1021-1030 (the weighting).
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from ..constants import DPH_RADPS, STANDARD_GRAVITY_MPS2, UG_MPS2
from ..errors import ConfigError, NoSolutionError
from ..strapdown import InertialIncrements
from .allan_fit import (
    TERMS,
    TOLERANCE,
    Curve,
    Kind,
    NoiseFit,
    ceiling_of,
    edf_of_curve,
    fit_noises,
    noise_basis,
)
from .allan_motion import Levelled, find_hump, level_axes
from .error_file import errors_toml, write_errors
from .imu import GRADES, ImuDescription

__all__ = ["AllanAxis", "AllanResult", "NoiseTerm", "analyse_allan"]

AXES = ("x", "y", "z")

PER_OCTAVE = 3
"""Averaging times of the curve; those of the fit are octaves."""

LEAST_SAMPLES = 256

MISFIT = 1e-4
"""Probability below which a curve is not the sum of noises that was fitted to it."""


_UNITS: dict[str, dict[str, tuple[str, str, float]]] = {
    "gyro": {
        "quantisation": ("arcsec", "arcsec", DPH_RADPS),
        "random_walk": ("deg_per_sqrt_h", "deg/sqrt(h)", np.pi / 180.0 / 60.0),
        "bias_instability": ("dph", "deg/h", DPH_RADPS),
        "bias_walk": ("dph_per_sqrt_h", "deg/h/sqrt(h)", DPH_RADPS / 60.0),
        "drift": ("dph_per_h", "deg/h/h", DPH_RADPS / 3600.0),
    },
    "accelerometer": {
        "quantisation": ("ug_s", "ug s", UG_MPS2),
        "random_walk": ("mps_per_sqrt_h", "m/s/sqrt(h)", 1.0 / 60.0),
        "bias_instability": ("ug", "ug", UG_MPS2),
        "bias_walk": ("ug_per_sqrt_h", "ug/sqrt(h)", UG_MPS2 / 60.0),
        "drift": ("ug_per_h", "ug/h", UG_MPS2 / 3600.0),
    },
}
"""End of a name, unit, and what one of it is in SI units."""


@dataclass(frozen=True, slots=True)
class NoiseTerm:
    """One coefficient of one curve.

    Parameters
    ----------
    name : str
        ``quantisation``, ``random_walk``, ``bias_instability``, ``bias_walk`` or ``drift``.
    value : float
        In `unit`; NaN where the record does not determine it.
    sd : float
        Its standard deviation; NaN likewise.
    bound : float
        With 95 % it is not more.
    unit : str
        As people write it.
    suffix : str
        As names end in it.
    unit_si : float
        What one unit is in SI units.
    """

    name: str
    value: float
    sd: float
    bound: float
    unit: str
    suffix: str
    unit_si: float

    @property
    def is_determined(self) -> bool:
        """bool: Whether it is a number, not only a bound."""
        return bool(np.isfinite(self.value))

    def deviation(self, tau_s: np.ndarray) -> np.ndarray:
        """Allan deviation of this noise alone, of its bound where it is not determined, in SI units."""
        size = self.value if self.is_determined else self.bound
        curve: np.ndarray = np.sqrt(noise_basis(tau_s)[:, TERMS.index(self.name)])
        return size * self.unit_si * curve

    def __str__(self) -> str:
        if not self.is_determined:
            return f"< {float(f'{self.bound:.2g}'):g}"
        # Two digits of sigma, one where there are digits enough.
        digits = 1 if self.sd > 0.01 * self.value else 0
        decimals = max(0, digits - int(np.floor(np.log10(self.sd))))
        return f"{self.value:.{decimals}f} +- {self.sd:.{decimals}f}"


@dataclass(frozen=True, slots=True, eq=False)
class AllanAxis:
    """Allan deviation of one sensor, or of three alike, and what it says.

    Parameters
    ----------
    name : str
        E.g. ``gyro x``, or ``gyros`` of three together.
    kind : {"gyro", "accelerometer"}
        What it is.
    tau_s : ndarray, shape (k,)
        Averaging times.
    deviation : ndarray, shape (k,)
        Overlapping Allan deviation, rad/s or m/s^2.
    edf : ndarray, shape (k,)
        Equivalent degrees of freedom of its square.
    fitted : ndarray, shape (k,)
        Deviation of the fitted noises; NaN where none fit.
    terms : mapping of str to NoiseTerm
        The coefficients.
    affected : ndarray of bool, shape (k,)
        Where the curve holds more than noise.
    disturbance : str or None
        What is wrong, as the end of a sentence.
    probability : float
        Of a misfit at least as large as the one found, were the model true; NaN where none was fitted.
    levelled_tau_s, levelled_deviation : ndarray, shape (j,), or None
        Of an axis across gravity in a record with motion: the deviation without rotation of the platform,
        modified Allan of a gyro, Hadamard of an accelerometer.
    """

    name: str
    kind: Kind
    tau_s: np.ndarray
    deviation: np.ndarray
    edf: np.ndarray
    fitted: np.ndarray
    terms: Mapping[str, NoiseTerm]
    affected: np.ndarray
    disturbance: str | None = None
    probability: float = np.nan
    levelled_tau_s: np.ndarray | None = None
    levelled_deviation: np.ndarray | None = None

    def interval(self, confidence: float = 0.683) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper end of the deviation, by chi-square, shape (k,) each."""
        from scipy.stats import chi2

        tail = 0.5 * (1.0 - confidence)
        variance = self.deviation**2 * self.edf
        return (
            np.sqrt(variance / chi2.ppf(1.0 - tail, self.edf)),
            np.sqrt(variance / chi2.ppf(tail, self.edf)),
        )


@dataclass(frozen=True, slots=True, eq=False)
class AllanResult:
    """What a log of an inertial unit at rest says of its noise.

    Parameters
    ----------
    axes : tuple of AllanAxis
        Gyros x, y, z and accelerometers x, y, z.
    gyro, accelerometer : AllanAxis
        Three together, taken as alike.
    interval_s : float
        Between samples.
    duration_s : float
        Length of the record.
    notes : tuple of str
        Whole sentences a user should read.
    """

    axes: tuple[AllanAxis, ...]
    gyro: AllanAxis
    accelerometer: AllanAxis
    interval_s: float
    duration_s: float
    notes: tuple[str, ...] = ()

    def describe(self, base_grade: str = "tactical") -> ImuDescription:
        """Errors of the unit for an estimator or a budget.

        Parameters
        ----------
        base_grade : str
            Gives all that no record at rest can show: turn-on bias, scale, misalignment, range.

        Returns
        -------
        ImuDescription
            A noise that the record determines has its value. One that it only bounds keeps the value of the
            grade if that is within the bound, and has the bound if not.

        Raises
        ------
        ConfigError
            If there is no such grade.
        """
        if base_grade not in GRADES:
            raise ConfigError(
                f"no grade of sensor is called {base_grade!r}; give {', '.join(GRADES)}",
                key="grade",
                value=base_grade,
            )
        plain = ImuDescription(grade=base_grade, rate_hz=_rounded(1.0 / self.interval_s, 9))  # type: ignore[arg-type]
        changes: dict[str, Any] = {
            field: _stated(term, getattr(plain, field))
            for field, term in self._fields()
            if field in plain.__struct_fields__
        }
        for axis, field, factor in (
            (self.gyro, "gyro_resolution_dps", 1.0 / 3600.0),
            (self.accelerometer, "accel_resolution_ug", 1.0),
        ):
            # A counter of step q leaves q / sqrt(12); the description has the step as a rate.
            step = axis.terms["quantisation"].value * np.sqrt(12.0) * factor / self.interval_s
            if np.isfinite(step):
                changes[field] = _rounded(step)
                changes["output"] = "increments"
        return msgspec.structs.replace(plain, **changes)

    def comments(self, base_grade: str = "tactical") -> list[str]:
        """Lines that say of each setting of `describe` where it comes from."""
        lines = [f"Noise from {self.duration_s:.0f} s at rest at {1.0 / self.interval_s:g} Hz."]
        plain = ImuDescription(grade=base_grade)  # type: ignore[arg-type]
        for field, term in self._fields():
            if field not in plain.__struct_fields__:
                continue
            of_grade = getattr(plain, field)
            if term.is_determined:
                lines.append(f"{field}: measured, {term} {term.unit}.")
            elif of_grade <= term.bound:
                lines.append(
                    f"{field}: the record only bounds it ({term} {term.unit}); of grade {base_grade}."
                )
            else:
                lines.append(f"{field}: the record only bounds it; the bound is taken.")
        lines.append(
            f"Turn-on bias, scale, misalignment, g-sensitivity and range do not show in such a record: they "
            f"are those of grade {base_grade}. Replace them by what is known of this unit."
        )
        return lines

    def to_toml(self, base_grade: str = "tactical") -> str:
        """Text of a file for `read_errors`, with remarks on what comes from where."""
        return errors_toml(self.describe(base_grade), self.comments(base_grade))

    def write(self, path: str | os.PathLike[str], base_grade: str = "tactical") -> Path:
        """Write the file for `read_errors`; see `to_toml`."""
        return write_errors(self.describe(base_grade), path, self.comments(base_grade))

    def columns(self) -> dict[str, np.ndarray]:
        """Curves as a table.

        Returns
        -------
        dict of str to ndarray
            ``tau_s``, and of each axis ``gyro_x_dph``, ``gyro_x_low_dph``, ``gyro_x_high_dph`` (one sigma),
            ``gyro_x_fit_dph``; of the accelerometers in ug.
        """
        columns = {"tau_s": self.gyro.tau_s}
        for axis in (*self.axes, self.gyro, self.accelerometer):
            unit, factor = ("dph", DPH_RADPS) if axis.kind == "gyro" else ("ug", UG_MPS2)
            name = axis.name.replace(" ", "_")
            low, high = axis.interval()
            columns |= {
                f"{name}_{unit}": axis.deviation / factor,
                f"{name}_low_{unit}": low / factor,
                f"{name}_high_{unit}": high / factor,
                f"{name}_fit_{unit}": axis.fitted / factor,
            }
        return columns

    def to_dict(self) -> dict[str, Any]:
        """Coefficients as plain values; None for what is not determined."""
        told: dict[str, Any] = {"duration_s": self.duration_s, "interval_s": self.interval_s}
        for axis in (*self.axes, self.gyro, self.accelerometer):
            entry: dict[str, Any] = {
                "disturbance": axis.disturbance,
                "fit_probability": axis.probability if np.isfinite(axis.probability) else None,
            }
            for term in axis.terms.values():
                value, sd = (x if term.is_determined else None for x in (term.value, term.sd))
                bound = term.bound if np.isfinite(term.bound) else None
                entry[f"{term.name}_{term.suffix}"] = {"value": value, "sd": sd, "bound": bound}
            told[axis.name.replace(" ", "_")] = entry
        return {**told, "notes": list(self.notes)}

    def __str__(self) -> str:
        """One table of gyros and one of accelerometers."""
        lines = []
        for kind, together in (("gyro", self.gyro), ("accelerometer", self.accelerometer)):
            columns = [*(axis for axis in self.axes if axis.kind == kind), together]
            lines.append(f"{kind + 's':<34}" + "".join(f"{word:>22}" for word in (*AXES, "together")))
            for name, label in _LABELS.items():
                cells = "".join(f"{axis.terms[name]!s:>22}" for axis in columns)
                lines.append(f"  {f'{label}, {together.terms[name].unit}':<32}{cells}")
            if any(np.any(axis.affected) for axis in columns):
                cells = "".join(f"{_span(axis):>22}" for axis in columns)
                lines.append(f"  {'more than noise at, s':<32}{cells}")
        return "\n".join(lines)

    def _fields(self) -> list[tuple[str, NoiseTerm]]:
        """Setting of an `ImuDescription` and the coefficient that it holds, where there is one."""
        pairs = []
        for start, axis in (("gyro", self.gyro), ("accel", self.accelerometer)):
            pairs += [(f"{start}_{term.name}_{term.suffix}", term) for term in axis.terms.values()]
        return pairs


_LABELS = {
    "quantisation": "quantisation",
    "random_walk": "random walk",
    "bias_instability": "bias instability",
    "bias_walk": "walk of the bias",
    "drift": "drift",
}


def analyse_allan(increments: InertialIncrements) -> AllanResult:
    """Noise of an inertial unit from a record at rest.

    Parameters
    ----------
    increments : InertialIncrements
        Equal intervals, in body axes; the unit stands, though its platform may sway.

    Returns
    -------
    AllanResult
        Curves and coefficients of each axis, and of three together.

    Raises
    ------
    NoSolutionError
        If the record is too short, its intervals are not equal, an axis never changes, or the unit was turned
        or feels no gravity.
    """
    interval_s = _check(increments)
    n = len(increments.angle_rad)
    factor = 2.0 ** (np.arange(0, PER_OCTAVE * np.log2(n / 3.0) + 1e-9) / PER_OCTAVE)
    samples = np.unique(np.rint(factor).astype(int))
    curves = [
        Curve.of(f"{kind} {axis}", kind, values[:, k], interval_s, samples)
        for kind, values in _sensors(increments)
        for k, axis in enumerate(AXES)
    ]
    levelled = level_axes(increments, interval_s)
    axes = tuple(
        _analyse(curve, levelled.get(("gyro" if k < 3 else "accelerometer", k % 3)))
        for k, curve in enumerate(curves)
    )
    gyro = _together("gyros", axes[:3], curves[:3])
    accelerometer = _together("accelerometers", axes[3:], curves[3:])
    return AllanResult(
        axes,
        gyro,
        accelerometer,
        interval_s,
        n * interval_s,
        _notes(axes, gyro, accelerometer, bool(levelled), n * interval_s),
    )


def _span(axis: AllanAxis) -> str:
    """Averaging times that hold more than noise."""
    if not np.any(axis.affected):
        return "-"
    first, last = axis.tau_s[axis.affected][[0, -1]]
    return f"{first:.2g} to {last:.2g}" if last < 100.0 else f"{first:.2g} to {last:.0f}"


def _term(kind: str, k: int, value: float, sd: float, bound: float) -> NoiseTerm:
    """A coefficient in the unit that people use, from its SI values."""
    suffix, unit, factor = _UNITS[kind][TERMS[k]]
    return NoiseTerm(TERMS[k], value / factor, sd / factor, bound / factor, unit, suffix, factor)


def _fitted_terms(kind: str, fit: NoiseFit) -> dict[str, NoiseTerm]:
    """Values where the fit found a noise, bounds elsewhere."""
    terms = {}
    for k, name in enumerate(TERMS):
        bound = float(np.sqrt(fit.bound[k]))
        value = sd = np.nan
        if fit.squares[k] > 0.0:
            value = float(np.sqrt(fit.squares[k]))
            sd = float(fit.sd[k] / (2.0 * value))
        terms[name] = _term(kind, k, value, sd, bound)
    return terms


def _analyse(curve: Curve, levelled: Levelled | None) -> AllanAxis:
    """One axis: its noises, or where the record holds more than noise, their bounds."""
    tau_s = curve.tau_s
    every = np.arange(len(tau_s))
    # Of all noises a walk leaves the fewest degrees of freedom.
    edf = edf_of_curve(curve, every, np.array([0.0, 0.0, 0.0, 1.0, 0.0]))
    affected, disturbance = find_hump(tau_s, curve.variance, edf)
    if levelled is not None:
        affected = affected | (tau_s >= levelled.first_s)
        felt = "accelerometers" if curve.kind == "gyro" else "gyros"
        text = f"from {levelled.first_s:.2g} s on the {felt} feel most of it as well, so the platform turned"
        disturbance = f"{disturbance}; {text}" if disturbance else text
    fitted, probability = np.full(len(tau_s), np.nan), np.nan
    if disturbance is None:
        fit = fit_noises(curve, 0.0)
        if fit.probability < MISFIT:
            fit = fit_noises(curve, TOLERANCE)
        probability = fit.probability
        fitted = np.sqrt(noise_basis(tau_s) @ fit.squares)
        if probability < MISFIT:
            affected = curve.variance > (1.0 + 2.0 * TOLERANCE) * fitted**2
            disturbance = "no sum of the five noises fits the curve"
    if disturbance is None:
        edf = edf_of_curve(curve, every, fit.squares)
        terms = _fitted_terms(curve.kind, fit)
    else:
        squares = np.min(ceiling_of(curve.variance, edf)[:, None] / noise_basis(tau_s), axis=0)
        if levelled is not None:
            squares = np.fmin(squares, levelled.squares)
        terms = {
            name: _term(curve.kind, k, np.nan, np.nan, float(np.sqrt(squares[k])))
            for k, name in enumerate(TERMS)
        }
        fitted = np.full(len(tau_s), np.nan)
    return AllanAxis(
        name=curve.name,
        kind=curve.kind,
        tau_s=tau_s,
        deviation=np.sqrt(curve.variance),
        edf=edf,
        fitted=fitted,
        terms=terms,
        affected=affected,
        disturbance=disturbance,
        probability=probability,
        levelled_tau_s=None if levelled is None else levelled.tau_s,
        levelled_deviation=None if levelled is None else levelled.deviation,
    )


def _together(name: str, axes: tuple[AllanAxis, ...], curves: list[Curve]) -> AllanAxis:
    """Three sensors taken as alike: the undisturbed ones averaged, or the middle one of their bounds."""
    clean = [k for k, axis in enumerate(axes) if axis.disturbance is None]
    of = clean or list(range(len(axes)))
    curve = Curve(
        name,
        curves[0].kind,
        np.mean([curves[k].variance for k in of], axis=0),
        curves[0].samples,
        curves[0].interval_s,
        curves[0].n,
        float(len(of)),
    )
    if clean:
        fit = fit_noises(curve, 0.0)
        if fit.probability < MISFIT:
            # The axes differ, or each misses the laws a little.
            fit = fit_noises(curve, TOLERANCE)
        terms = _fitted_terms(curve.kind, fit)
        fitted = np.sqrt(noise_basis(curve.tau_s) @ fit.squares)
        probability, disturbance = fit.probability, None
        edf = edf_of_curve(curve, np.arange(len(curve.tau_s)), fit.squares)
    else:
        terms = {
            term: _term(
                curve.kind,
                k,
                np.nan,
                np.nan,
                float(np.median([axis.terms[term].bound for axis in axes])) * _UNITS[curve.kind][term][2],
            )
            for k, term in enumerate(TERMS)
        }
        fitted = np.full(len(curve.tau_s), np.nan)
        probability = np.nan
        disturbance = "all axes hold more than noise"
        edf = np.sum([axis.edf for axis in axes], axis=0)
    return AllanAxis(
        name=name,
        kind=curve.kind,
        tau_s=curve.tau_s,
        deviation=np.sqrt(curve.variance),
        edf=edf,
        fitted=fitted,
        terms=terms,
        affected=np.any([axes[k].affected for k in of], axis=0),
        disturbance=disturbance,
        probability=probability,
    )


def _notes(
    axes: tuple[AllanAxis, ...],
    gyro: AllanAxis,
    accelerometer: AllanAxis,
    moved: bool,
    duration_s: float,
) -> tuple[str, ...]:
    """What a user should read."""
    notes = [f"Of {axis.name} only bounds: {axis.disturbance}." for axis in axes if axis.disturbance]
    if moved:
        notes.append(
            "The platform moved. Axes across gravity are bounded by the difference between what gyros and "
            "accelerometers feel of the rotation, which holds none of it."
        )
    for together in (gyro, accelerometer):
        of = [axis for axis in axes if axis.kind == together.kind]
        clean = [axis.name for axis in of if axis.disturbance is None]
        if not clean:
            notes.append(f"The {together.name} together have the middle one of the three bounds.")
        elif len(clean) < len(of):
            notes.append(f"The {together.name} together are those without motion: {', '.join(clean)}.")
        if together.disturbance is None and not together.terms["bias_instability"].is_determined:
            notes.append(
                f"The bias instability of the {together.name} does not show in {duration_s:.0f} s; a longer "
                f"record would show it."
            )
    for axis in axes:
        drift = axis.terms["drift"]
        if drift.is_determined:
            notes.append(
                f"{axis.name[0].upper()}{axis.name[1:]} drifts by {drift.value:.2g} {drift.unit}, as a unit "
                f"does that is warming up."
            )
    return tuple(notes)


def _check(increments: InertialIncrements) -> float:
    """Interval of a record that can be analysed."""
    n = len(increments.angle_rad)
    if n < LEAST_SAMPLES:
        raise NoSolutionError(
            f"an Allan deviation needs {LEAST_SAMPLES} samples or more, and the record has {n}; record for "
            f"longer"
        )
    steps = np.diff(increments.time_s)
    interval_s = float(np.median(steps))
    if not (interval_s > 0.0 and np.all(np.abs(steps - interval_s) < 0.01 * interval_s)):
        raise NoSolutionError(
            f"an Allan deviation needs samples at equal intervals, and those of the record are between "
            f"{steps.min():g} and {steps.max():g} s; give a part without gaps"
        )
    for kind, values in _sensors(increments):
        for k, axis in enumerate(AXES):
            if not np.all(np.isfinite(values[:, k])):
                raise NoSolutionError(f"{kind} {axis} has missing samples; give a part without them")
            if np.ptp(values[:, k]) == 0.0:
                raise NoSolutionError(
                    f"{kind} {axis} never changes, so it is stuck or absent; check the mapping of the columns"
                )
    blocks = np.array_split(increments.velocity_mps, 32)
    force = np.array([block.mean(axis=0) for block in blocks]) / interval_s
    size = np.linalg.norm(force, axis=1)
    if not 0.8 < np.median(size) / STANDARD_GRAVITY_MPS2 < 1.2:
        raise NoSolutionError(
            f"the accelerometers feel {np.median(size):.3g} m/s^2 where gravity is 9.8, so they are not at "
            f"rest on the Earth or their unit is wrong; check the mapping of the columns"
        )
    mean = force.mean(axis=0) / np.linalg.norm(force.mean(axis=0))
    tilt_deg = np.degrees(np.arccos(np.clip((force @ mean) / size, -1.0, 1.0)).max())
    turned = np.array([block.sum(axis=0) for block in np.array_split(increments.angle_rad, 32)])
    apart_deg = np.degrees(np.linalg.norm(turned - np.median(turned, axis=0), axis=1).max())
    # The bias of a poor gyro may wander by as much, but not that fast.
    fast = apart_deg > 5.0 and apart_deg / (n / 32.0 * interval_s) > 0.2
    if tilt_deg > 5.0 or fast:
        what = f"was tilted by {tilt_deg:.0f} deg" if tilt_deg > 5.0 else f"turned by {apart_deg:.0f} deg"
        raise NoSolutionError(
            f"the unit {what} within the record, and noise shows at rest only; give a part at rest"
        )
    return float((increments.time_s[-1] - increments.time_s[0]) / n)


def _sensors(increments: InertialIncrements) -> tuple[tuple[Kind, np.ndarray], ...]:
    """The two kinds of sensor with their increments."""
    return ("gyro", increments.angle_rad), ("accelerometer", increments.velocity_mps)


def _stated(term: NoiseTerm, of_grade: float) -> float:
    """Value where the record gives one; else that of the grade unless the record excludes it."""
    return _rounded(term.value if term.is_determined else min(of_grade, term.bound))


def _rounded(value: float, digits: int = 4) -> float:
    return float(f"{value:.{digits}g}")
