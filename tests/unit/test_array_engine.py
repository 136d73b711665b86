"""The engine of an array: its normal equations, what it survives, and when it steps down."""

from dataclasses import replace

import numpy as np
import pytest

from truenorth import errors
from truenorth._kernels import array_engine, array_normal
from truenorth.attitude import solve_array
from truenorth.attitude.array_run import EXCLUDED, USED
from truenorth.config import (
    ArraySettings,
    AttitudeFilterSettings,
    GnssSettings,
    ReliabilitySection,
    StochasticSettings,
)
from truenorth.errors import Reason, Status
from truenorth.rotations import log_so3, rot_ned_from_body, skew
from truenorth.simulation import simulate

BODY_M = {
    "aft": (0.0, 0.0, 0.0),
    "fore": (2.0, 0.0, 0.0),
    "right": (1.0, 0.8, -0.3),
    "left": (1.0, -0.8, -0.3),
}
EXACT = ArraySettings(position_sd_m=0.0005)


def drive(faults=(), **settings):
    return simulate(
        {
            "name": "engine",
            "seed": 11,
            "duration_s": 29.0,
            "place": {"latitude_deg": 47.0, "longitude_deg": 15.0},
            "platform": {"antennas": [{"name": k, "position_body_m": list(v)} for k, v in BODY_M.items()]},
            "motion": {"kind": "circle", "radius_m": 40.0, "speed_mps": 8.0, "heading_deg": 350.0},
            "sky": {"kind": "nominal", "systems": "G"},
            "faults": list(faults),
            "output": {"signal_truth": False},
        }
        | settings
    )


def solve(simulation, body_m=BODY_M, **options):
    receivers = [simulation.observations[name] for name in BODY_M]
    options = {"array": EXACT} | options
    return solve_array(
        receivers, [body_m[name] for name in BODY_M], simulation.navigation, names=list(BODY_M), **options
    )


def errors_deg(solution, simulation):
    """Angle of the rotation between solution and truth."""
    truth = rot_ned_from_body(*(simulation.truth[f"{name}_rad"] for name in ("heading", "pitch", "roll")))
    turn = solution.rot_ned_from_body @ np.swapaxes(truth[: solution.n_epochs], 1, 2)
    return np.degrees(np.linalg.norm(log_so3(turn), axis=1))


@pytest.fixture(scope="module")
def calm():
    return drive()


