"""Single-point position and velocity where the truth is known exactly."""

from dataclasses import replace

import numpy as np
import pytest

from simulated_sky import KLOBUCHAR, navigation, observe
from truenorth._kernels import positioning as kernels
from truenorth.constants import SPEED_OF_LIGHT_MPS
from truenorth.errors import ConfigError
from truenorth.frames import ecef_from_geodetic, rot_enu_from_ecef
from truenorth.navigation import build_navigation
from truenorth.observations import NO_CHANNEL, Observations, sat_id, signal_id
from truenorth.positioning import POINT_STATUS_SENTENCES, PointStatus, select_codes, solve_single_point
from truenorth.positioning.single_point import CLOCK_GROUPS, _chi2_limits

MICROMETRE = 1e-6
PLACE = ecef_from_geodetic(np.radians(41.0), np.radians(2.0), 100.0)


@pytest.fixture(scope="module")
def nav():
    return navigation()


@pytest.fixture(scope="module")
def still(nav):
    return observe(nav, PLACE, n_epochs=2, clock_s=2.3e-3, clock_drift_sps=3e-7)


def test_position_velocity_and_clock_are_exact_without_noise(nav):
    velocity = np.array([3.0, -20.0, 7.0])
    drift, clock = 3e-7, -7.1e-3
    obs = observe(nav, PLACE, n_epochs=3, velocity_ecef_mps=velocity, clock_s=clock, clock_drift_sps=drift)
    point = solve_single_point(obs, nav)
    assert list(point.status) == [PointStatus.OK] * 3
    assert list(point.velocity_status) == [PointStatus.OK] * 3
    # The receiver's clock runs fast: between tags of one second, true time moves by 1 s - drift.
    true_s = np.arange(3) * (1.0 - drift)
    # Orbits at whole nanoseconds leave half a micrometre.
    assert point.position_ecef_m == pytest.approx(PLACE + velocity * true_s[:, None], abs=2 * MICROMETRE)
    # 1e-14 s is 3 micrometres.
    assert point.clock_s == pytest.approx(clock + drift * np.arange(3), abs=1e-14)
    # Doppler by a difference quotient over 0.4 s, good to a tenth of a micrometre a second.
    assert np.abs(point.velocity_ecef_mps - velocity).max() < 1e-6
    # The simulation's drift is for one second of tags, the solver's for one second of true time.
    assert point.clock_drift_sps == pytest.approx(drift / (1.0 - drift), abs=1e-14)
    assert np.nanmax(np.abs(point.satellites.code_residual_m)) < 5 * MICROMETRE


@pytest.mark.parametrize("latitude_deg", [-89.9, -33.0, 0.0, 78.0])
@pytest.mark.parametrize("longitude_deg", [-170.0, 95.0])
def test_position_is_found_anywhere_from_the_earths_centre(nav, latitude_deg, longitude_deg):
    place = ecef_from_geodetic(np.radians(latitude_deg), np.radians(longitude_deg), 2500.0)
    point = solve_single_point(observe(nav, place), nav, initial_position_ecef_m=(0, 0, 0))
    assert point.position_ecef_m[0] == pytest.approx(place, abs=2 * MICROMETRE)


def test_a_wrong_first_guess_does_no_harm(nav, still):
    # The antipode has all satellites below its horizon.
    for guess in (-PLACE, 1.3 * PLACE, [np.nan] * 3, [1e9, 0, 0]):
        point = solve_single_point(still, nav, initial_position_ecef_m=guess)
        assert point.position_ecef_m == pytest.approx(np.tile(PLACE, (2, 1)), abs=2 * MICROMETRE)


def test_one_epoch_alone_gives_the_numbers_of_the_whole_run(nav):
    obs = observe(nav, PLACE, n_epochs=4, velocity_ecef_mps=(30.0, 10.0, 5.0), clock_s=1e-4)
    noise = np.random.default_rng(3).normal(size=obs.n_rows)
    obs = replace(obs, code_m=obs.code_m + noise)
    whole = solve_single_point(obs, nav)
    for k in range(4):
        alone = solve_single_point(obs.select_epochs([k]), nav)
        assert alone.position_ecef_m[0] == pytest.approx(whole.position_ecef_m[k], abs=MICROMETRE)
        assert alone.clock_s[0] == pytest.approx(whole.clock_s[k], abs=1e-14)


def test_each_system_has_its_own_clock(nav):
    offsets = {2: 20e-9, 3: -50e-9}
    point = solve_single_point(observe(nav, PLACE, clock_s=1e-3, system_offset_s=offsets), nav)
    assert point.system_offset_s[0] == pytest.approx(
        [0.0, 20e-9, -50e-9, np.nan, np.nan], abs=1e-12, nan_ok=True
    )
    # An offset looks like a later transmission: 50 ns at 0.9 km/s are 45 micrometres of range.
    assert np.linalg.norm(point.position_ecef_m[0] - PLACE) < 50 * MICROMETRE
    assert point.clock_s[0] == pytest.approx(1e-3, abs=1e-12)
    without_gps = solve_single_point(observe(nav, PLACE, clock_s=1e-3), nav, systems="CE")
    assert np.isnan(without_gps.system_offset_s[0, 0])
    assert without_gps.system_offset_s[0, 1] == 0.0
    assert CLOCK_GROUPS[:2] == ("G", "E")


