"""Choice of ephemerides, broadcast orbits against a readable twin, transmission, group delays."""

import numpy as np
import pytest

from rinex_nav_text import kepler_row
from truenorth._kernels import orbits as kernels
from truenorth.constants import FREQUENCY_HZ, SPEED_OF_LIGHT_MPS
from truenorth.navigation import KEPLER_COLUMNS, MessageType, build_navigation
from truenorth.observations import sat_id, signal_id
from truenorth.orbits import (
    ORBIT_STATUS_SENTENCES,
    OrbitStatus,
    compute_satellite_states,
    compute_transmission_states,
    group_delay_s,
    health_ok,
    select_ephemerides,
)
from truenorth.orbits.selection import STATE_WINDOW_S, WINDOW_S
from truenorth.timescales import BDT_OFFSET_NS, NS_PER_S, NS_PER_WEEK, parse_gpst

TOE = parse_gpst("2024-06-24T10:00:00")
HOUR = 3600 * NS_PER_S
G05, E11, C03, C30, J02, R03, S21 = (sat_id(n) for n in ("G05", "E11", "C03", "C30", "J02", "R03", "S21"))


def glonass_row(sat=R03, toe_ns=TOE, *, health=0, channel=-4, delta_tau=0.0):
    states = [10_390_480.0, -3_906_960.0, 22_971_850.0, 313.5, 3129.0, 392.0, 1e-6, -9e-7, -1.9e-6]
    return (sat, toe_ns, toe_ns, channel, health, [*states, 1.6e-4, 9.1e-13, delta_tau])


def test_kernel_codes_are_those_of_the_public_status():
    for name in ("OK", "NO_EPHEMERIS", "TOO_OLD", "UNHEALTHY", "NOT_COMPUTABLE"):
        assert getattr(kernels, name) == OrbitStatus[name]
    assert set(ORBIT_STATUS_SENTENCES) == set(OrbitStatus)


