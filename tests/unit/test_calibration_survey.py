"""The self-survey of an array: coordinates, frame, verdict on what was declared, and what it survives."""

from dataclasses import replace

import numpy as np
import pytest

from synthetic_survey import BODY_M, make_vectors
from truenorth.calibration import calibrate_array, vectors_of_solution
from truenorth.calibration.body_frame import best_fit, motion_jacobian, s_transformation
from truenorth.calibration.correlation import correlation_of, markov_inflation
from truenorth.calibration.shape import shape_from_distances
from truenorth.errors import ConfigError, NoSolutionError

# Of one coordinate of one epoch 3 and 6 mm; of 300 epochs 0.2 and 0.4 mm. Five of the latter.
CLOSE_M = 0.002


def test_coordinates_are_found_while_moving_and_at_rest():
    for is_moving in (True, False):
        found = calibrate_array(make_vectors(is_moving=is_moving), declared_m=BODY_M)
        assert found.is_static is not is_moving
        assert np.max(np.abs(found.positions_body_m - BODY_M)) < CLOSE_M
        assert found.declared.agrees
        assert "agree" in found.declared.sentence()
        assert not found.declared.is_wrong.any()
        assert found.n_used == 300
        # The vectors are as good as stated.
        assert abs(found.variance_factor - 1.0) < 0.2


def test_the_antenna_that_is_declared_elsewhere_is_named_with_its_displacement():
    declared = BODY_M.copy()
    declared[2] += [0.0, -0.02, 0.0]
    found = calibrate_array(make_vectors(), declared_m=declared, declared_sd_m=0.002)
    check = found.declared
    assert not check.agrees
    np.testing.assert_array_equal(check.is_wrong, [False, False, True, False])
    # The frame is that of the others, so their coordinates stay and only those of the wrong one move.
    np.testing.assert_allclose(found.positions_body_m, BODY_M, atol=CLOSE_M)
    assert "c is off by" in check.sentence()
    assert "mm right" in check.sentence()
    assert "the others agree" in check.sentence()
    assert [check.verdict(k) for k in range(4)] == ["agrees", "agrees", "elsewhere", "agrees"]
    assert found.to_dict()["declared"]["antennas"][2]["verdict"] == "elsewhere"


def test_two_wrong_antennas_of_four_are_told_by_the_distance_that_is_right():
    declared = BODY_M.copy()
    declared[2, 1] -= 0.05
    declared[3, 0] += 0.08
    check = calibrate_array(make_vectors(), declared_m=declared, declared_sd_m=0.002).declared
    np.testing.assert_array_equal(check.is_wrong, [False, False, True, True])


def test_where_several_antennas_may_be_to_blame_none_is():
    """Of three antennas with one wrong distance, either end of it may be elsewhere."""
    declared = BODY_M[:3] * 1.0
    away = declared[2] - declared[0]
    # Along the circle about the first antenna: only the distance from the second changes.
    declared[2] = declared[0] + np.cross(away, [0.0, 0.0, 1.0]) * 0.04 + away * np.sqrt(1.0 - 0.04**2)
    check = calibrate_array(make_vectors(body_m=BODY_M[:3]), declared_m=declared).declared
    assert not check.agrees
    assert not check.is_wrong.any()
    assert "cannot be told" in check.sentence()
    assert check.verdict(0) == "in doubt"


def test_distances_do_not_depend_on_the_frame():
    by_axes = calibrate_array(make_vectors(), rule="axes", axes=(1, 2, 3))
    by_declared = calibrate_array(make_vectors(), declared_m=BODY_M)
    for one, other in zip(by_axes.distances, by_declared.distances, strict=True):
        assert one.distance_m == pytest.approx(other.distance_m, abs=1e-6)
        assert one.sd_m == pytest.approx(other.sd_m, rel=0.1)
        assert np.isnan(one.difference_m)
        assert abs(other.difference_m) < CLOSE_M


