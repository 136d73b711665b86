"""Rate dynamics: a baseline that can hardly have turned since the last epoch is known better."""

import numpy as np

import truenorth


def test_slow_platform_gains_from_its_last_direction(data_dir):
    folder = data_dir / "pair_0.33m_ublox"
    base = truenorth.read_observations(folder / "base.ubx.gz")
    rover = truenorth.read_observations(folder / "rover.ubx.gz")
    navigation = truenorth.read_navigation(folder / "rover.ubx.gz")
    options = {
        "length_m": 0.3296, "systems": "G", "bands": ("L1",), "elevation_mask_deg": 35,
        "method": "constrained",
    }  # fmt: skip
    free = truenorth.solve_baseline(base, rover, navigation, **options)
    slow = truenorth.solve_baseline(base, rover, navigation, rotation_rate_sd_dps=1.0, **options)
    fast = truenorth.solve_baseline(base, rover, navigation, rotation_rate_sd_dps=1000.0, **options)
    both = free.is_accepted & slow.is_accepted
    assert slow.is_accepted.mean() >= free.is_accepted.mean() > 0.95
    assert np.median(slow.azimuth_sd_rad[both]) < 0.97 * np.median(free.azimuth_sd_rad[both])
    # No accepted baseline is more than 10 cm from the published one.
    truth = np.array([-0.2367, 0.2292, 0.0013])
    assert np.max(np.linalg.norm(slow.baseline_enu_m[slow.is_accepted] - truth, axis=1)) < 0.10
    # A platform that may turn at any rate is as free as before, to a hundredth of the sigma.
    both = free.is_accepted & fast.is_accepted
    gap = np.abs(fast.azimuth_rad[both] - free.azimuth_rad[both])
    assert np.median(gap / free.azimuth_sd_rad[both]) < 0.01
