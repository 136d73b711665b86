"""What the emulator draws agrees with what was asked: noise, multipath, clocks, slips, outages.

Bounds are quantiles of the statistic's own distribution with a false alarm below 1e-4; seeds are fixed.
"""

import numpy as np
import pytest
from scipy import stats

from simulated_sessions import NOISELESS, pair
from truenorth.constants import SPEED_OF_LIGHT_MPS
from truenorth.observations import LLI_SLIP
from truenorth.simulation import simulate
from truenorth.simulation.randomness import stream
from truenorth.simulation.receivers import ClockSection, ReceiverClock, ThermalNoise, noise_sd

_ALARM = 1e-4


def _check_sd(sample, sd):
    """Sample variance against chi-square bounds."""
    n = len(sample)
    low, high = stats.chi2.ppf((_ALARM / 2, 1 - _ALARM / 2), n - 1) / (n - 1)
    assert low * sd**2 < np.var(sample, ddof=1) < high * sd**2


def test_constant_noise_has_its_standard_deviations():
    noise = {"kind": "constant", "code_sd_m": 0.4, "phase_sd_m": 0.003, "doppler_sd_hz": 0.1}
    truth = simulate(pair(duration_s=120.0, receiver={"noise": noise})).signal_truth["fore"]
    _check_sd(truth["code_noise_m"], 0.4)
    _check_sd(truth["phase_noise_m"], 0.003)
    _check_sd(truth["doppler_noise_hz"], 0.1)


def test_thermal_noise_follows_the_signal_strength():
    simulation = simulate(pair(duration_s=120.0, receiver={"signals": {"G": ["1C"]}}))
    truth = simulation.signal_truth["aft"]
    n = len(truth["cn0_dbhz"])
    code_sd, phase_sd, _ = noise_sd(
        ThermalNoise(), truth["cn0_dbhz"], np.full(n, SPEED_OF_LIGHT_MPS / 1575.42e6), np.full(n, 293.05)
    )
    _check_sd(truth["code_noise_m"] / code_sd, 1.0)
    _check_sd(truth["phase_noise_m"] / phase_sd, 1.0)
    # Kaplan & Hegarty 2017: a PLL of 15 Hz at 45 dB-Hz has 0.66 mm on L1.
    _, at_45, _ = noise_sd(ThermalNoise(), np.array([45.0]), np.array([0.1903]), np.array([293.05]))
    assert at_45[0] == pytest.approx(0.66e-3, rel=0.01)


def test_errors_of_two_antennas_are_independent():
    simulation = simulate(pair(duration_s=120.0, receiver={"signals": {"G": ["1C"]}}))
    aft, fore = (simulation.signal_truth[name]["phase_noise_m"] for name in ("aft", "fore"))
    n = min(len(aft), len(fore))
    assert abs(np.corrcoef(aft[:n], fore[:n])[0, 1]) < stats.norm.ppf(1 - _ALARM / 2) / np.sqrt(n)


def test_gauss_markov_multipath_has_its_size_and_memory():
    process = {"code_sd_m": 1.0, "phase_sd_m": 0.01, "tau_s": 20.0}
    scenario = pair(
        duration_s=3600.0,
        receiver={**NOISELESS, "signals": {"G": ["1C"]}, "multipath": {"gauss_markov": process}},
        visibility={"elevation_mask_deg": 10.0},
    )
    simulation = simulate(scenario)
    truth = simulation.signal_truth["aft"]
    lags, sums, count = np.arange(0, 41, 5), np.zeros(9), 0
    for sat in np.unique(truth["sat"]):
        series = truth["phase_multipath_m"][truth["sat"] == sat]
        if len(series) < 1800:
            continue
        sums += [np.mean(series[lag:] * series[: len(series) - lag]) for lag in lags]
        count += 1
    found = sums / count
    expected = 1e-4 * np.exp(-lags / 20.0)
    # Bartlett: a product-moment of T seconds of a process with memory tau has a relative spread of about
    # sqrt(2 tau / T), here of `count` independent satellites.
    spread = 1e-4 * np.sqrt(2 * 20.0 / 3600.0 / count)
    assert count >= 4
    assert np.max(np.abs(found - expected)) < 4.5 * spread