def test_the_axes_are_those_of_three_antennas():
    found = calibrate_array(make_vectors())
    assert found.rule == "axes"
    place = found.positions_body_m
    np.testing.assert_allclose(place[0], 0.0, atol=1e-9)
    np.testing.assert_allclose(place[1, 1:], 0.0, atol=1e-9)
    assert place[2, 2] == pytest.approx(0.0, abs=1e-9)
    # What the rule fixes has no variance, all else has.
    fixed = np.array([[1, 1, 1], [0, 1, 1], [0, 0, 1], [0, 0, 0]], dtype=bool)
    np.testing.assert_array_equal(found.sd_body_m < 1e-9, fixed)
    # Down is down: the third antenna stands to the right of the line from the first to the second.
    assert place[2, 1] > 1.0
    turned = calibrate_array(make_vectors(), axes=(0, 1, 3)).positions_body_m
    assert turned[3, 1] < -1.0


def test_no_declared_coordinates_enter_the_shape():
    """Placeholders in the vectors' own coordinates must not matter."""
    vectors = make_vectors()
    blank = replace(vectors, positions_body_m=np.zeros((4, 3)))
    np.testing.assert_allclose(
        calibrate_array(blank).positions_body_m, calibrate_array(vectors).positions_body_m, atol=1e-9
    )


def test_wrong_integers_are_left_out():
    vectors = make_vectors()
    rng = np.random.default_rng(2)
    wrong = rng.choice(300, 60, replace=False)
    # A cycle of the phase to one satellite moves a vector by decimetres.
    vectors.vector_ned_m[wrong, 2] += rng.normal(0.0, 0.2, (60, 3))
    found = calibrate_array(vectors, declared_m=BODY_M)
    assert np.max(np.abs(found.positions_body_m - BODY_M)) < CLOSE_M
    assert 235 <= found.n_used <= 250
    assert not found.is_used[wrong].sum() > 10


def test_antennas_may_be_missing_and_the_reference_may_change():
    vectors = make_vectors()
    vectors.vector_ned_m[50:120, 3] = np.nan
    vectors.vector_ned_m[120:140] = np.nan
    # From epoch 200 on the second antenna is the reference.
    place = np.nan_to_num(vectors.vector_ned_m[200:])
    turned = place - place[:, 1:2]
    turned[:, 1] = np.nan
    vectors.vector_ned_m[200:] = turned
    vectors.reference[200:] = 1
    one = np.kron(np.ones((4, 4)) + np.eye(4), np.diag([9e-6, 9e-6, 36e-6]))
    one[3:6], one[:, 3:6] = np.nan, np.nan
    vectors.cov_ned_m2[200:] = one
    found = calibrate_array(vectors, declared_m=BODY_M)
    assert found.n_epochs == 280
    assert found.n_used > 270
    assert np.max(np.abs(found.positions_body_m - BODY_M)) < CLOSE_M


def test_an_antenna_that_no_epoch_has_is_left_out():
    vectors = make_vectors(60)
    vectors.vector_ned_m[:, 1] = np.nan
    found = calibrate_array(vectors, declared_m=BODY_M)
    assert found.names == ("a", "c", "d")
    np.testing.assert_allclose(found.positions_body_m, BODY_M[[0, 2, 3]], atol=0.003)
    assert any("b left out" in text for text in found.warnings)
    assert calibrate_array(vectors, axes=(2, 3, 0)).rule_text.startswith("c is the origin, d is forward")
    with pytest.raises(ConfigError, match="without any vector"):
        calibrate_array(vectors, axes=(0, 1, 2))


