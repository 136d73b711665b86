"""Simulated observations are the sum of their terms, and each term is what was asked for."""

import numpy as np
import pytest

import truenorth as tn
from simulated_sessions import NOISELESS, pair
from truenorth.constants import SPEED_OF_LIGHT_MPS
from truenorth.observations import LLI_HALF_CYCLE, LLI_SLIP, frequency_hz, sat_id, signal_id
from truenorth.simulation import Simulator, read_scenario, simulate

_COMMON_TERMS = ["range_m", "troposphere_m"]
_CODE_TERMS = [
    *_COMMON_TERMS,
    *("ionosphere_m", "receiver_clock_m", "group_delay_m"),
    *("code_bias_m", "code_multipath_m", "code_noise_m", "code_fault_m"),
]
_PHASE_TERMS = [
    *_COMMON_TERMS,
    *("phase_clock_m", "phase_bias_m", "phase_centre_m"),
    *("phase_multipath_m", "phase_noise_m", "phase_fault_m"),
]


def _of(observations, sat, signal):
    """Rows of one signal."""
    return (observations.sat == sat_id(sat)) & (observations.signal == signal_id(signal))


def _high_satellite(simulation, name="aft"):
    """A GPS satellite high in the sky for the whole run."""
    truth = simulation.signal_truth[name]
    gps = truth["sat"] < 100
    return f"G{truth['sat'][gps][np.argmax(truth['elevation_rad'][gps])]:02d}"


def test_observations_are_the_sum_of_their_terms():
    simulation = simulate(pair(output={"quantise": False}))
    for name, observations in simulation.observations.items():
        truth = simulation.signal_truth[name]
        wavelength = SPEED_OF_LIGHT_MPS / frequency_hz(
            observations.sat, observations.signal, observations.glonass_channel
        )
        code = sum(truth[term] for term in _CODE_TERMS) - truth["satellite_clock_m"]
        phase = sum(truth[term] for term in _PHASE_TERMS) - truth["satellite_clock_m"] - truth["ionosphere_m"]
        cycles = truth["integer_cyc"] + truth["half_cyc"] + truth["slip_cyc"] + truth["windup_cyc"]
        # Rounding of sums of numbers of 3e7.
        np.testing.assert_allclose(observations.code_m, code, rtol=0, atol=3e-8)
        np.testing.assert_allclose(observations.phase_cyc, phase / wavelength + cycles, rtol=0, atol=3e-7)


@pytest.mark.jit
def test_without_noise_the_solver_finds_the_antennas_to_a_hundredth_of_a_millimetre():
    receiver = {**NOISELESS, "clock": {"offset_sd_s": 1e-4, "drift_sd_sps": 1e-7}}
    simulation = simulate(pair(receiver=receiver, output={"quantise": False}))
    aft, fore = simulation.observations.values()
    solution = tn.solve_baseline(aft, fore, simulation.navigation, length_m=1.0, length_use="check")
    true = simulation.truth["antenna_ecef_m:fore"] - simulation.truth["antenna_ecef_m:aft"]
    assert np.all(solution.is_accepted)
    np.testing.assert_allclose(solution.baseline_ecef_m, true, rtol=0, atol=1e-5)


