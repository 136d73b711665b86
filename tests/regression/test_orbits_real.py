"""Real navigation data: what the files hold, and how well ephemerides and messages agree with each other.

No sample has broadcast data of the day of the SP3 sample (2023-08-27), so broadcast orbits cannot be
compared with precise ones here; the agreement between successive ephemerides, and between the messages
that a satellite sends at the same time, shows the same errors except those common to both.
"""

from dataclasses import replace

import numpy as np
import pytest

from truenorth.constants import SPEED_OF_LIGHT_MPS, SYSTEMS
from truenorth.formats.rinex_nav import read_rinex_nav
from truenorth.formats.sp3 import read_sp3
from truenorth.navigation import MessageType, merge_navigation
from truenorth.observations import sat_id
from truenorth.orbits import (
    OrbitStatus,
    compute_satellite_states,
    compute_transmission_states,
    interpolate_precise,
)
from truenorth.timescales import NS_PER_S, parse_gpst

M = MessageType


@pytest.fixture(scope="module")
def full_day(data_dir):
    return read_rinex_nav(data_dir / "rinex_samples" / "BRD400DLR_S_20260680000_01D_MN.rnx.gz")


@pytest.fixture(scope="module")
def pair_1m(data_dir):
    return read_rinex_nav(data_dir / "pair_1m_geodetic" / "base.nav.gz")