def test_squares_of_errors_do_not_lengthen_a_short_array():
    """Of 30 cm and errors of 5 and 10 mm; without the correction distances come out 0.3 to 0.5 mm long."""
    short = np.array([[0.0, 0.0, 0.0], [0.3, 0.0, 0.0], [0.1, 0.3, 0.0]])
    for body in (short, short[:2]):
        off = [
            [pair.difference_m for pair in found.distances]
            for found in (
                calibrate_array(
                    make_vectors(2000, body_m=body, sd_m=(0.005, 0.005, 0.01), seed=seed),
                    declared_m=body, moving=True,
                )
                for seed in range(4)
            )
        ]  # fmt: skip
        # The mean of four runs with 0.17 mm each is within 0.085 mm.
        assert np.max(np.abs(np.mean(off, axis=0))) < 0.28e-3


def test_two_antennas_and_antennas_on_a_line_give_distances():
    line = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.5, 0.0, 0.0]])
    for body in (line, line[:2]):
        found = calibrate_array(make_vectors(body_m=body), declared_m=body)
        assert found.is_line
        assert found.declared is None
        assert all(abs(pair.difference_m) < CLOSE_M for pair in found.distances)
        assert all(0.0 < pair.sd_m < 0.003 for pair in found.distances)
        assert any("one line" in text for text in found.warnings)


def test_what_stays_alike_is_allowed_for():
    vectors = make_vectors()
    without = calibrate_array(vectors, declared_m=BODY_M, common_sd_m=0.0)
    allowed = calibrate_array(vectors, declared_m=BODY_M, common_sd_m=0.002)
    np.testing.assert_allclose(without.sd_body_m, without.scatter_sd_m)
    np.testing.assert_allclose(allowed.scatter_sd_m, without.scatter_sd_m)
    added = np.trace(allowed.cov_body_m2 - without.cov_body_m2)
    # Six of the twelve coordinates are the frame's.
    assert added == pytest.approx(6 * 0.002**2, rel=1e-6)


def test_correlation_makes_epochs_count_for_less():
    white = calibrate_array(make_vectors(900), declared_m=BODY_M)
    alike = calibrate_array(make_vectors(900, tau_s=10.0), declared_m=BODY_M)
    # 1 + 2 sum exp(-j / 10) = 20 for an endless run.
    assert white.effective_epochs > 600
    assert 25 < alike.effective_epochs < 90
    declared = calibrate_array(make_vectors(900), declared_m=BODY_M, correlation_s=30.0)
    assert declared.effective_epochs == pytest.approx(900 / markov_inflation(np.arange(900) * 10**9, 30.0))


def test_correlation_of_known_series():
    rng = np.random.default_rng(1)
    n, tau = 20_000, 10.0
    series, keep = rng.standard_normal(n), np.exp(-1.0 / tau)
    for k in range(1, n):
        series[k] = keep * series[k - 1] + np.sqrt(1.0 - keep**2) * series[k]
    time_ns = np.arange(n) * 10**9
    found = correlation_of(series[:, None], time_ns)
    # sd of the estimate is about sqrt(4 M / n) = 15 % for a window of 60 lags.
    assert found.inflation == pytest.approx((1.0 + keep) / (1.0 - keep), rel=0.4)
    assert found.is_resolved
    gaps = rng.uniform(size=n) < 0.7
    part = correlation_of(series[gaps][:, None], time_ns[gaps])
    assert part.inflation == pytest.approx(1.0 + 0.7 * (found.inflation - 1.0), rel=0.2)
    assert correlation_of(rng.standard_normal((n, 3)), time_ns).inflation < 1.1
    assert correlation_of(np.zeros((5, 2)), time_ns[:5]).inflation == 1.0


def test_the_start_finds_the_handedness():
    place = shape_from_distances(make_vectors(50))
    rot, shift = best_fit(place, BODY_M)
    np.testing.assert_allclose(place @ rot.T + shift, BODY_M, atol=0.01)


def test_s_transformation_keeps_the_rule():
    rule = np.zeros((12, 6))
    rule[[0, 1, 2, 4, 5, 8], np.arange(6)] = 1.0
    change = s_transformation(BODY_M, rule)
    np.testing.assert_allclose(rule.T @ change, 0.0, atol=1e-12)
    # Motions of the frame vanish, and doing it twice changes nothing.
    np.testing.assert_allclose(change @ motion_jacobian(BODY_M), 0.0, atol=1e-12)
    np.testing.assert_allclose(change @ change, change, atol=1e-12)


