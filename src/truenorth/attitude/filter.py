r"""Filter and smoother of attitude and angular rate on the rotation group, from the vectors of an array.

The state is the attitude R (north, east, down from body) and the angular rate of the body in body axes,

.. math:: \dot R = R\,[\omega]_\times, \qquad \dot\omega = \text{white noise},

its error a small rotation in body axes, :math:`R_{true} = R \exp([e]_\times)`, and that of the rate. An
epoch's vectors enter together, with their joint covariance; any of them may be missing, and any antenna be
the reference. The process noise does not depend on the rate of the epochs: the rates gain variance q t in t
seconds, which with constant rate gives the covariance :math:`q\,[[t^3/3,\,t^2/2],[t^2/2,\,t]]` of angle and
rate. The form printed by Wang and Lachapelle, which adds to the rates the same variance at every epoch, is
an option.

An epoch whose innovation fails the global test is searched for the antenna that does not fit (vector-wise
test with three degrees of freedom, local tests of the components), which is left out, and tested again. A
filter whose prediction is wrong rejects all that could correct it; after a number of such epochs it is
started anew by least squares. The smoother is that of Rauch, Tung and Striebel, its corrections vectors of
the tangent spaces.

References
----------
C. Wang, G. Lachapelle, "GPS attitude determination reliability performance improvement using low cost
receivers", Journal of Global Positioning Systems 1 (2002); P. J. G. Teunissen, "Quality control in
integrated navigation systems", IEEE Aerospace and Electronic Systems Magazine 5 (1990); W. Baarda, A
testing procedure for use in geodetic networks (1968); H. E. Rauch, F. Tung, C. T. Striebel, "Maximum
likelihood estimates of linear dynamic systems", AIAA Journal 3 (1965); J. Sola, J. Deray, D. Atchuthan, "A
micro Lie theory for state estimation in robotics", arXiv:1812.01537 (2018); G. J. Bierman, Factorization
Methods for Discrete Sequential Estimation (1977), on parameters that are considered but not estimated.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..errors import ConfigError, ModelError
from ..rotations import exp_so3, log_so3, skew
from .array_vectors import ArrayVectors, VectorBlock
from .filter_run import FilterRun
from .filter_state import AttitudeFilterSettings, FilteredAttitude, FilterState, FilterStatus
from .white_rows import ArrayInformation

__all__ = [
    "AttitudeFilterSettings",
    "FilterState",
    "FilterStatus",
    "FilteredAttitude",
    "Innovation",
    "filter_attitude",
    "innovations",
]


class Innovation(NamedTuple):
    """Innovation of e epochs with the same k vectors, linearised about the updated attitude.

    Parameters
    ----------
    innovation_m : ndarray, shape (e, 3 k)
        Measured less predicted vectors, in north, east, down; the prediction is the linear one, so that the
        curvature of a large correction is not taken for an error.
    design : ndarray, shape (e, 3 k, 6)
        Derivative of the vectors to rotation (predicted body axes, rad) and rate.
    predicted_cov : ndarray, shape (e, 6, 6)
        Covariance of the prediction.
    noise_cov_m2 : ndarray, shape (e, 3 k, 3 k)
        Covariance of the measured vectors, that of the body coordinates included.
    cov_m2 : ndarray, shape (e, 3 k, 3 k)
        Covariance of the innovation, ``H P H' + R``. That the prediction rests on the same body coordinates
        as the vectors is left out here; the tests of the filter take it in.
    gain : ndarray, shape (e, 6, 3 k)
        ``P H' C_v^-1``: what an innovation adds to rotation and rate.
    """

    innovation_m: np.ndarray
    design: np.ndarray
    predicted_cov: np.ndarray
    noise_cov_m2: np.ndarray
    cov_m2: np.ndarray
    gain: np.ndarray


def filter_attitude(
    vectors: ArrayVectors | ArrayInformation,
    settings: AttitudeFilterSettings | None = None,
    *,
    is_used: np.ndarray | None = None,
    times_ns: np.ndarray | None = None,
    state: FilterState | None = None,
) -> FilteredAttitude:
    """Filter or smooth the attitude of an array.

    Parameters
    ----------
    vectors : ArrayVectors or ArrayInformation
        Vectors with their covariance, or their normal equations from the phases; the same numbers come out.
    settings : AttitudeFilterSettings, optional
        By default all defaults.
    is_used : ndarray of bool, shape (n, m), optional
        Vectors that take part; by default all that are there.
    times_ns : ndarray of int64, optional
        Times at which to give out attitudes, increasing; by default those of the vectors, or those of
        `settings.output_rate_hz`.
    state : FilterState, optional
        Of an earlier block, `FilteredAttitude.state`; only for the forward filter. It is not changed.

    Returns
    -------
    FilteredAttitude

    Raises
    ------
    ModelError
        If the epochs are not in time order, or a covariance is not positive definite.
    ConfigError
        If a state is given to a filter that needs the whole run.
    """
    settings = AttitudeFilterSettings() if settings is None else settings
    for name, times in (("vectors", vectors.time_ns), ("times asked for", times_ns)):
        if times is not None and np.any(np.diff(times) <= 0):
            raise ModelError(f"the epochs of the {name} are not in time order; sort them, each time once")
    if state is not None and settings.direction != "forward":
        raise ConfigError(
            "a state can only be carried on by the forward filter; the others need the whole run",
            key="direction",
            value=settings.direction,
        )
    if times_ns is None and settings.output_rate_hz is not None:
        times_ns = _regular_times(vectors.time_ns, settings.output_rate_hz)
    if settings.direction == "backward":
        run = FilterRun(_reversed(vectors), settings, None if is_used is None else is_used[::-1],
                   None if times_ns is None else -np.asarray(times_ns)[::-1], None)  # fmt: skip
        run.filter()
        return _forward_again(run.result())
    run = FilterRun(vectors, settings, is_used, times_ns, state)
    run.filter()
    if settings.direction == "smoother":
        run.smooth()
    return run.result()


def innovations(
    filtered: FilteredAttitude, vectors: ArrayVectors, *, is_used: np.ndarray | None = None
) -> Iterator[tuple[VectorBlock, Innovation]]:
    """Innovations of a filter with all that minimal detectable errors need (Wang 2002, eqs. 11 to 15).

    Parameters
    ----------
    filtered : FilteredAttitude
        Of the forward or backward filter over the same vectors, predictions kept.
    vectors : ArrayVectors
        The vectors.
    is_used : ndarray of bool, shape (n, m), optional
        Vectors that take part; by default all that are there.

    Yields
    ------
    VectorBlock, Innovation
        Epochs with a prediction, by their antennas. `VectorBlock.epochs` are indices of the vectors.

    Raises
    ------
    ModelError
        If the predictions were not kept, or the attitudes are smoothed.
    """
    if filtered.settings.direction == "smoother":
        raise ModelError("a smoothed run has no innovations; filter it forward or backward")
    if filtered.predicted_cov is None:
        raise ModelError("the filter did not keep its predictions; set `keep_predictions`")
    at = np.searchsorted(filtered.time_ns, vectors.time_ns)
    at = np.minimum(at, filtered.n_epochs - 1)
    has = (filtered.time_ns[at] == vectors.time_ns) & np.isfinite(filtered.predicted_cov[at, 0, 0])
    use = vectors.is_present if is_used is None else is_used
    for block in vectors.blocks(use & has[:, None]):
        rows = at[block.epochs]
        rot, cov = filtered.predicted_rot[rows], filtered.predicted_cov[rows]
        k = len(block.antennas)
        # About the updated attitude; where the epoch was left out, that is the prediction.
        change = log_so3(np.swapaxes(rot, 1, 2) @ filtered.rot_ned_from_body[rows])
        change[~np.isfinite(change)] = 0.0
        rot = rot @ exp_so3(change)
        fitted = np.einsum("eij,kj->eki", rot, block.body_m)
        design = np.zeros((len(rows), 3 * k, 6))
        slope = -(rot[:, None] @ skew(block.body_m)) @ _right_jacobian(change)[:, None]
        design[:, :, :3] = slope.reshape(len(rows), 3 * k, 3)
        innovation = (block.vector_ned_m - fitted).reshape(len(rows), 3 * k)
        innovation += np.einsum("eij,ej->ei", design[:, :, :3], change)
        turned = np.einsum("eij,kjal,eml->ekiam", rot, block.body_cov_m2.reshape(k, 3, k, 3), rot)
        noise = block.cov_ned_m2 + turned.reshape(len(rows), 3 * k, 3 * k)
        crossed = cov @ np.swapaxes(design, 1, 2)
        total = design @ crossed + noise
        gain = np.swapaxes(np.linalg.solve(total, np.swapaxes(crossed, 1, 2)), 1, 2)
        yield block, Innovation(innovation, design, cov, noise, total, gain)


def _right_jacobian(vector):
    """J with exp([v + d]x) = exp([v]x) exp([J d]x) to first order in d; v of shape (n, 3)."""
    angle = np.sqrt(np.sum(vector * vector, axis=-1))[..., None, None]
    cross = skew(vector)
    is_small = angle < 1e-2
    safe = np.where(is_small, 1.0, angle)
    second = np.where(is_small, 1.0 / 6.0 - angle**2 / 120.0, (safe - np.sin(safe)) / safe**3)
    return np.eye(3) - 0.5 * np.sinc(0.5 * angle / np.pi) ** 2 * cross + second * (cross @ cross)


def _regular_times(time_ns, rate_hz):
    """Whole multiples of the period of a rate within a run, GPS time."""
    if not len(time_ns):
        return np.empty(0, dtype=np.int64)
    period = 1e9 / rate_hz
    first, last = math.ceil(time_ns[0] / period - 1e-6), math.floor(time_ns[-1] / period + 1e-6)
    return np.rint(np.arange(first, last + 1) * period).astype(np.int64)


def _reversed(measured):
    """The same vectors with time running backward."""
    if isinstance(measured, ArrayVectors):
        parts = {"vector_ned_m": measured.vector_ned_m[::-1], "cov_ned_m2": measured.cov_ned_m2[::-1]}
    else:
        parts = {
            "normal_per_m2": measured.normal_per_m2[::-1],
            "right_side_per_m": measured.right_side_per_m[::-1],
        }
    time_ns = -np.asarray(measured.time_ns)[::-1]
    return replace(measured, time_ns=time_ns, reference=measured.reference[::-1], **parts)


def _forward_again(filtered):
    """The result of a filter over reversed time, in true time: rates have the other sign."""
    sign = np.array([1.0, 1.0, 1.0, -1.0, -1.0, -1.0])
    mirror = np.outer(sign, sign)
    parts = {}
    for name in FilteredAttitude.__dataclass_fields__:
        value = getattr(filtered, name)
        if isinstance(value, np.ndarray):
            parts[name] = np.ascontiguousarray(value[::-1])
    parts["time_ns"] = -parts["time_ns"]
    for name in ("rate_body_radps", "predicted_rate"):
        if name in parts:
            parts[name] = -parts[name]
    for name in ("cov", "predicted_cov"):
        if name in parts:
            parts[name] = parts[name] * mirror
    events = tuple(replace(event, time_ns=-event.time_ns) for event in reversed(filtered.events))
    return replace(filtered, events=events, **parts)