@pytest.mark.parametrize(
    ("name", "n_kepler", "n_states", "systems", "leap"),
    [
        ("pair_1m_geodetic/base.nav.gz", 115, 19, "GRECJ", 18),
        ("pair_0.33m_ublox/rover.nav.gz", 14, 8, "GR", None),
        ("pair_38m_gps/brdc0770.11n", 194, 0, "G", 15),
        ("moving_simulator_rose/RINEX_EN_Spirent.23L.gz", 26, 0, "E", 18),
        ("moving_simulator_rose/RINEX_GN_Spirent.23N.gz", 31, 0, "G", 18),
        ("ubx_with_rinex/f9p_spirent_15min.nav.gz", 47, 0, "GE", None),
    ],
)
def test_what_the_files_hold(name, n_kepler, n_states, systems, leap, data_dir):
    navigation = read_rinex_nav(data_dir / name)
    assert (len(navigation.kepler), len(navigation.states)) == (n_kepler, n_states)
    sats = np.concatenate([navigation.kepler.sat, navigation.states.sat])
    assert {SYSTEMS[k] for k in np.unique(sats // 100)} == set(systems)
    assert navigation.leap_seconds == leap
    assert navigation.skipped == {}


def test_the_full_day_of_rinex_4(full_day):
    counts = dict(zip(*np.unique(full_day.kepler.message, return_counts=True), strict=True))
    # Records in the file, less those repeated with another time of transmission.
    for message, most in [
        (M.LNAV, 806), (M.CNAV, 414), (M.CNAV2, 83), (M.INAV, 2944), (M.FNAV, 2892), (M.D1, 963),
        (M.D2, 194), (M.CNV1, 1246), (M.CNV2, 2177), (M.CNV3, 700),
    ]:  # fmt: skip
        assert 0.3 * most < counts[message] <= most, message
    assert full_day.skipped == {"STO": 142, "EOP": 32, "ION C CNVX": 11, "ION J LNAV": 23, "ION J CNVX": 23}
    assert sorted(full_day.klobuchar) == ["C", "G", "I", "J"]
    again = merge_navigation(full_day, full_day)
    np.testing.assert_array_equal(again.kepler.elements, full_day.kepler.elements)
    np.testing.assert_array_equal(again.states.states, full_day.states.states)


def successive(navigation, system, message):
    """Two states at the middle between successive ephemerides of a satellite."""
    n_kepler = len(navigation.kepler)
    if message is None:
        table, offset = navigation.states, n_kepler
        rows = np.flatnonzero((table.sat // 100 == SYSTEMS.index(system)) & (table.health == 0))
    else:
        table, offset = navigation.kepler, 0
        rows = np.flatnonzero((table.sat // 100 == SYSTEMS.index(system)) & (table.message == message))
        rows = rows[table.health[rows] == 0]
    a, b = rows[:-1], rows[1:]
    gap_ns = table.toe_ns[b] - table.toe_ns[a]
    # Satellites whose ephemerides are hours apart have had a break, and so perhaps a manoeuvre.
    good = (table.sat[a] == table.sat[b]) & (gap_ns > 0) & (gap_ns <= 7200 * NS_PER_S)
    a, b = a[good], b[good]
    middle = (table.toe_ns[a] + table.toe_ns[b]) // 2
    return [
        compute_satellite_states(navigation, table.sat[rows], middle, ephemeris=rows + offset)
        for rows in (a, b)
    ]


@pytest.mark.parametrize(
    ("system", "message", "median_m", "p95_m", "velocity_mps"),
    # About twice what was measured.
    [
        ("G", M.LNAV, 0.6, 3.5, 0.001),
        ("E", M.INAV, 0.2, 0.9, 0.001),
        ("E", M.FNAV, 0.2, 0.9, 0.001),
        ("C", M.D1, 0.25, 0.8, 0.001),
        ("C", M.D2, 0.6, 5.0, 0.001),
        ("C", M.CNV1, 0.12, 0.3, 0.001),
        ("C", M.CNV2, 0.12, 0.3, 0.001),
        ("C", M.CNV3, 0.12, 0.3, 0.001),
        ("J", M.CNAV, 0.4, 1.2, 0.001),
        ("J", M.CNAV2, 0.4, 1.2, 0.001),
        ("R", None, 1.7, 3.0, 0.005),
    ],
)
def test_successive_ephemerides_agree(full_day, system, message, median_m, p95_m, velocity_mps):
    one, other = successive(full_day, system, message)
    assert len(one) > 50
    assert not one.status.any()
    assert not other.status.any()
    distance = np.linalg.norm(one.position_ecef_m - other.position_ecef_m, axis=1)
    assert np.median(distance) < median_m
    assert np.quantile(distance, 0.95) < p95_m
    speed = np.linalg.norm(one.velocity_ecef_mps - other.velocity_ecef_mps, axis=1)
    assert np.median(speed) < velocity_mps
    clock_m = np.abs(one.clock_s - other.clock_s) * SPEED_OF_LIGHT_MPS
    assert np.quantile(clock_m, 0.95) < 1.5


@pytest.mark.parametrize(
    ("system", "legacy", "modern", "orbit_m", "clock_m"),
    # 95 % of the differences. Clocks of messages differ by the delay between their reference signals.
    [
        ("G", M.LNAV, M.CNAV, 1.5, 0.5),
        ("E", M.INAV, M.FNAV, 0.01, 1.0),
        ("C", M.D1, M.CNV1, 0.25, 0.1),
        ("C", M.D1, M.CNV2, 0.25, 0.1),
        ("C", M.D1, M.CNV3, 0.25, 0.1),
        ("J", M.LNAV, M.CNAV, 0.7, 2.5),
        ("J", M.LNAV, M.CNAV2, 0.7, 2.5),
    ],
)
def test_messages_of_one_satellite_agree(full_day, system, legacy, modern, orbit_m, clock_m):
    kepler = full_day.kepler
    of_system = kepler.sat // 100 == SYSTEMS.index(system)
    old, new = (np.flatnonzero(of_system & (kepler.message == m)) for m in (legacy, modern))
    pairs = []
    for row in new:
        same = old[kepler.sat[old] == kepler.sat[row]]
        if len(same):
            nearest = same[np.argmin(np.abs(kepler.toe_ns[same] - kepler.toe_ns[row]))]
            if abs(kepler.toe_ns[nearest] - kepler.toe_ns[row]) <= 3600 * NS_PER_S:
                pairs.append((nearest, row))
    a, b = np.array(pairs).T
    middle = (kepler.toe_ns[a] + kepler.toe_ns[b]) // 2
    one, other = (
        compute_satellite_states(full_day, kepler.sat[rows], middle, ephemeris=rows, include_unhealthy=True)
        for rows in (a, b)
    )
    assert len(a) > 50
    distance = np.linalg.norm(one.position_ecef_m - other.position_ecef_m, axis=1)
    assert np.quantile(distance, 0.95) < orbit_m
    assert np.quantile(np.abs(one.clock_s - other.clock_s), 0.95) * SPEED_OF_LIGHT_MPS < clock_m


def test_velocities_of_real_ephemerides(pair_1m):
    sats = np.unique(np.concatenate([pair_1m.kepler.sat, pair_1m.states.sat]))
    at = parse_gpst("2024-06-24T08:22:30")
    step_ns = 50_000_000
    states = compute_satellite_states(pair_1m, sats, at)
    good = states.status == OrbitStatus.OK
    assert np.sum(good) > 60
    before, after = (
        compute_satellite_states(pair_1m, sats, at + shift, ephemeris=states.ephemeris_index).position_ecef_m
        for shift in (-step_ns, step_ns)
    )
    difference = (after - before)[good] / (2e-9 * step_ns)
    # Rounding of 4 nm over 0.1 s, and the truncation of the GLONASS steps.
    np.testing.assert_allclose(states.velocity_ecef_mps[good], difference, rtol=0, atol=5e-6)


def test_one_message_and_one_ephemeris_for_a_satellite_in_a_short_run(pair_1m):
    sats = np.unique(pair_1m.kepler.sat)
    at = parse_gpst("2024-06-24T08:20:00") + np.arange(301) * NS_PER_S
    code = np.full(301, 2.4e7)
    for sat in sats:
        base = compute_transmission_states(pair_1m, np.full(301, sat), at, code)
        rover = compute_transmission_states(pair_1m, np.full(301, sat), at + 1_900_000, code + 5e5)
        np.testing.assert_array_equal(base.ephemeris_index, rover.ephemeris_index)
        used = base.ephemeris_index[base.ephemeris_index >= 0]
        assert len(np.unique(pair_1m.kepler.message[used])) <= 1
    galileo = sat_id("E11")
    chosen = compute_satellite_states(pair_1m, [galileo], at[0]).ephemeris_index[0]
    assert pair_1m.kepler.message[chosen] == M.INAV


def test_sp3_with_every_second_epoch_left_out(data_dir):
    orbits = read_sp3(data_dir / "rinex_samples" / "ESA0OPSRAP_20232390000_01D_15M_ORB.SP3.gz")
    assert (orbits.n_epochs, orbits.n_sats) == (96, 54)
    thinned = replace(
        orbits,
        time_ns=orbits.time_ns[::2],
        position_ecef_m=orbits.position_ecef_m[::2],
        clock_s=orbits.clock_s[::2],
    )
    # At the ends the nodes are on one side.
    epoch, column = np.meshgrid(np.arange(13, 84, 2), np.arange(54), indexing="ij")
    at, sat = orbits.time_ns[epoch.ravel()], orbits.sat[column.ravel()]
    position, velocity, clock, _, status = interpolate_precise(thinned, sat, at)
    assert not status.any()
    error = np.linalg.norm(position - orbits.position_ecef_m[epoch, column].reshape(-1, 3), axis=1)
    # Nodes 30 min apart, twice the spacing of the file: centimetres. At the full spacing the error is
    # smaller by 2^11, and what is left is the rounding of the file to 1 mm.
    assert np.quantile(error, [0.5, 0.99]) == pytest.approx([0.006, 0.06], abs=0.03)
    assert error.max() < 0.15
    _, full_velocity, full_clock, _, _ = interpolate_precise(orbits, sat, at)
    np.testing.assert_allclose(velocity, full_velocity, rtol=0, atol=1e-4)
    # Linear clocks over 30 min: the worst satellite clock wanders by 17 m, most by centimetres.
    assert np.quantile(np.abs(clock - full_clock), 0.5) < 1e-9


def test_sp3_velocity_is_the_derivative(data_dir):
    orbits = read_sp3(data_dir / "rinex_samples" / "ESA0OPSRAP_20232390000_01D_15M_ORB.SP3.gz")
    sat = np.repeat(orbits.sat, 5)
    at = np.tile(orbits.time_ns[[10, 30, 50, 70, 90]] + 217 * NS_PER_S, orbits.n_sats)
    step_ns = 50_000_000
    before, after = (interpolate_precise(orbits, sat, at + shift)[0] for shift in (-step_ns, step_ns))
    velocity = interpolate_precise(orbits, sat, at)[1]
    np.testing.assert_allclose(velocity, (after - before) / (2e-9 * step_ns), rtol=0, atol=3e-6)
