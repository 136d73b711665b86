"""Made-up vectors of an array, with the joint covariance that antennas with independent errors have."""

import numpy as np

from truenorth.attitude.array_vectors import ArrayVectors
from truenorth.rotations import rot_ned_from_body


def antenna_covariance(sd_m, n_antennas):
    """Joint covariance of antennas with independent errors; `sd_m` one number or one per direction."""
    variance = np.broadcast_to(np.square(np.asarray(sd_m, dtype=float)), (3,))
    return np.kron(np.eye(n_antennas), np.diag(variance))


def vector_covariance(antenna_cov_m2, reference=0):
    """The same of the vectors from a reference antenna to all; NaN in the rows of the reference."""
    m = len(antenna_cov_m2) // 3
    jump = np.kron(np.eye(m) - np.eye(m)[reference], np.eye(3))
    cov = jump @ antenna_cov_m2 @ jump.T
    cov[3 * reference : 3 * reference + 3] = np.nan
    cov[:, 3 * reference : 3 * reference + 3] = np.nan
    return cov


def make_vectors(
    body_m, rot, *, sd_m=0.003, body_sd_m=0.0, antenna_cov_m2=None, reference=0, seed=1, noise=True
):
    """Vectors from one antenna with errors drawn from their covariance.

    The true body coordinates are `body_m` with one error an epoch drawn from `body_sd_m`, so that the
    epochs are independent trials.
    """
    rng = np.random.default_rng(seed)
    body_m = np.asarray(body_m, dtype=float)
    n, m = len(rot), len(body_m)
    if antenna_cov_m2 is None:
        antenna_cov_m2 = antenna_covariance(sd_m, m)
    error_m = rng.standard_normal((n, 3 * m)) @ np.linalg.cholesky(antenna_cov_m2).T
    true_body_m = body_m + body_sd_m * rng.standard_normal((n, m, 3))
    place_m = np.einsum("nij,nkj->nki", rot, true_body_m)
    if noise:
        place_m += error_m.reshape(n, m, 3)
    vector_m = place_m - place_m[:, reference : reference + 1]
    vector_m[:, reference] = np.nan
    return ArrayVectors(
        time_ns=np.arange(n, dtype=np.int64) * 1_000_000_000,
        reference=np.full(n, reference),
        vector_ned_m=vector_m,
        cov_ned_m2=np.tile(vector_covariance(antenna_cov_m2, reference), (n, 1, 1)),
        positions_body_m=body_m,
        body_cov_m2=body_sd_m**2 * np.eye(3 * m),
        names=tuple(f"antenna {k}" for k in range(m)),
    )


def random_rotations(n, *, seed=2, tilt_rad=0.5):
    """Attitudes of any heading, tilted up to a limit."""
    rng = np.random.default_rng(seed)
    heading = rng.uniform(0.0, 2.0 * np.pi, n)
    return rot_ned_from_body(heading, *rng.uniform(-tilt_rad, tilt_rad, (2, n)))


def turn_between(rot, other):
    """Small turns in the local frame that take one attitude to another, shape (n, 3)."""
    from truenorth.rotations import log_so3

    return log_so3(other @ np.swapaxes(rot, 1, 2))