@pytest.mark.parametrize("error_m", [60.0, -300.0, 299_792.458, 3e6])
def test_a_wrong_code_is_found_and_removed(nav, still, error_m):
    for row in (0, 5, 11):
        code = still.code_m.copy()
        code[row] += error_m
        point = solve_single_point(replace(still, code_m=code), nav)
        assert list(point.status) == [PointStatus.OK] * 2
        assert np.flatnonzero(point.satellites.is_outlier).tolist() == [row]
        assert list(point.n_rejected) == [1, 0]
        assert point.position_ecef_m[0] == pytest.approx(PLACE, abs=2 * MICROMETRE)
        assert abs(point.satellites.code_residual_m[row]) == pytest.approx(abs(error_m), rel=1e-4)


def test_several_wrong_codes_are_removed_up_to_the_cap(nav, still):
    code = still.code_m.copy()
    code[[1, 4, 9]] += [400.0, -250.0, 130.0]
    obs = replace(still, code_m=code)
    assert np.flatnonzero(solve_single_point(obs, nav).satellites.is_outlier).tolist() == [1, 4, 9]
    capped = solve_single_point(obs, nav, max_rejected=2)
    assert capped.status[0] == PointStatus.INCONSISTENT
    assert capped.n_rejected[0] == 2


def test_an_outlier_without_redundancy_to_locate_it_is_reported(nav):
    obs = observe(nav, PLACE)
    gps = np.flatnonzero(obs.sat // 100 == 0)
    five = obs.select_rows(np.isin(np.arange(obs.n_rows), gps[[0, 2, 4, 5, 7]]))
    code = five.code_m.copy()
    code[2] += 500.0
    point = solve_single_point(replace(five, code_m=code), nav)
    assert point.status[0] == PointStatus.INCONSISTENT
    assert point.dof[0] == 1
    four = five.select_rows(np.arange(5) < 4)
    assert solve_single_point(four, nav).status[0] == PointStatus.OK
    assert solve_single_point(four, nav).position_ecef_m[0] == pytest.approx(PLACE, abs=10 * MICROMETRE)
    assert solve_single_point(four, nav, max_pdop=0.5).status[0] == PointStatus.WEAK_GEOMETRY
    three = five.select_rows(np.arange(5) < 3)
    assert solve_single_point(three, nav).status[0] == PointStatus.TOO_FEW_SATELLITES


def test_a_wrong_doppler_is_removed_and_does_not_touch_the_position(nav, still):
    doppler = still.doppler_hz.copy()
    doppler[7] += 50.0
    doppler[3] = np.nan
    point = solve_single_point(replace(still, doppler_hz=doppler), nav)
    assert point.velocity_status[0] == PointStatus.OK
    assert not point.satellites.is_velocity_used[[3, 7]].any()
    assert point.satellites.is_used[[3, 7]].all()
    assert np.abs(point.velocity_ecef_mps[0]).max() < 1e-6
    # 50 Hz of L1 are 9.5 m/s of range rate; positive Doppler approaches.
    assert point.satellites.doppler_residual_mps[7] == pytest.approx(-9.515, abs=0.001)


def test_epochs_without_a_solution_are_nan_with_a_reason(nav, still):
    nothing = replace(still, code_m=np.full(still.n_rows, np.nan))
    point = solve_single_point(nothing, nav)
    assert list(point.status) == [PointStatus.NO_CODE] * 2
    assert np.isnan(point.position_ecef_m).all()
    assert not point.is_solved.any()
    assert len(point.satellites.sat) == 0
    unknown = solve_single_point(still, build_navigation())
    assert list(unknown.status) == [PointStatus.NO_NAVIGATION] * 2
    assert np.isnan(unknown.covariance_m2).all()
    mute = solve_single_point(replace(still, doppler_hz=np.full(still.n_rows, np.nan)), nav)
    assert list(mute.velocity_status) == [PointStatus.NO_DOPPLER] * 2
    assert np.isnan(mute.velocity_ecef_mps).all()
    assert np.isfinite(mute.position_ecef_m).all()
    empty = solve_single_point(still.select_epochs(slice(0, 0)), nav)
    assert empty.n_epochs == 0
    gap = solve_single_point(still.select_rows(still.epoch_of_row == 1), nav)
    assert list(gap.status) == [PointStatus.NO_CODE, PointStatus.OK]


def test_satellites_below_the_mask_are_listed_and_not_used(nav):
    obs = observe(nav, PLACE, min_elevation_deg=2.0)
    point = solve_single_point(obs, nav, elevation_mask_deg=25.0)
    view = point.satellites
    low = view.elevation_rad < np.radians(25.0)
    assert 0 < low.sum() < len(low)
    assert (view.is_used == ~low).all()
    assert point.n_sats[0] == np.count_nonzero(~low)
    # A line of sight is what it says: from the place, in the Earth's axes.
    up = rot_enu_from_ecef(np.radians(41.0), np.radians(2.0))[2]
    assert view.line_of_sight_ecef @ up == pytest.approx(np.sin(view.elevation_rad), abs=1e-9)
    # The Earth turns by 5 microradians while the signal travels.
    ray = view.position_ecef_m - PLACE
    ray /= np.linalg.norm(ray, axis=1)[:, None]
    assert np.abs(ray - view.line_of_sight_ecef).max() < 1e-5


def test_dops_are_those_of_the_design(nav, still):
    point = solve_single_point(still, nav)
    view = point.satellites
    rows = slice(*view.epoch_start[:2])
    system = view.sat[rows] // 100
    enu = view.line_of_sight_ecef[rows] @ rot_enu_from_ecef(np.radians(41.0), np.radians(2.0)).T
    design = np.column_stack([-enu, system == 0, system == 2, system == 3])
    q = np.linalg.inv(design.T @ design)
    assert point.pdop[0] == pytest.approx(np.sqrt(np.trace(q[:3, :3])), rel=1e-6)
    assert point.hdop[0] == pytest.approx(np.sqrt(q[0, 0] + q[1, 1]), rel=1e-6)
    assert point.vdop[0] == pytest.approx(np.sqrt(q[2, 2]), rel=1e-6)
    assert point.tdop[0] == pytest.approx(np.sqrt(q[3, 3]), rel=1e-6)
    assert point.gdop[0] == pytest.approx(np.sqrt(np.trace(q[:4, :4])), rel=1e-6)


def test_without_coefficients_the_ionosphere_is_in_the_weights(still):
    bare = navigation(klobuchar=False)
    point = solve_single_point(still, bare)
    with_model = solve_single_point(still, navigation())
    assert (point.satellites.code_sd_m > 1.1 * with_model.satellites.code_sd_m).all()
    # By day the model's delay is metres, and the height takes most of it.
    assert 1.0 < np.linalg.norm(point.position_ecef_m[0] - PLACE) < 40.0
    off = solve_single_point(still, navigation(), ionosphere="off")
    assert np.linalg.norm(off.position_ecef_m[0] - PLACE) > 1.0
    assert KLOBUCHAR.any()


def _one_satellite(codes):
    """Observations of G05 at one epoch with codes by signal name."""
    n = len(codes)
    return Observations(
        time_ns=np.array([10**18]),
        epoch_start=np.array([0, n]),
        sat=np.full(n, sat_id("G05"), dtype=np.int16),
        signal=np.array([signal_id(name) for name in codes], dtype=np.int16),
        code_m=np.array(list(codes.values()), dtype=float),
        phase_cyc=np.full(n, np.nan),
        doppler_hz=np.full(n, np.nan),
        cn0_dbhz=np.linspace(30.0, 40.0, n),
        lli=np.zeros(n, dtype=np.uint8),
        clock_offset_s=np.full(1, np.nan),
        glonass_channel=np.full(100, NO_CHANNEL, dtype=np.int8),
    )


@pytest.mark.parametrize(
    ("codes", "chosen"),
    [
        ({"1C": 2e7, "1W": 2e7, "2W": 2e7}, "1C"),
        ({"1C": np.nan, "1W": 2e7, "2W": 2e7}, "1W"),
        ({"1L": 2e7, "1W": 2e7}, "1W"),
        ({"2W": 2e7, "5Q": 2e7}, "2W"),
        ({"1?": 2e7, "2W": 2e7}, "1?"),
        ({"5Q": 2e7}, "5Q"),
    ],
)
def test_the_code_is_chosen_by_priority(codes, chosen):
    obs = _one_satellite(codes)
    row, start = select_codes(obs)
    assert start.tolist() == [0, 1]
    assert obs.signal[row].tolist() == [signal_id(chosen)]


def test_codes_can_be_left_out_by_system_and_strength():
    obs = _one_satellite({"1C": 2e7, "2W": 2e7})
    assert len(select_codes(obs, systems="E")[0]) == 0
    assert select_codes(obs, cn0_mask_dbhz=35.0)[0].tolist() == [1]


def test_chi_square_limits_are_scipys():
    from scipy.stats import chi2

    dof = np.arange(1, 61)
    for significance in (1e-2, 1e-4, 1e-6):
        assert _chi2_limits(60, significance)[1:] == pytest.approx(chi2.isf(significance, dof), rel=1e-7)


def test_the_kernels_codes_are_the_public_ones():
    for status in PointStatus:
        name = "TOO_FEW" if status is PointStatus.TOO_FEW_SATELLITES else status.name
        assert getattr(kernels, name) == status
        assert POINT_STATUS_SENTENCES[status]
    assert len(CLOCK_GROUPS) == kernels.N_GROUPS
    assert kernels.SPEED_OF_LIGHT_MPS == SPEED_OF_LIGHT_MPS


@pytest.mark.parametrize(
    ("option", "value"), [("ionosphere", "magic"), ("systems", "X"), ("systems", ""), ("significance", 0.0)]
)
def test_impossible_options_are_refused_by_name(nav, still, option, value):
    with pytest.raises(ConfigError, match=option) as caught:
        solve_single_point(still, nav, **{option: value})
    assert caught.value.key == option