def test_multipath_moves_on_faster_under_way():
    process = {"phase_sd_m": 0.01, "tau_s": 100.0, "tau_moving_s": 2.0}
    scenario = pair(
        duration_s=600.0,
        receiver={**NOISELESS, "signals": {"G": ["1C"]}, "multipath": {"gauss_markov": process}},
        motion={"kind": "circle", "radius_m": 50.0, "speed_mps": 5.0},
        visibility={"elevation_mask_deg": 20.0},
    )
    truth = simulate(scenario).signal_truth["aft"]
    products = []
    for sat in np.unique(truth["sat"]):
        series = truth["phase_multipath_m"][truth["sat"] == sat]
        products += list(series[2:] * series[:-2])
    # Two seconds are one memory: a product of 1/e of the variance; spread of n products with memory 2 s.
    spread = 1e-4 * np.sqrt(2 * 2.0 / len(products))
    assert abs(np.mean(products) - 1e-4 * np.exp(-1.0)) < 4.5 * spread


def test_random_slips_come_at_their_rate_and_size():
    tracking = {"slips_per_hour": 60.0, "slip_cycles": 4, "slip_flag_share": 0.5}
    scenario = pair(
        duration_s=1200.0, receiver={"tracking": tracking}, visibility={"elevation_mask_deg": 10.0}
    )
    simulation = simulate(scenario)
    expected, sizes, flagged = 0.0, [], 0
    for name, observations in simulation.observations.items():
        truth = simulation.signal_truth[name]
        key = truth["sat"] * 1000 + truth["signal"]
        for channel in np.unique(key):
            rows = np.flatnonzero(key == channel)
            steps = np.diff(truth["slip_cyc"][rows])
            slipped = np.flatnonzero(steps) + 1
            sizes += list(np.abs(steps[slipped - 1]))
            flagged += np.count_nonzero(observations.lli[rows[slipped]] & LLI_SLIP)
            expected += (len(rows) - 1) * 60.0 / 3600.0
    low, high = stats.poisson.ppf((_ALARM / 2, 1 - _ALARM / 2), expected)
    assert low <= len(sizes) <= high
    assert set(sizes) == {1.0, 2.0, 3.0, 4.0}
    assert stats.chisquare([sizes.count(k) for k in (1.0, 2.0, 3.0, 4.0)]).pvalue > _ALARM
    low, high = stats.binom.ppf((_ALARM / 2, 1 - _ALARM / 2), len(sizes), 0.5)
    assert low <= flagged <= high


def test_slips_on_schedule_all_happen_and_are_listed():
    simulation = simulate(pair(duration_s=300.0, slips={"count": 80}))
    assert len(simulation.slips) >= 75, "a few fall where no satellite can take them"
    cycles = np.array([slip[4] for slip in simulation.slips])
    assert np.all((np.abs(cycles) >= 1) & (np.abs(cycles) <= 8))
    for time_ns, antenna, sat, signal, size in simulation.slips:
        truth = simulation.signal_truth[antenna]
        rows = np.flatnonzero((truth["sat"] == sat) & (truth["signal"] == signal))
        k = int(np.searchsorted(truth["time_ns"][rows], time_ns))
        assert truth["slip_cyc"][rows[k]] - truth["slip_cyc"][rows[k - 1]] == size


def test_clocks_have_the_stability_that_was_asked():
    allantools = pytest.importorskip("allantools")
    section = ClockSection(white_frequency=1e-9, random_walk_frequency=2e-11, offset_sd_s=0.0)
    clock = ReceiverClock(section, stream(7, "clock"))
    parts = [clock.step(np.arange(first, first + 5000.0)) for first in range(0, 50_000, 5000)]
    offset = np.concatenate([part[0] for part in parts])
    taus, deviation, _, _ = allantools.oadev(offset, rate=1.0, data_type="phase", taus=[1, 10, 100, 1000])
    expected = np.sqrt(1e-18 / taus + (2e-11) ** 2 * taus / 3.0)
    # Chi-square with about N / m degrees of freedom for each averaging time.
    for tau, found, wanted in zip(taus, deviation, expected, strict=True):
        freedom = 50_000 / tau
        low, high = stats.chi2.ppf((_ALARM / 2, 1 - _ALARM / 2), freedom) / freedom
        assert low < (found / wanted) ** 2 < high


def test_line_biases_are_constant_and_of_their_size():
    truth = simulate(pair(duration_s=10.0, receiver={"bias": {"code_sd_m": 2.0}})).signal_truth["aft"]
    biases = []
    for system in np.unique(truth["sat"] // 100):
        for signal in np.unique(truth["signal"][truth["sat"] // 100 == system]):
            values = truth["code_bias_m"][(truth["sat"] // 100 == system) & (truth["signal"] == signal)]
            assert np.ptp(values) == 0.0
            biases.append(values[0])
    _check_sd(np.array(biases), 2.0)
