r"""Where a record is still: the likelihood ratio of a body at rest, from gyros and accelerometers.

At rest the gyros feel a constant rate (the Earth's and their bias) and the accelerometers a force of constant
size whose direction is the window's own mean. Of N samples in a window the generalised likelihood ratio test
of Skog et al. (2010) compares

.. math::
    T = \frac1{4N}\sum_k \left( \frac{|f_k - \bar g\,\bar f/|\bar f||^2}{\sigma_f^2}
        + \frac{|\omega_k - \omega_0|^2}{\sigma_\omega^2} \right)

with a threshold; 4 because six components lose little to the mean, and two of the force's three feel a tilt
only. Size of the force and constant rate are medians over the record, so most of it must be still. The
deviations are the larger ones of what the sensor is stated to have and of the record's quiet part, so that a
platform which is shaken evenly, by an engine or the wind, counts as still: it stays about its place.

References
----------
Skog, I., Händel, P., Nilsson, J.-O., Rantakokko, J., "Zero-velocity detection: an algorithm evaluation", IEEE
Transactions on Biomedical Engineering 57 (2010) 2657-2666.
"""

from __future__ import annotations

import numpy as np

from ..errors import NoSolutionError
from ..sensors.imu import ImuDescription
from ..strapdown import InertialIncrements, compress_increments

__all__ = ["detect_stillness"]

SAMPLE_S = 0.1
"""Length over which increments are summed before they are judged."""
QUIET_SHARE = 0.3
"""Share of the record that is taken for its quiet part."""


def detect_stillness(
    increments: InertialIncrements,
    *,
    errors: ImuDescription | None = None,
    window_s: float = 1.0,
    threshold: float = 4.0,
) -> np.ndarray:
    """Which intervals of a record belong to a platform that stays about its place.

    Parameters
    ----------
    increments : InertialIncrements
        What the unit felt, n intervals.
    errors : ImuDescription, optional
        Noise of the sensor; otherwise that of the record's quiet part alone.
    window_s : float
        Length of the windows, seconds.
    threshold : float
        Times the usual size of the test's value at which a window is no longer still.

    Returns
    -------
    ndarray of bool, shape (n,)
        False in windows in which the platform moves, and in their neighbours.

    Raises
    ------
    NoSolutionError
        If the record is shorter than three windows.

    Notes
    -----
    Motion at an even speed without turning is not felt by any inertial unit, and counts as still.
    """
    n = len(increments.angle_rad)
    step_s = float(np.median(np.diff(increments.time_s)))
    samples = max(1, min(round(SAMPLE_S / step_s), round(window_s / step_s)))
    per_window = max(1, round(window_s / (samples * step_s)))
    blocks = compress_increments(increments, samples)
    windows = len(blocks.angle_rad) // per_window
    if windows < 3:
        raise NoSolutionError(
            f"whether a platform is still was asked of {n * step_s:.1f} s of data;"
            f" give at least three windows of {window_s:g} s"
        )
    used = windows * per_window
    length = samples * step_s
    rate = blocks.angle_rad[:used] / length
    force = blocks.velocity_mps[:used] / length
    rate = (rate - np.median(rate, axis=0)).reshape(windows, per_window, 3)
    force = force.reshape(windows, per_window, 3)
    mean = force.mean(axis=1, keepdims=True)
    size = np.linalg.norm(mean, axis=2, keepdims=True)
    force = force - np.median(size) * mean / size
    values = np.zeros(windows)
    for rows, stated in zip((force, rate), _deviations(errors, length), strict=True):
        square = np.mean(np.sum(rows**2, axis=2), axis=1)
        usual = np.quantile(square, QUIET_SHARE)
        values += 0.5 * square / max(usual, 3.0 * stated**2, 1e-30)
    moving = values > threshold
    # A motion that begins or ends in a window may lie below the threshold in the one before or after.
    moving[1:] |= values[:-1] > threshold
    moving[:-1] |= values[1:] > threshold
    still = np.repeat(~moving, per_window * samples)
    return np.concatenate([still, np.full(n - len(still), not moving[-1])])


def _deviations(errors: ImuDescription | None, length_s: float) -> tuple[float, float]:
    """Stated deviations of force and rate of one axis over a length."""
    if errors is None:
        return 0.0, 0.0
    root = np.sqrt(length_s)
    return errors.accel_density_mps_per_sqrt_s / root, errors.gyro_density_rad_per_sqrt_s / root