def scattered_rows(seed, n_satellites=10, n_antennas=4):
    """Rows of two groups, some missing, with constants and clocks of any size."""
    rng = np.random.default_rng(seed)
    body = np.array(list(BODY_M.values()))[:n_antennas]
    line = rng.standard_normal((n_satellites, 3))
    line[:, 2] = -np.abs(line[:, 2])
    line /= np.linalg.norm(line, axis=1)[:, None]
    rows = [(a, s, s // 5) for s in range(n_satellites) for a in range(n_antennas) if rng.random() > 0.15]
    antenna, satellite, group = np.array(rows).T.astype(np.int64)
    rot = rot_ned_from_body(1.0, 0.1, -0.2)
    sd = 0.003 * (1.0 + rng.random(len(antenna)))
    y = np.sum(-line[satellite] * (body @ rot.T)[antenna], axis=1) + sd * rng.standard_normal(len(antenna))
    # Clocks of up to a millisecond, as receivers have them.
    y += 1e5 * rng.standard_normal(n_satellites)[satellite]
    y += 1e5 * rng.standard_normal((n_antennas, 2))[antenna, group]
    return antenna, satellite, group, y, 1.0 / sd**2, -line[satellite], body, rot


def reduce(rows):
    antenna, satellite, group, y, w, design, body, _ = rows
    m, n_groups = len(body), int(group.max()) + 1
    information, rhs = np.empty((3 * m, 3 * m)), np.empty(3 * m)
    factor, cross = np.empty((n_groups, m, m)), np.empty((n_groups, 3 * m, m))
    right = np.empty((n_groups, m))
    y = y.copy()
    square, redundancy = array_normal.reduce_rows(
        len(y), antenna, satellite, group, y, w, design, m, information, rhs, factor, cross, right
    )
    return information, rhs, square, redundancy, factor, cross, right, y


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_normal_equations_are_those_of_all_double_differences(seed):
    """Against a projector that takes constants and clocks out by brute force."""
    rows = scattered_rows(seed)
    antenna, satellite, group, y, w, design, body, _ = rows
    information, rhs, square, redundancy, *_ = reduce(rows)
    n, m = len(y), len(body)
    nuisance = np.zeros((n, 10 + 2 * m))
    nuisance[np.arange(n), satellite] = 1.0
    nuisance[np.arange(n), 10 + 2 * antenna + group] = 1.0
    root = np.sqrt(w)[:, None]
    base, size, _ = np.linalg.svd(root * nuisance, full_matrices=False)
    base = base[:, size > 1e-9 * size[0]]
    keep = np.eye(n) - base @ base.T
    columns = np.zeros((n, 3 * m))
    for row in range(n):
        columns[row, 3 * antenna[row] : 3 * antenna[row] + 3] = design[row]
    white, observed = keep @ (root * columns), keep @ (root[:, 0] * y)
    np.testing.assert_allclose(information, white.T @ white, atol=1e-9 * np.abs(information).max())
    np.testing.assert_allclose(rhs, white.T @ observed, atol=1e-6 * np.abs(rhs).max())
    # The projector has rows of 1e5 m at weights of 1e5: micrometres of weighted sums remain.
    assert square == pytest.approx(observed @ observed, rel=1e-5)
    assert redundancy == n - base.shape[1]


def test_rotation_minimises_the_square_sum():
    rows = scattered_rows(4)
    body, truth = rows[6], rows[7]
    information, rhs, square, redundancy, *_ = reduce(rows)
    small, small_rhs = np.empty((9, 9)), np.empty(9)
    active = np.ones(4, np.int64)
    assert array_normal.strike_reference(information, rhs, active, np.int64(0), small, small_rhs) == 3
    rot, normal, cov = truth.copy(), np.empty((3, 3)), np.empty((3, 3))
    fitted, axis = np.empty(9), np.array([1.0, 0.0, 0.0])
    vectors = np.ascontiguousarray(body[1:] - body[0])
    found = array_normal.fit_rotation(
        np.int64(3), small, small_rhs, square, vectors, axis, False, rot, normal, cov, fitted
    )

    def cost(rotation):
        b = (vectors @ rotation.T).ravel()
        return b @ small @ b - 2.0 * b @ small_rhs + square

    assert found == pytest.approx(cost(rot), abs=1e-5)
    for k in range(3):
        for side in (-1e-4, 1e-4):
            turned = (np.eye(3) + side * skew(np.eye(3)[k])) @ rot
            assert cost(turned) > found
    # As many degrees of freedom as it should have: mean of chi-square within five standard deviations.
    assert abs(found - (redundancy - 3)) < 5.0 * np.sqrt(2.0 * (redundancy - 3))


def test_codes_of_the_kernel_are_those_of_the_package():
    for name in ("OK", "TOO_FEW_SATELLITES", "WEAK_GEOMETRY", "HOLD_RELEASED"):
        assert getattr(array_engine, f"R_{name}") == getattr(errors.Reason, name)
    for name in ("NONE", "HELD", "FIXED"):
        assert getattr(array_engine, f"S_{name}") == getattr(errors.Status, name)
    assert (array_engine.USED, array_engine.EXCLUDED) == (USED, EXCLUDED)


@pytest.mark.jit
def test_every_epoch_of_a_calm_drive_is_right(calm):
    solution = solve(calm)
    assert solution.level == "joint"
    np.testing.assert_array_equal(solution.status, [Status.FIXED] + 29 * [Status.HELD])
    # Millimetres over a metre.
    assert errors_deg(solution, calm).max() < 1.0
    assert solution.success_probability.min() > 0.999
    # Vectors that know no geometry have the lengths of the body.
    lengths = np.linalg.norm(solution.vectors.vector_ned_m[:, 1:], axis=2)
    body = np.linalg.norm(np.array(list(BODY_M.values()))[1:], axis=1)
    assert np.abs(lengths - body).max() < 0.03


@pytest.mark.jit
def test_blocks_of_any_size_give_the_same_run(calm):
    whole = solve(calm)
    pieces = solve(calm, block_epochs=4)
    np.testing.assert_array_equal(pieces.status, whole.status)
    np.testing.assert_allclose(pieces.heading_rad, whole.heading_rad, atol=1e-9)
    np.testing.assert_allclose(pieces.chi2, whole.chi2, rtol=1e-6)


@pytest.mark.jit
@pytest.mark.parametrize("name", ["aft", "right"])
def test_a_receiver_dies_and_comes_back_and_no_epoch_is_lost(name):
    """The first antenna, from which the others are differenced, no less than any other."""
    simulation = drive([{"kind": "dead", "antenna": name, "start_s": 8.0, "end_s": 15.0}])
    solution = solve(simulation)
    assert solution.is_accepted.all()
    assert errors_deg(solution, simulation).max() < 1.5
    k = list(BODY_M).index(name)
    assert not solution.is_used[9:15, k].any()
    assert solution.is_used[:8, k].all()
    assert solution.is_used[-5:, k].all()
    assert {"lost", "returned"} <= {event.kind for event in solution.events}


@pytest.mark.jit
def test_a_slip_without_a_flag_is_found_and_mended(calm):
    receiver = calm.observations["right"]
    epoch = np.repeat(np.arange(receiver.n_epochs), np.diff(receiver.epoch_start))
    high = solve(calm, keep_residuals=True).residuals
    sat = high.sat[np.argmax(high.elevation_rad)]
    phase = receiver.phase_cyc.copy()
    phase[(epoch >= 12) & (receiver.sat == sat)] += 2.0
    slipped = replace(receiver, phase_cyc=phase)
    simulation = replace(calm, observations=dict(calm.observations) | {"right": slipped})
    solution = solve(simulation)
    assert solution.is_accepted.all()
    assert errors_deg(solution, calm).max() < 1.0
    slips = [event for event in solution.events if event.kind == "slip"]
    # Both signals of the satellite, at once.
    assert len(slips) == 2
    assert all("at right slipped" in slip.text for slip in slips)
    assert {slip.time_ns for slip in slips} == {calm.truth["time_ns"][12]}
    held = [event for event in solution.events if event.kind == "held" and "at right" in event.text]
    assert held
    assert held[0].time_ns > slips[0].time_ns


@pytest.mark.jit
def test_an_antenna_that_moved_is_left_out(calm):
    """From the middle of the run on, the phases of one antenna are those of a place 8 cm away."""
    receiver = calm.observations["left"]
    epoch = np.repeat(np.arange(receiver.n_epochs), np.diff(receiver.epoch_start))
    phase = receiver.phase_cyc.copy()
    rng = np.random.default_rng(2)
    for sat in np.unique(receiver.sat):
        phase[(epoch >= 15) & (receiver.sat == sat)] += rng.uniform(-0.28, 0.28)
    simulation = replace(
        calm, observations=dict(calm.observations) | {"left": replace(receiver, phase_cyc=phase)}
    )
    solution = solve(simulation)
    assert solution.is_accepted.all()
    assert errors_deg(solution, calm).max() < 1.5
    assert "left" in solution.excluded
    assert any(event.kind == "excluded" and event.text.startswith("left") for event in solution.events)


@pytest.mark.jit
def test_coordinates_that_the_phases_refute_are_named_and_stepped_down_from(calm):
    # The same distance from the first antenna, other angles to all.
    solution = solve(calm, body_m=BODY_M | {"left": (0.8, -1.0, -0.3)})
    assert solution.level in ("length", "free")
    assert any("calibrate array" in text for text in solution.warnings)
    assert "left" not in np.array(list(BODY_M))[solution.is_used.all(0)]
    # No attitude that rests on the wrong place.
    assert np.nanmax(errors_deg(solution, calm)) < 2.0


@pytest.mark.jit
def test_filter_method_and_reliability_from_the_settings(calm):
    solution = solve(
        calm,
        array=ArraySettings(position_sd_m=0.0005, method="triad"),
        attitude_filter=AttitudeFilterSettings(output_rate_hz=2.0),
        reliability=ReliabilitySection(integrity_risk=1e-4),
    )
    assert solution.n_epochs == 59
    predicted = solution.reason == Reason.PREDICTED
    assert np.count_nonzero(predicted) == 29
    assert (solution.status[predicted] == Status.FLOAT).all()
    sd = solution.angle_sd_rad(0)
    assert np.nanmean(sd[predicted]) > np.nanmean(sd[~predicted])
    level = solution.protection_rad[~predicted]
    assert (level[2:] > 3.0 * sd[~predicted][2:, None] * 0.99).any()
    assert np.isnan(solution.protection_rad[predicted]).all()


@pytest.mark.jit
def test_single_epochs_forget(calm):
    solution = solve(calm, settings=GnssSettings(single_epoch=True))
    assert (solution.status[solution.is_accepted] == Status.FIXED).all()
    assert np.mean(solution.is_accepted) > 0.9
    assert np.nanmax(errors_deg(solution, calm)) < 1.0


@pytest.mark.jit
def test_epochs_that_alone_leave_doubts_are_searched_together():
    """Four satellites, L1, no codes: one epoch is not sure; two with other multipath, 20 s apart, are."""
    simulation = drive(duration_s=44.0)
    noisy = StochasticSettings(estimate=False, phase_sd_m=0.004, phase_elevation_sd_m=0.004)
    weak = GnssSettings(bands=("L1",), elevation_mask_deg=40.0, use_code=False, stochastic=noisy)
    solution = solve(simulation, settings=weak)
    assert (solution.reason[:20] == Reason.PROBABILITY_TEST).all()
    assert solution.is_accepted[20:].all()
    assert np.nanmax(errors_deg(solution, simulation)) < 1.0
    # The same over the borders of blocks.
    pieces = solve(simulation, settings=weak, block_epochs=7)
    np.testing.assert_array_equal(pieces.status, solution.status)