def textbook_position(row, t_ns, gm, omega_e):
    """IS-GPS-200 table 20-IV as one would write it on paper; BeiDou GEO by rotation matrices."""
    sat, message, toe_ns, toc_ns = row[:4]
    el = dict(zip(KEPLER_COLUMNS, row[-1], strict=True))
    tk = (t_ns - toe_ns) / NS_PER_S
    toe_sow = ((toe_ns - (BDT_OFFSET_NS if sat // 100 == 3 else 0)) % NS_PER_WEEK) / NS_PER_S
    a0 = el["sqrt_a"] ** 2
    a = a0 + el["a_dot_mps"] * tk
    n = np.sqrt(gm / a0**3) + el["delta_n_radps"] + 0.5 * el["delta_n_dot_radps2"] * tk
    m = el["m0_rad"] + n * tk
    e = el["eccentricity"]
    ea = m
    for _ in range(200):
        ea = m + e * np.sin(ea)
    nu = 2.0 * np.arctan2(np.sqrt(1 + e) * np.sin(ea / 2), np.sqrt(1 - e) * np.cos(ea / 2))
    phi = nu + el["omega_rad"]
    s2, c2 = np.sin(2 * phi), np.cos(2 * phi)
    u = phi + el["cus_rad"] * s2 + el["cuc_rad"] * c2
    r = a * (1 - e * np.cos(ea)) + el["crs_m"] * s2 + el["crc_m"] * c2
    i = el["i0_rad"] + el["idot_radps"] * tk + el["cis_rad"] * s2 + el["cic_rad"] * c2
    is_geo = sat in (C03,) and message in (MessageType.D1, MessageType.D2)
    rate = el["omega_dot_radps"] - (0.0 if is_geo else omega_e)
    node = el["omega0_rad"] + rate * tk - omega_e * toe_sow

    def rot_z(x):
        return np.array([[np.cos(x), np.sin(x), 0], [-np.sin(x), np.cos(x), 0], [0, 0, 1]])

    def rot_x(x):
        return np.array([[1, 0, 0], [0, np.cos(x), np.sin(x)], [0, -np.sin(x), np.cos(x)]])

    position = rot_z(-node) @ rot_x(-i) @ rot_z(-u) @ np.array([r, 0.0, 0.0])
    if is_geo:
        position = rot_z(omega_e * tk) @ rot_x(np.radians(-5.0)) @ position
    dt = (t_ns - toc_ns) / NS_PER_S
    clock = el["af0_s"] + el["af1_sps"] * dt + el["af2_sps2"] * dt**2
    clock -= 2.0 * np.sqrt(gm * a0) * e * np.sin(ea) / SPEED_OF_LIGHT_MPS**2
    return position, clock


@pytest.mark.parametrize(
    ("sat", "message", "gm", "omega_e"),
    [
        (G05, MessageType.LNAV, 3.986005e14, 7.2921151467e-5),
        (G05, MessageType.CNAV, 3.986005e14, 7.2921151467e-5),
        (E11, MessageType.INAV, 3.986004418e14, 7.2921151467e-5),
        (C30, MessageType.D1, 3.986004418e14, 7.292115e-5),
        (C03, MessageType.D2, 3.986004418e14, 7.292115e-5),
        (C30, MessageType.CNV1, 3.986004418e14, 7.292115e-5),
        (J02, MessageType.LNAV, 3.986005e14, 7.2921151467e-5),
    ],
)
def test_orbit_and_clock_against_the_textbook(sat, message, gm, omega_e):
    modern = {"a_dot_mps": -3.8e-3, "delta_n_dot_radps2": -3.8e-14} if message in (1, 7) else {}
    row = kepler_row(sat, TOE, message=message, af2_sps2=1e-18, **modern)
    navigation = build_navigation([row])
    for offset_ns in (-HOUR - 7, 0, 123_456_789, HOUR):
        states = compute_satellite_states(navigation, [sat], TOE + offset_ns)
        position, clock = textbook_position(row, TOE + offset_ns, gm, omega_e)
        # Rounding of doubles at 27 000 km is a few nanometres an operation.
        np.testing.assert_allclose(states.position_ecef_m[0], position, rtol=0, atol=1e-6)
        np.testing.assert_allclose(states.clock_s[0], clock, rtol=0, atol=1e-17)
        assert states.status[0] == OrbitStatus.OK


@pytest.mark.parametrize("sat", [G05, E11, C30, C03, J02, R03, S21])
def test_velocity_is_the_derivative_of_the_position(sat):
    if sat in (R03, S21):
        navigation = build_navigation([], [glonass_row(sat)])
    else:
        message = MessageType.D2 if sat == C03 else MessageType.LNAV
        modern = {"a_dot_mps": -3.8e-3, "delta_n_dot_radps2": -3.8e-14}
        navigation = build_navigation([kepler_row(sat, TOE, message=message, **modern)])
    at = TOE + np.array([-300, -59, 0, 61, 300]) * NS_PER_S
    step_ns = 50_000_000

    def position(shift):
        return compute_satellite_states(navigation, [sat] * 5, at + shift).position_ecef_m

    difference = (position(step_ns) - position(-step_ns)) / (2e-9 * step_ns)
    velocity = compute_satellite_states(navigation, [sat] * 5, at).velocity_ecef_mps
    assert np.linalg.norm(velocity, axis=1).min() > 300.0
    # 4 nm of rounding over 0.1 s, and the third derivative; at whole steps the GLONASS integration
    # changes its nodes by its own truncation error.
    np.testing.assert_allclose(velocity, difference, rtol=0, atol=5e-6)


@pytest.mark.parametrize("sat", [G05, C03, R03])
def test_clock_drift_is_the_derivative_of_the_clock(sat):
    if sat == R03:
        navigation = build_navigation([], [glonass_row()])
    else:
        row = kepler_row(sat, TOE, message=6 if sat == C03 else 0, eccentricity=0.02, af2_sps2=1e-17)
        navigation = build_navigation([row])
    at = TOE + np.array([-600, 1, 600]) * NS_PER_S

    def clock(shift):
        return compute_satellite_states(navigation, [sat] * 3, at + shift).clock_s

    drift = compute_satellite_states(navigation, [sat] * 3, at).clock_drift_sps
    # The clock (1e-4 s) is rounded to 1e-20 s; 20 s is short against the revolution.
    difference = (clock(10 * NS_PER_S) - clock(-10 * NS_PER_S)) / 20.0
    np.testing.assert_allclose(drift, difference, rtol=0, atol=1e-16)


def test_glonass_energy_of_the_inertial_motion():
    """Without the lunisolar accelerations the Jacobi integral of the equations of motion is constant."""
    row = glonass_row()
    row[-1][6:9] = [0.0, 0.0, 0.0]
    navigation = build_navigation([], [row])
    at = TOE + np.arange(-900, 901, 100) * NS_PER_S
    states = compute_satellite_states(navigation, np.full(len(at), R03), at)
    r = np.linalg.norm(states.position_ecef_m, axis=1)
    x, y, z = states.position_ecef_m.T
    gm, re, j2, omega = 398_600.4418e9, 6_378_136.0, 1_082_625.75e-9, 7.292115e-5
    potential = -gm / r + gm * j2 * re**2 / (2 * r**3) * (3 * z**2 / r**2 - 1)
    kinetic = 0.5 * np.sum(states.velocity_ecef_mps**2, axis=1)
    jacobi = kinetic + potential - 0.5 * omega**2 * (x**2 + y**2)
    # Fifteen steps of 60 s leave 5e-5 m^2/s^2, or 2e-8 m/s; the oblateness alone is some 1e3.
    np.testing.assert_allclose(jacobi, jacobi[9], rtol=0, atol=1e-4)


def test_the_order_of_rows_does_not_change_glonass():
    navigation = build_navigation([], [glonass_row(), glonass_row(R03 + 1)])
    rng = np.random.default_rng(1)
    at = TOE + rng.integers(-1700, 1700, 200) * NS_PER_S
    sat = np.where(rng.random(200) < 0.5, R03, R03 + 1)
    mixed = compute_satellite_states(navigation, sat, at)
    order = np.lexsort([at, sat])
    in_order = compute_satellite_states(navigation, sat[order], at[order])
    np.testing.assert_array_equal(mixed.position_ecef_m[order], in_order.position_ecef_m)
    np.testing.assert_array_equal(mixed.velocity_ecef_mps[order], in_order.velocity_ecef_mps)


@pytest.mark.parametrize("sat", [G05, C03, R03])
def test_transmission_solves_its_equation(sat):
    if sat == R03:
        navigation = build_navigation([], [glonass_row()])
    else:
        navigation = build_navigation(
            [kepler_row(sat, TOE, message=6 if sat == C03 else 0, eccentricity=0.02)]
        )
    tag = TOE + 600 * NS_PER_S
    code_m = 2.2e7
    sent = compute_transmission_states(navigation, [sat], tag, [code_m])
    t_tx_ns = tag - round((code_m / SPEED_OF_LIGHT_MPS + sent.clock_s[0]) * 1e9)
    there = compute_satellite_states(navigation, [sat], t_tx_ns)
    # Half a nanosecond of rounding is 2 micrometres of flight.
    np.testing.assert_allclose(sent.position_ecef_m, there.position_ecef_m, rtol=0, atol=3e-6)
    np.testing.assert_allclose(sent.velocity_ecef_mps, there.velocity_ecef_mps, rtol=0, atol=1e-6)
    np.testing.assert_allclose(sent.clock_s, there.clock_s, rtol=0, atol=1e-17)


def test_a_receiver_clock_offset_cancels_in_the_time_of_transmission():
    navigation = build_navigation([kepler_row(G05, TOE)])
    late_ns = 2_000_000
    good = compute_transmission_states(navigation, [G05], TOE, [2.2e7])
    late = compute_transmission_states(
        navigation, [G05], TOE + late_ns, [2.2e7 + late_ns * 1e-9 * SPEED_OF_LIGHT_MPS]
    )
    np.testing.assert_allclose(late.position_ecef_m, good.position_ecef_m, rtol=0, atol=1e-6)


def test_no_code_no_state():
    navigation = build_navigation([kepler_row(G05, TOE)])
    states = compute_transmission_states(navigation, [G05, G05, E11], TOE, [np.nan, 2.2e7, np.nan])
    assert list(states.status) == [OrbitStatus.NO_CODE, OrbitStatus.OK, OrbitStatus.NO_EPHEMERIS]
    assert np.isnan(states.position_ecef_m[0]).all()
    assert np.isnan(states.clock_s[0])
    assert np.isfinite(states.position_ecef_m[1]).all()


def test_statuses_of_absent_old_and_unhealthy_satellites():
    navigation = build_navigation(
        [kepler_row(G05, TOE), kepler_row(G05 + 1, TOE, health=63)], [glonass_row(health=1)]
    )
    sats = [G05, G05, G05 + 1, R03, E11, 9999, -4]
    times = TOE + np.array([0, 2 * HOUR + 2 * NS_PER_S, 0, 0, 0, 0, 0])
    states = compute_satellite_states(navigation, sats, times)
    wanted = [
        OrbitStatus.OK,
        OrbitStatus.TOO_OLD,
        OrbitStatus.UNHEALTHY,
        OrbitStatus.UNHEALTHY,
        OrbitStatus.NO_EPHEMERIS,
        OrbitStatus.NO_EPHEMERIS,
        OrbitStatus.NO_EPHEMERIS,
    ]
    assert list(states.status) == wanted
    assert list(states.ephemeris_index) == [0, -1, 1, 2, -1, -1, -1]
    assert list(states.healthy) == [True, False, False, False, False, False, False]
    bad = states.status != OrbitStatus.OK
    assert np.isnan(states.position_ecef_m[bad]).all()
    assert np.isfinite(states.position_ecef_m[~bad]).all()
    assert states.ura_m[0] == 2.0
    assert np.isnan(states.ura_m[3])
    asked = compute_satellite_states(navigation, sats[2:4], TOE, include_unhealthy=True)
    assert list(asked.status) == [OrbitStatus.OK, OrbitStatus.OK]
    assert list(asked.healthy) == [False, False]
    assert np.isfinite(asked.position_ecef_m).all()


def test_nothing_in_nothing_out():
    empty = build_navigation()
    assert len(compute_satellite_states(empty, [], 0)) == 0
    states = compute_transmission_states(empty, [G05], TOE, [2.2e7])
    assert list(states.status) == [OrbitStatus.NO_EPHEMERIS]
    assert np.isnan(group_delay_s(empty, [-1], [G05], [signal_id("1C")]))[0]


@pytest.mark.parametrize("letter", ["G", "J", "E", "C", "I", "R", "S"])
def test_windows(letter):
    sat = sat_id(f"{letter}05") if letter != "C" else sat_id("C30")
    if letter in "RS":
        navigation, window = build_navigation([], [glonass_row(sat)]), STATE_WINDOW_S[letter]
    else:
        row = kepler_row(sat, TOE, fit_interval_s=3600.0)
        navigation, window = build_navigation([row]), WINDOW_S[letter]
    edge = int(window) * NS_PER_S
    at = TOE + np.array([-edge - 2 * NS_PER_S, -edge, edge, edge + 2 * NS_PER_S])
    status = select_ephemerides(navigation, [sat] * 4, at)[1]
    assert list(status) == [OrbitStatus.TOO_OLD, OrbitStatus.OK, OrbitStatus.OK, OrbitStatus.TOO_OLD]


def test_a_longer_fit_interval_widens_the_window():
    navigation = build_navigation([kepler_row(G05, TOE, fit_interval_s=6 * 3600.0)])
    index, _ = select_ephemerides(navigation, [G05, G05], TOE + np.array([3 * HOUR, 3 * HOUR + 2 * NS_PER_S]))
    assert list(index) == [0, -1]


def test_nearest_reference_time_and_the_upload_that_cuts_in():
    rows = [
        kepler_row(G05, TOE, sent_ns=TOE - 2 * HOUR, iode=1),
        kepler_row(G05, TOE - 16 * NS_PER_S, sent_ns=TOE - HOUR, iode=2),
        kepler_row(G05, TOE + 2 * HOUR, sent_ns=TOE, iode=3),
    ]
    navigation = build_navigation(rows)
    at = TOE + np.array([-HOUR, 0, HOUR // 2, HOUR + 60 * NS_PER_S, 2 * HOUR])
    index, status = select_ephemerides(navigation, [G05] * 5, at)
    assert list(navigation.kepler.iode[index]) == [2, 2, 2, 3, 3]
    assert not status.any()


def test_two_receivers_with_tags_around_a_switch_choose_alike():
    rows = [kepler_row(G05, TOE, iode=1), kepler_row(G05, TOE + 2 * HOUR, iode=2)]
    navigation = build_navigation(rows)
    for switch in (TOE + HOUR, TOE - 2 * HOUR, TOE + 4 * HOUR):
        tags = switch + np.array([-9_000_000, -1, 0, 1, 2_000_000])
        index, _ = select_ephemerides(navigation, [G05] * 5, tags)
        assert len(set(index)) == 1


def test_preferred_messages_and_their_stand_in():
    rows = [
        kepler_row(E11, TOE, message=MessageType.FNAV, iode=1),
        kepler_row(E11, TOE - HOUR, message=MessageType.INAV, iode=2),
        kepler_row(E11 + 1, TOE, message=MessageType.FNAV, iode=3),
        kepler_row(C30, TOE, message=MessageType.CNV2, iode=4),
        kepler_row(C30, TOE, message=MessageType.CNV1, iode=5),
        kepler_row(C30, TOE + HOUR, message=MessageType.D1, iode=6),
    ]
    navigation = build_navigation(rows)
    sats = [E11, E11, E11 + 1, C30, C30]
    at = TOE + np.array([0, 3 * HOUR + 2 * NS_PER_S, 0, 0, -HOUR - 2 * NS_PER_S])
    index, _ = select_ephemerides(navigation, sats, at)
    assert list(navigation.kepler.iode[index]) == [2, 1, 3, 6, 5]


def test_a_given_ephemeris_is_used_and_checked():
    navigation = build_navigation([kepler_row(G05, TOE), kepler_row(G05, TOE + 2 * HOUR, m0_rad=1.0)])
    first = compute_satellite_states(navigation, [G05], TOE + 2 * HOUR, ephemeris=[0])
    assert first.ephemeris_index[0] == 0
    chosen = compute_satellite_states(navigation, [G05], TOE + 2 * HOUR)
    assert np.linalg.norm(first.position_ecef_m - chosen.position_ecef_m) > 1e6
    none = compute_satellite_states(navigation, [G05], TOE, ephemeris=[-1])
    assert none.status[0] == OrbitStatus.NO_EPHEMERIS
    with pytest.raises(ValueError, match="does not fit"):
        compute_satellite_states(navigation, [G05], TOE, ephemeris=[2])
    with pytest.raises(ValueError, match="does not fit"):
        compute_satellite_states(navigation, [G05], TOE, ephemeris=[0, 1])
    glonass = build_navigation([], [glonass_row()])
    far = compute_satellite_states(glonass, [R03], TOE + 1000 * 24 * HOUR, ephemeris=[0])
    assert far.status[0] == OrbitStatus.NOT_COMPUTABLE
    assert np.isnan(far.position_ecef_m).all()


def test_an_orbit_that_is_not_finite_is_said():
    navigation = build_navigation(
        [kepler_row(G05, TOE, eccentricity=1.5), kepler_row(G05 + 1, TOE, crs_m=np.inf)]
    )
    states = compute_satellite_states(navigation, [G05, G05 + 1], TOE + HOUR)
    assert list(states.status) == [OrbitStatus.NOT_COMPUTABLE] * 2
    assert np.isnan(states.position_ecef_m).all()
    assert np.isnan(states.clock_s).all()


@pytest.mark.parametrize(
    ("name", "message", "health", "ok"),
    [
        ("G05", MessageType.LNAV, 0, True),
        ("G05", MessageType.LNAV, 63, False),
        ("G05", MessageType.CNAV, 0b001, True),  # L5 not yet declared healthy
        ("G05", MessageType.CNAV, 0b100, False),
        ("J02", MessageType.LNAV, 0b000001, True),  # sends L1C/A, not L1C/B
        ("J04", MessageType.LNAV, 0b010000, True),  # the other way round
        ("J04", MessageType.LNAV, 0b110000, False),
        ("E14", MessageType.INAV, 130, False),
        ("C30", MessageType.D1, 1, False),
        ("R03", MessageType.LNAV, 1, False),
        ("S21", MessageType.LNAV, 63, False),
        ("S21", MessageType.LNAV, 0x20, True),
    ],
)
def test_health_words(name, message, health, ok):
    assert bool(health_ok(np.array([sat_id(name)]), np.array([message]), np.array([health]))[0]) is ok


def delay(navigation, index, name, signal):
    return float(group_delay_s(navigation, [index], [sat_id(name)], [signal_id(signal)])[0])


def ratio(letter, band, reference):
    code = "GRECJIS".index(letter)
    return (FREQUENCY_HZ[code, reference] / FREQUENCY_HZ[code, band]) ** 2


def test_group_delay_of_gps_qzss_navic():
    i05 = sat_id("I05")
    navigation = build_navigation([kepler_row(s, TOE, tgd_s=-1e-8) for s in (G05, J02, i05)])
    assert delay(navigation, 0, "G05", "1C") == -1e-8
    np.testing.assert_allclose(delay(navigation, 0, "G05", "2W"), -1e-8 * (77 / 60) ** 2, rtol=1e-14)
    np.testing.assert_allclose(delay(navigation, 1, "J02", "5Q"), -1e-8 * (154 / 115) ** 2, rtol=1e-14)
    assert delay(navigation, 2, "I05", "9C") == -1e-8
    np.testing.assert_allclose(delay(navigation, 2, "I05", "5A"), -1e-8 * ratio("I", 5, 9), rtol=1e-14)


@pytest.mark.parametrize(("message", "own", "other"), [(MessageType.INAV, 7, 5), (MessageType.FNAV, 5, 7)])
def test_group_delays_of_galileo_agree_with_their_definition(message, own, other):
    bgd = {5: -3.7e-9, 7: -4.6e-9}
    navigation = build_navigation([kepler_row(E11, TOE, message=message, tgd_s=bgd[5], tgd2_s=bgd[7])])
    got = {band: delay(navigation, 0, "E11", f"{band}X") for band in (1, 5, 7)}
    for band in (5, 7):
        # BGD = (T1 - T) / (1 - (f1 / f)^2) for both pairs, whatever clock the message has.
        np.testing.assert_allclose((got[1] - got[band]) / (1 - ratio("E", band, 1)), bgd[band], rtol=1e-12)
    # The clock's own combination is free of delay.
    gamma = ratio("E", own, 1)
    np.testing.assert_allclose((gamma * got[1] - got[own]) / (gamma - 1), 0.0, atol=1e-22)
    assert got[other] != 0.0
    assert delay(navigation, 0, "E11", "6C") == 0.0


def test_group_delays_of_beidou_come_from_the_message_that_has_them():
    rows = [
        kepler_row(C30, TOE, message=MessageType.D1, tgd_s=8.4e-9, tgd2_s=-1.4e-9),
        kepler_row(C30, TOE + HOUR, message=MessageType.CNV1, tgd_s=9.5e-9, tgd2_s=1.2e-9),
        kepler_row(C30 + 1, TOE, message=MessageType.D1, tgd_s=8.4e-9, tgd2_s=-1.4e-9),
        kepler_row(C30 + 2, TOE, message=MessageType.CNV3, tgd_s=1.9e-9),
    ]
    navigation = build_navigation(rows)
    for index in (0, 1):
        wanted = {"2I": 8.4e-9, "7I": -1.4e-9, "6I": 0.0, "1P": 9.5e-9, "5P": 1.2e-9}
        assert {s: delay(navigation, index, "C30", s) for s in wanted} == wanted
    assert delay(navigation, 2, "C31", "1P") == 0.0
    assert delay(navigation, 3, "C32", "7D") == 1.9e-9


def test_group_delay_of_glonass_is_between_its_frequencies():
    navigation = build_navigation([kepler_row(G05, TOE)], [glonass_row(delta_tau=-1.5e-9)])
    assert delay(navigation, 1, "R03", "1C") == 0.0
    assert delay(navigation, 1, "R03", "2C") == -1.5e-9
