"""Vectors of a turning array whose motion follows the model of the filter, for its tests."""

import numpy as np

from truenorth.attitude.array_vectors import ArrayVectors
from truenorth.rotations import exp_so3

SQUARE_M = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]])
SOLID_M = np.array([[0.0, 0.0, 0.0], [1.2, 0.1, -0.1], [-0.2, 0.9, 0.0], [0.4, 0.3, -0.7]])
DEGREE = np.radians(1.0)


def array_vectors(
    time_ns, rot, body=SQUARE_M, *, sd_m=0.003, rng=None, reference=None, is_missing=None, true_body=None
):
    """Vectors of an array at given attitudes; each antenna has its own noise of `sd_m` in each component.

    `true_body`, shape (n, m, 3), is where the antennas really are; the vectors' body frame is `body`.
    """
    n, m = len(time_ns), len(body)
    where = np.broadcast_to(body, (n, m, 3)) if true_body is None else true_body
    points = np.einsum("nij,nmj->nmi", rot, where)
    if rng is not None:
        points = points + sd_m * rng.standard_normal((n, m, 3))
    reference = np.zeros(n, dtype=np.int64) if reference is None else reference
    vector = points - points[np.arange(n), reference][:, None]
    is_missing = np.zeros((n, m), dtype=bool) if is_missing is None else is_missing.copy()
    is_missing[np.arange(n), reference] = True
    vector[is_missing] = np.nan
    gone = np.repeat(is_missing, 3, axis=1)
    cov = np.tile(sd_m**2 * np.kron(np.ones((m, m)) + np.eye(m), np.eye(3)), (n, 1, 1))
    cov[gone[:, :, None] | gone[:, None, :]] = np.nan
    names = tuple("ABCDEFGH"[:m])
    return ArrayVectors(time_ns, reference, vector, cov, body, np.zeros((3 * m, 3 * m)), names)


def turning_runs(rng, n_runs, intervals_s, *, rate_noise_dps2_per_s, rate_sd_dps, pause_s=1000.0):
    """Motions whose body rates wander at random, many runs one after the other with long pauses between.

    Returns times (n,), attitudes (n, 3, 3) and body rates (n, 3); each run has an epoch at its start and one
    after every interval.
    """
    noise = DEGREE * np.sqrt(np.asarray(rate_noise_dps2_per_s))
    rot = exp_so3(rng.uniform(-1.0, 1.0, (n_runs, 3)) * np.array([0.3, 0.3, 3.0]))
    rate = rate_sd_dps * DEGREE * rng.standard_normal((n_runs, 3))
    rots, rates = [rot], [rate]
    for interval in intervals_s:
        parts = max(10, int(interval / 0.02))
        for _ in range(parts):
            step = np.sqrt(interval / parts) * noise * rng.standard_normal((n_runs, 3))
            rot = rot @ exp_so3(interval / parts * (rate + 0.5 * step))
            rate = rate + step
        rots.append(rot)
        rates.append(rate)
    clock = np.concatenate([[0.0], np.cumsum(intervals_s)]) + pause_s * np.arange(n_runs)[:, None]
    time_ns = np.rint(1e9 * clock).astype(np.int64).ravel()
    return (
        time_ns,
        np.swapaxes(np.array(rots), 0, 1).reshape(-1, 3, 3),
        np.swapaxes(np.array(rates), 0, 1).reshape(-1, 3),
    )
