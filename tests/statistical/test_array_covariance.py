"""The attitude's covariance and its test against the errors of 10,000 made-up epochs."""

import numpy as np

from synthetic_array import make_attitude, true_angles

N = 10_000


def test_covariance_and_residual_test_are_honest():
    solution = make_attitude(N, length_sd_m=0.0, residual_significance=0.01, seed=4)
    # Epochs without a baseline left out, of which the test takes its share of one per cent.
    whole = solution.n_antennas_used == 4
    angles = np.stack([solution.heading_rad, solution.pitch_rad, solution.roll_rad], axis=1)
    error = (angles - true_angles(N) + np.pi) % (2.0 * np.pi) - np.pi
    nees = np.einsum("ni,nij,nj->n", error[whole], np.linalg.inv(solution.cov_rad2[whole]), error[whole])
    # Chi-square of 3 degrees of freedom: mean 3, variance 6; four standard deviations of the mean.
    assert abs(np.mean(nees) - 3.0) < 4.0 * np.sqrt(6.0 / N)
    # 9 coordinates less 3 angles.
    assert abs(np.mean(solution.chi2) - 6.0) < 4.0 * np.sqrt(12.0 / N)
    share = np.mean(solution.chi2 > solution.chi2_limit)
    assert abs(share - 0.01) < 4.0 * np.sqrt(0.01 * 0.99 / N)
