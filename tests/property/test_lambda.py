"""Laws of decorrelation and search that hold for every covariance, by brute force in small dimensions."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from truenorth._kernels import ils, ldl
from truenorth.ambiguity.lambda_ import bootstrap, decorrelate, integer_least_squares, partial_fix

seeds = st.integers(0, 2**32 - 1)


def random_model(seed, n, spread=2.0):
    """Correlated covariance with axes over `spread` decades, and floats some cycles wide."""
    rng = np.random.default_rng(seed)
    axes, _ = np.linalg.qr(rng.standard_normal((n, n)))
    cov = (axes * 10.0 ** rng.uniform(-spread, 0.3, n)) @ axes.T
    return 0.5 * (cov + cov.T), rng.uniform(-20.0, 20.0, n)


def brute_force(floats, cov, bound):
    """All integer vectors of cost at most `bound`: they lie in a box of sqrt(bound * variance)."""
    half = np.sqrt(bound * np.diag(cov))
    axes = [np.arange(np.ceil(a - h), np.floor(a + h) + 1) for a, h in zip(floats, half, strict=True)]
    integers = np.array(list(itertools.product(*axes))).reshape(-1, len(floats))
    error = integers - floats
    cost = np.einsum("ij,jk,ik->i", error, np.linalg.inv(cov), error)
    keep = cost <= bound
    order = np.argsort(cost[keep], kind="stable")
    return integers[keep][order].astype(np.int64), cost[keep][order]


def enumerate_z(decorrelation, z_hat, bound, capacity=5000, max_nodes=10**6):
    """`enumerate_within`, with its outputs cut to length."""
    n = decorrelation.n
    z, cost = np.empty((capacity, n)), np.empty(capacity)
    count, nodes, status = ils.enumerate_within(
        n, decorrelation.L, decorrelation.d_cyc2, z_hat, bound, z, cost, max_nodes
    )
    return z[:count], cost[:count], nodes, status


@given(seeds, st.integers(1, 25))
def test_decorrelation_is_unimodular_and_reproduces_the_covariance(seed, n):
    cov, _ = random_model(seed, n, spread=5.0)
    decorrelation = decorrelate(cov)
    assert np.array_equal(decorrelation.z_transform.T @ decorrelation.inverse_transpose, np.eye(n))
    assert np.array_equal(decorrelation.inverse_transpose @ decorrelation.z_transform.T, np.eye(n))
    expected = decorrelation.z_transform.T @ cov @ decorrelation.z_transform
    # Rounding of a matrix of condition 2e5, seen against its largest variance.
    assert decorrelation.cov_z_cyc2() == pytest.approx(expected, abs=1e-9 * np.abs(expected).max())
    assert np.abs(np.tril(decorrelation.L, -1)).max(initial=0.0) <= 0.5 + 1e-9
    assert np.array_equal(np.diag(decorrelation.L), np.ones(n))


@given(seeds, st.integers(1, 25))
def test_both_ways_of_decorrelating_are_lovasz_reduced(seed, n):
    cov, _ = random_model(seed, n, spread=5.0)
    L, d, Z, iZt = np.empty((n, n)), np.empty(n), np.empty((n, n)), np.empty((n, n))
    assert ldl.ldl_factor(cov, n, L, d) == ldl.OK
    assert (L.T * d) @ L == pytest.approx(cov, abs=1e-12 * np.abs(cov).max())
    ldl.reduce_(n, L, d, Z, iZt)
    assert np.array_equal(Z.T @ iZt, np.eye(n))
    plain = decorrelate(cov)
    for lower, variance in ((L, d), (plain.L, plain.d_cyc2)):
        after_exchange = variance[:-1] + np.diag(lower, -1) ** 2 * variance[1:]
        assert np.all(after_exchange >= variance[1:] * (1.0 - 1e-6))
    # The determinant is that of the covariance, whichever way.
    assert np.log(d).sum() == pytest.approx(np.log(plain.d_cyc2).sum(), abs=1e-6)


@given(seeds, st.integers(1, 4), st.integers(1, 5))
def test_search_finds_the_best_of_brute_force(seed, n, candidates):
    cov, floats = random_model(seed, n, spread=1.5)
    found = integer_least_squares(floats, cov, candidates)
    assert found.is_complete
    integers, cost = brute_force(floats, cov, found.cost[-1] * (1.0 + 1e-9) + 1e-12)
    assert found.cost == pytest.approx(cost[:candidates], rel=1e-7, abs=1e-9)
    assert found.integers_cyc.tolist() == integers[: len(found.cost)].tolist()


@given(seeds, st.integers(1, 4), st.floats(0.0, 30.0))
def test_enumeration_equals_brute_force(seed, n, bound):
    cov, floats = random_model(seed, n, spread=1.2)
    decorrelation = decorrelate(cov)
    z, cost, _, status = enumerate_z(decorrelation, decorrelation.to_z(floats), bound, capacity=100_000)
    assert status == ils.COMPLETE
    integers, expected = brute_force(floats, cov, bound)
    assert np.sort(cost) == pytest.approx(expected, rel=1e-7, abs=1e-9)
    found = {tuple(row) for row in decorrelation.from_z(z).astype(np.int64).tolist()}
    assert found == {tuple(row) for row in integers.tolist()}


@given(seeds, st.integers(2, 12))
def test_enumeration_says_when_it_is_cut(seed, n):
    cov, floats = random_model(seed, n)
    decorrelation = decorrelate(cov)
    z_hat = decorrelation.to_z(floats)
    best = integer_least_squares(floats, cov, 4)
    bound = best.cost[3] * (1.0 + 1e-9)
    z, _, nodes, status = enumerate_z(decorrelation, z_hat, bound)
    assert status == ils.COMPLETE
    assert len(z) >= 4
    assert enumerate_z(decorrelation, z_hat, bound, capacity=3)[3] == ils.CAPACITY
    assert enumerate_z(decorrelation, z_hat, bound, max_nodes=nodes - 1)[3] == ils.NODE_LIMIT
    assert enumerate_z(decorrelation, z_hat, bound, max_nodes=nodes)[3] == ils.COMPLETE
    assert len(enumerate_z(decorrelation, z_hat, best.cost[0] * (1.0 - 1e-9))[0]) == 0


@given(seeds, st.integers(1, 8), st.integers(-(10**12), 10**12))
def test_whole_cycles_shift_the_answer_and_nothing_else(seed, n, cycles):
    cov, floats = random_model(seed, n)
    # Binary fractions, so that adding 1e12 cycles loses nothing.
    floats = np.rint(floats * 1024.0) / 1024.0
    here, there = integer_least_squares(floats, cov), integer_least_squares(floats + cycles, cov)
    assert np.array_equal(here.integers_cyc + cycles, there.integers_cyc)
    # Halves may round to the other side, so the sums are not the same bit by bit.
    assert here.cost == pytest.approx(there.cost, rel=1e-9, abs=1e-9)


@given(seeds, st.integers(1, 8))
def test_bootstrapping_is_never_better_than_least_squares(seed, n):
    cov, floats = random_model(seed, n)
    best = integer_least_squares(floats, cov)
    for decorrelated in (True, False):
        error = floats - bootstrap(floats, cov, decorrelated=decorrelated)
        assert error @ np.linalg.solve(cov, error) >= best.cost[0] * (1.0 - 1e-9)


@given(seeds, st.integers(2, 10), st.floats(0.5, 0.9999))
def test_partial_fix_keeps_its_promise(seed, n, level):
    cov, floats = random_model(seed, n, spread=4.0)
    fix = partial_fix(floats, cov, level)
    assert fix.success_rate >= level
    assert np.array_equal(fix.left_out, np.flatnonzero(~fix.is_fixed))
    fixed = fix.float_cyc[fix.is_fixed]
    assert np.array_equal(fixed, np.rint(fixed))
    assert np.all(fix.cov_cyc2[fix.is_fixed] == 0.0)
    # The textbook form of the conditional estimate, in the decorrelated variables.
    decorrelation, first = fix.decorrelation, n - fix.n_fixed_z
    cov_z = decorrelation.cov_z_cyc2()
    z_hat = decorrelation.to_z(floats)
    z = np.rint(decorrelation.to_z(fix.float_cyc)[first:])
    gain = np.linalg.solve(cov_z[first:, first:], cov_z[first:, :first]).T
    conditional = z_hat[:first] + gain @ (z - z_hat[first:])
    expected = decorrelation.from_z(np.concatenate([conditional, z]))
    assert fix.float_cyc == pytest.approx(expected, abs=1e-6)
    cov_free = cov_z[:first, :first] - gain @ cov_z[first:, :first]
    back = decorrelation.inverse_transpose[:, :first]
    assert fix.cov_cyc2 == pytest.approx(back @ cov_free @ back.T, abs=1e-7 * np.abs(cov).max())