def test_what_is_impossible_is_refused():
    vectors = make_vectors(40)
    for key, options in (
        ("rule", {"rule": "level"}),
        ("rule", {"rule": "declared"}),
        ("declared_m", {"declared_m": np.zeros((3, 3))}),
        ("declared_sd_m", {"declared_m": BODY_M, "declared_sd_m": -1.0}),
        ("axes", {"axes": (0, 0, 1)}),
        ("correlation_s", {"correlation_s": -1.0}),
        ("common_sd_m", {"common_sd_m": np.nan}),
        ("significance", {"significance": 1.0}),
    ):
        with pytest.raises(ConfigError, match=f"`{key}`"):
            calibrate_array(vectors, **options)
    with pytest.raises(NoSolutionError, match="9 epochs"):
        calibrate_array(make_vectors(9))
    apart = make_vectors(40)
    apart.vector_ned_m[:20, 2], apart.vector_ned_m[20:, 3] = np.nan, np.nan
    with pytest.raises(NoSolutionError, match="both c and d"):
        calibrate_array(apart)
    line = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    with pytest.raises(ConfigError, match="one line"):
        calibrate_array(make_vectors(40, body_m=line))
    calibrate_array(make_vectors(40, body_m=line), axes=(0, 1, 3))


def test_vectors_of_baselines_are_freed_of_their_length():
    """A baseline without the length, and the same adjusted with a wrong one, give one vector."""
    from synthetic_array import make_baselines
    from truenorth.config import GnssSettings, _describe

    free = make_baselines(60, body_m=BODY_M)
    bent = []
    for k, solution in enumerate(free, start=1):
        length, sd = float(np.linalg.norm(BODY_M[k])) + 0.01, 0.003
        information = np.linalg.inv(solution.cov_enu_m2)
        b = solution.baseline_enu_m.copy()
        for _ in range(30):
            unit = b / np.linalg.norm(b, axis=1, keepdims=True)
            normal = information + unit[:, :, None] * unit[:, None, :] / sd**2
            rhs = np.einsum("nij,nj->ni", information, solution.baseline_enu_m - b)
            rhs += unit * ((length - np.linalg.norm(b, axis=1)) / sd**2)[:, None]
            b = b + np.linalg.solve(normal, rhs[..., None])[..., 0]
        size = np.linalg.norm(b, axis=1)
        v = (size - length) / (sd**2 * size)
        unit = b / size[:, None]
        full = information + v[:, None, None] * np.eye(3)
        full += (1.0 / sd**2 - v)[:, None, None] * unit[:, :, None] * unit[:, None, :]
        options = GnssSettings(length_m=length, length_sd_m=sd, method="filter")
        bent.append(
            replace(solution, baseline_enu_m=b, cov_enu_m2=np.linalg.inv(full), settings=_describe(options))
        )

    class Solved:
        positions_body_m, time_ns, antennas = BODY_M, free[0].time_ns, ("a", "b", "c", "d")

    Solved.baselines = free
    one = vectors_of_solution(Solved)
    Solved.baselines = bent
    other = vectors_of_solution(Solved)
    assert np.max(np.abs(free[0].baseline_enu_m - bent[0].baseline_enu_m)) > 0.003
    np.testing.assert_allclose(one.vector_ned_m, other.vector_ned_m, atol=1e-6)
    Solved.baselines = ()
    with pytest.raises(ConfigError, match="neither vectors nor baselines"):
        vectors_of_solution(Solved)
    Solved.vectors = one
    assert vectors_of_solution(Solved) is one
    # Half of the covariance is shared.
    joint = one.cov_ned_m2[0].reshape(4, 3, 4, 3)
    np.testing.assert_allclose(joint[1, :, 2, :], 0.5 * joint[1, :, 1, :], rtol=1e-6)