def test_the_integers_of_the_solver_are_those_of_the_simulator():
    simulation = simulate(pair(duration_s=5.0, receiver={"signals": {"G": ["1C"], "E": ["1C"]}}))
    aft, fore = simulation.observations.values()
    solution = tn.solve_baseline(aft, fore, simulation.navigation, length_m=1.0)
    integers = {}
    for name, sign in (("aft", -1), ("fore", 1)):
        truth = simulation.signal_truth[name]
        first = truth["time_ns"] == truth["time_ns"][0]
        for sat, signal, cycles in zip(
            truth["sat"][first], truth["signal"][first], truth["integer_cyc"][first], strict=True
        ):
            integers[sat, signal] = integers.get((sat, signal), 0) + sign * cycles
    rows = np.flatnonzero(solution.residual_epoch == 0)
    keys = [(int(solution.residual_sat[k]), int(solution.residual_signal[k])) for k in rows]
    assert len(rows) > 10
    for system in (0, 2):
        group = [k for k, key in enumerate(keys) if key[0] // 100 == system]
        reference = next(k for k in group if solution.residual_is_reference[rows[k]])
        for k in group:
            expected = integers[keys[k]] - integers[keys[reference]]
            assert solution.residual_integer_cyc[rows[k]] == expected


@pytest.mark.parametrize("block_epochs", [1, 7])
def test_what_comes_out_does_not_depend_on_the_block(block_epochs):
    receiver = {
        "tracking": {"slips_per_hour": 600.0},
        "multipath": {"gauss_markov": {"code_sd_m": 0.5, "phase_sd_m": 0.005}},
    }
    whole = simulate(pair(duration_s=20.0, receiver=receiver))
    parts = simulate(pair(duration_s=20.0, receiver=receiver), block_epochs=block_epochs)
    for name in whole.observations:
        for column in ("time_ns", "epoch_start", "sat", "signal", "code_m", "phase_cyc", "doppler_hz", "lli"):
            np.testing.assert_array_equal(
                getattr(parts.observations[name], column), getattr(whole.observations[name], column)
            )


def test_another_antenna_leaves_the_first_ones_alone():
    scenario = pair(duration_s=5.0)
    two = simulate(scenario)
    scenario["platform"]["antennas"].append({"name": "port", "position_body_m": [0.0, -1.0, 0.0]})
    three = simulate(scenario)
    np.testing.assert_array_equal(two.observations["fore"].phase_cyc, three.observations["fore"].phase_cyc)


def test_doppler_is_the_rate_of_the_phase():
    scenario = pair(
        receiver={
            **NOISELESS,
            "clock": {"drift_sps": 3e-7, "white_frequency": 0, "random_walk_frequency": 0},
        },
        environment={"ionosphere": "none", "troposphere": "none", "phase_windup": False},
        output={"quantise": False},
        interval_s=0.1,
        duration_s=3.0,
    )
    aft = simulate(scenario).observations["aft"]
    for sat in np.unique(aft.sat):
        rows = (aft.sat == sat) & (aft.signal == aft.signal[aft.sat == sat][0])
        phase, doppler = aft.phase_cyc[rows], aft.doppler_hz[rows]
        # Central differences over 0.2 s: the third derivative leaves 1e-6 Hz, rounding of 1e8 cycles 3e-7 Hz.
        np.testing.assert_allclose(-(phase[2:] - phase[:-2]) / 0.2, doppler[1:-1], rtol=0, atol=1e-5)


def test_reflected_rays_are_those_of_two_phasors():
    from truenorth.simulation.multipath import reflected_ray

    path = np.linspace(0.0, 4.0, 400)
    amplitude = np.full(400, 0.4)
    wavelength = np.full(400, 0.19)
    code, phase, fading = reflected_ray(path, amplitude, wavelength, np.full(400, 293.0), 0.5)
    phasor = 1.0 + 0.4 * np.exp(1j * (2 * np.pi * path / 0.19 + np.pi))
    np.testing.assert_allclose(phase, 0.19 / (2 * np.pi) * np.angle(phasor), atol=1e-12)
    np.testing.assert_allclose(fading, 20 * np.log10(np.abs(phasor)), atol=1e-9)
    # Extremes of Braasch 1996: arcsin(a) of a turn; a d / (1 +- a).
    assert np.max(np.abs(phase)) <= 0.19 / (2 * np.pi) * np.arcsin(0.4) + 1e-9
    assert np.all(code <= 0.4 * path / 1.4 + 1e-9)
    assert np.all(code >= -0.4 * path / 0.6 - 1e-9)


def test_a_far_reflector_does_not_reach_the_code():
    from truenorth.simulation.multipath import reflected_ray

    far = np.array([293.0 * 1.3])
    code, _, _ = reflected_ray(far, np.array([0.3]), np.array([0.19]), np.array([293.0]), 0.5)
    assert code[0] == 0.0


def test_ground_multipath_differs_between_antennas_and_lasts():
    ground = {"name": "ground", "distance_m": 2.0, "coefficient": 0.3}
    scenario = pair(
        duration_s=60.0, receiver={**NOISELESS, "back_loss_db": 6.0, "multipath": {"reflectors": [ground]}}
    )
    simulation = simulate(scenario)
    sat = _high_satellite(simulation)
    aft = simulation.signal_truth["aft"]
    errors = aft["phase_multipath_m"][_of(simulation.observations["aft"], sat, "1C")]
    assert 0.0 < np.max(np.abs(errors)) < 0.19 / 4
    # The geometry turns in minutes, not in seconds.
    assert np.corrcoef(errors[1:], errors[:-1])[0, 1] > 0.99


def test_faults_on_schedule():
    simulation = simulate(pair(duration_s=2.0))
    sat = _high_satellite(simulation)
    faults = [
        {"kind": "slip", "antenna": "fore", "time_s": 10.0, "satellite": sat, "signal": "1C", "cycles": 3},
        {"kind": "blunder", "antenna": "fore", "start_s": 12, "end_s": 14, "satellite": sat, "code_m": 50.0},
        {"kind": "lost", "antenna": "fore", "start_s": 15.0, "end_s": 18.0, "satellite": sat},
        {"kind": "dead", "antenna": "aft", "start_s": 25.0},
    ]
    clean = simulate(pair(duration_s=30.0))
    broken = simulate(pair(duration_s=30.0, faults=faults))
    fore, truth = broken.observations["fore"], broken.signal_truth["fore"]
    rows = _of(fore, sat, "1C")
    epoch = fore.epoch_of_row[rows]
    np.testing.assert_array_equal(truth["slip_cyc"][rows][epoch < 10], 0.0)
    np.testing.assert_array_equal(truth["slip_cyc"][rows][(epoch >= 10) & (epoch < 15)], 3.0)
    assert not np.any(fore.lli[rows][(epoch > 8) & (epoch < 14)] & LLI_SLIP), "a fault does not say itself"
    assert set(range(15, 18)).isdisjoint(epoch), "lost"
    # 1 s to the code and 3 s to the phase after the satellite is back.
    back = epoch >= 18
    assert epoch[back][0] == 19
    has_phase = np.isfinite(fore.phase_cyc[rows])
    assert epoch[back & has_phase][0] == 21
    assert fore.lli[rows][epoch == 21][0] & LLI_SLIP
    np.testing.assert_array_equal(truth["code_fault_m"][rows][(epoch >= 12) & (epoch < 14)], 50.0)
    assert broken.observations["aft"].n_epochs == 25
    before = clean.observations["fore"].phase_cyc[_of(clean.observations["fore"], sat, "1C")][:15]
    np.testing.assert_allclose(fore.phase_cyc[rows][:10], before[:10], rtol=0, atol=1e-9)
    np.testing.assert_allclose(fore.phase_cyc[rows][10:15] - before[10:15], 3.0, rtol=0, atol=1e-6)


def test_half_cycles_are_flagged_until_the_receiver_knows():
    simulation = simulate(pair(duration_s=2.0))
    sat = _high_satellite(simulation)
    lost = {"kind": "lost", "antenna": "fore", "start_s": 3.0, "end_s": 5.0, "satellite": sat}
    tracking = {"half_cycle_s": 6.0, "half_cycle_share": 1.0}
    simulation = simulate(pair(duration_s=25.0, receiver={"tracking": tracking}, faults=[lost]))
    fore, truth = simulation.observations["fore"], simulation.signal_truth["fore"]
    rows = _of(fore, sat, "1C") & (fore.epoch_of_row >= 8)
    flagged = (fore.lli[rows] & LLI_HALF_CYCLE) > 0
    np.testing.assert_array_equal(truth["half_cyc"][rows] == 0.5, flagged)
    assert np.count_nonzero(flagged) == 6
    assert fore.lli[rows][6] & LLI_SLIP, "taking the half cycle off is a slip"


def test_millisecond_jumps_move_codes_by_light_milliseconds():
    clock = {"offset_s": 4.99e-4, "offset_sd_s": 0.0, "drift_sps": 1e-6, "jump_s": 0.001, "jump_phase": False}
    simulation = simulate(pair(receiver={**NOISELESS, "clock": clock}))
    offset = simulation.truth["clock_offset_s:aft"]
    assert np.all(np.abs(offset) <= 5.1e-4)
    jump = int(np.argmin(np.diff(offset)))
    assert np.diff(offset)[jump] == pytest.approx(-0.001, abs=2e-6)
    aft = simulation.observations["aft"]
    rows = _of(aft, _high_satellite(simulation), "1C")
    code_step, phase_step = np.diff(aft.code_m[rows]), np.diff(aft.phase_cyc[rows])
    others = np.delete(code_step, jump)
    assert code_step[jump] - np.median(others) == pytest.approx(-SPEED_OF_LIGHT_MPS * 0.001, abs=5.0)
    # The phase only feels that the satellite moved for a millisecond more.
    assert abs(phase_step[jump] - np.median(phase_step)) < 50.0


def test_a_common_oscillator_is_one_clock():
    scenario = pair(receiver={"clock": {"oscillator": "rubidium"}})
    truth = simulate(scenario).truth
    np.testing.assert_array_equal(truth["clock_offset_s:aft"], truth["clock_offset_s:fore"])


def test_fewer_channels_keep_the_highest_satellites():
    simulation = simulate(
        pair(duration_s=2.0, receiver={"channels": 6, "signals": {"G": ["1C"], "E": ["1C"]}})
    )
    aft = simulation.observations["aft"]
    everything = simulate(pair(duration_s=2.0, receiver={"signals": {"G": ["1C"], "E": ["1C"]}}))
    truth = everything.signal_truth["aft"]
    first = truth["time_ns"] == truth["time_ns"][0]
    highest = truth["sat"][first][np.argsort(-truth["elevation_rad"][first])][:6]
    assert set(aft.sat[aft.epoch_of_row == 0]) == set(highest)


def test_time_tags_stand_where_they_are_put():
    simulation = simulate(pair(duration_s=2.0, receiver={"tag_offset_s": 0.001}))
    assert set(simulation.observations["aft"].time_ns % 10**9) == {1_000_000}


def test_flexure_bends_the_array():
    flexure = {"amplitude_m": [0.0, 0.0, 0.02], "reference_m": 1.0, "period_s": 10.0}
    scenario = pair(duration_s=20.0)
    scenario["platform"]["flexure"] = flexure
    truth = simulate(scenario).truth
    bent = truth["antenna_ecef_m:fore"] - truth["antenna_ecef_m:aft"]
    rigid = simulate(pair(duration_s=20.0)).truth
    swing = bent - (rigid["antenna_ecef_m:fore"] - rigid["antenna_ecef_m:aft"])
    assert np.max(np.linalg.norm(swing, axis=1)) == pytest.approx(0.02, rel=0.06)


def test_oguz_phases_know_no_clocks_and_no_atmosphere():
    scenario = pair(environment={"signal_model": "oguz_2006"}, receiver=NOISELESS, output={"quantise": False})
    simulation = simulate(scenario)
    aft, truth = simulation.observations["aft"], simulation.signal_truth["aft"]
    wavelength = SPEED_OF_LIGHT_MPS / frequency_hz(aft.sat, aft.signal, aft.glonass_channel)
    np.testing.assert_allclose(
        aft.phase_cyc, truth["range_m"] / wavelength + truth["integer_cyc"], rtol=0, atol=1e-6
    )


def test_orbits_are_taken_at_the_time_of_emission():
    """The range is the path of light in an inertial frame, for which the Earth turns under the satellite."""
    scenario = read_scenario(
        pair(receiver=NOISELESS, environment={"ionosphere": "none", "troposphere": "none"}, duration_s=1.0)
    )
    simulator = Simulator(scenario)
    block = next(simulator.blocks())
    truth = block.antennas["aft"].truth
    first = truth["time_ns"] == scenario.start_ns
    sat, distance = truth["sat"][first], truth["range_m"][first]
    received_s = -block.antennas["aft"].clock_offset_s[0]
    emitted_s = received_s - distance / SPEED_OF_LIGHT_MPS
    position, *_ = simulator.sky.true_states(sat, np.full(len(sat), scenario.start_ns), -emitted_s)

    def inertial(ecef, time_s):
        angle = 7.2921151467e-5 * np.asarray(time_s)
        c, s = np.cos(angle), np.sin(angle)
        x, y, z = np.moveaxis(np.atleast_2d(ecef), -1, 0)
        return np.stack([c * x - s * y, s * x + c * y, np.broadcast_to(z, x.shape)], axis=-1)

    here = inertial(block.antennas["aft"].position_ecef_m[0], received_s)
    there = inertial(position, emitted_s)
    np.testing.assert_allclose(np.linalg.norm(there - here, axis=1), distance, rtol=0, atol=2e-6)
