"""Made-up vectors of a rigid array, with antennas whose errors are white or stay alike for a while."""

import numpy as np

from truenorth.attitude.array_vectors import ArrayVectors
from truenorth.rotations import rot_ned_from_body

BODY_M = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [1.0, 1.5, -0.3], [0.5, -1.2, 0.1]])
SD_M = (0.003, 0.003, 0.006)


def make_vectors(n=300, *, body_m=BODY_M, sd_m=SD_M, seed=1, is_moving=True, tau_s=0.0):
    """Vectors at 1 Hz from the first antenna, with their true joint covariance."""
    rng = np.random.default_rng(seed)
    m, k = len(body_m), np.arange(n)
    if is_moving:
        rot = rot_ned_from_body(np.radians(340.0) + 0.01 * k, 0.05 * np.sin(0.1 * k), 0.1 * np.cos(0.07 * k))
    else:
        rot = np.broadcast_to(rot_ned_from_body(1.0, 0.02, -0.03), (n, 3, 3))
    error = rng.standard_normal((n, m, 3))
    if tau_s:
        keep = np.exp(-1.0 / tau_s)
        for i in range(1, n):
            error[i] = keep * error[i - 1] + np.sqrt(1.0 - keep**2) * error[i]
    place_m = np.einsum("nij,kj->nki", rot, body_m) + error * np.array(sd_m)
    vector_m = place_m - place_m[:, :1]
    vector_m[:, 0] = np.nan
    cov = np.kron(np.ones((m, m)) + np.eye(m), np.diag(np.square(sd_m)))
    cov[:3], cov[:, :3] = np.nan, np.nan
    return ArrayVectors(
        time_ns=k * 1_000_000_000,
        reference=np.zeros(n, np.int64),
        vector_ned_m=vector_m,
        cov_ned_m2=np.tile(cov, (n, 1, 1)),
        positions_body_m=np.asarray(body_m, dtype=float),
        body_cov_m2=np.zeros((3 * m, 3 * m)),
        names=tuple("abcdef"[:m]),
    )
