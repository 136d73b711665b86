"""Covariances of float ambiguities from random skies, for studies of integer methods.

    Q = (Q_phase + H (G^T Q_code^{-1} G)^{-1} H^T) / (lambda lambda^T)

Satellites are spread evenly over the sky above 10 degrees; one epoch, equal noise for all, double
differences with one reference satellite on each of one to three frequencies (L1, L2, L5).
"""

import numpy as np

WAVELENGTH_M = (0.190293673, 0.244210213, 0.254828049)


def float_covariance(n, n_bands, *, code_sd_m=0.30, phase_sd_m=0.003, rng):
    """Covariance of n float double-difference ambiguities, cycles squared, shape (n, n).

    The satellites are as many as n needs, and at least five; the first n rows are kept, band by band.
    """
    n_sats = max(5, -(-n // n_bands) + 1)
    azimuth = rng.uniform(0.0, 2.0 * np.pi, n_sats)
    sin_elevation = rng.uniform(np.sin(np.radians(10.0)), 1.0, n_sats)
    horizontal = np.sqrt(1.0 - sin_elevation**2)
    unit = np.column_stack([horizontal * np.sin(azimuth), horizontal * np.cos(azimuth), sin_elevation])
    design = -(unit[1:] - unit[0])
    # Between receivers 2, between satellites the reference in common: 2 (I + 1 1^T).
    cofactor = 2.0 * (np.eye(n_sats - 1) + 1.0)
    cov_baseline = np.linalg.inv(n_bands * design.T @ np.linalg.solve(cofactor, design)) * code_sd_m**2
    wavelength = np.repeat(WAVELENGTH_M[:n_bands], n_sats - 1)
    design_cyc = np.tile(design, (n_bands, 1)) / wavelength[:, None]
    cov_phase = np.kron(np.eye(n_bands), cofactor) * phase_sd_m**2 / np.outer(wavelength, wavelength)
    cov = cov_phase + design_cyc @ cov_baseline @ design_cyc.T
    # Rows in turn from every band, so that any n keeps most of the satellites.
    turn = np.arange(n_bands * (n_sats - 1)).reshape(n_bands, -1).T.ravel()[:n]
    return np.ascontiguousarray(cov[np.ix_(turn, turn)])
