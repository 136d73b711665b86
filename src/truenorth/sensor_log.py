"""The container of sensor samples: what every sensor reader and every simulated sensor fills."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

__all__ = ["SensorLog"]


@dataclass(frozen=True, slots=True, eq=False)
class SensorLog:
    """Samples of one sensor.

    Parameters
    ----------
    kind : str
        ``gyro``, ``compass``, ``tilt``, ``imu``, ``turntable_accelerometer``, ``odometer``.
    time_ns : ndarray of int64, shape (n,)
        Time stamps as logged, GPS time, nanoseconds.
    columns : dict of str to ndarray, shape (n,)
        What the sensor says; units in the names, e.g. ``rate_count``, ``heading_magnetic_deg``.
    meta : dict of str to str or float
        What a decoder must know and the stream does not say (scale factors, serial numbers).
    truth : dict of str to ndarray, shape (n,)
        Of simulated samples: true time ``time_ns`` and every error term; empty for real ones.
    """

    kind: str
    time_ns: np.ndarray
    columns: Mapping[str, np.ndarray]
    meta: Mapping[str, str | float] = field(default_factory=dict)
    truth: Mapping[str, np.ndarray] = field(default_factory=dict)

    @property
    def n_samples(self) -> int:
        """int: Number of samples."""
        return len(self.time_ns)

    def __str__(self) -> str:
        """One line: kind, samples, columns."""
        return f"{self.kind}: {self.n_samples} samples of {', '.join(self.columns)}"
