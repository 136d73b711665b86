"""Laws of the classical searches: enumeration against brute force, minima against independent solvers."""

from dataclasses import replace
from itertools import product

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from truenorth.ambiguity.exhaustive import ExhaustiveOptions, resolve_exhaustive, set_index
from truenorth.ambiguity.lsast import LsastOptions, primary_region_count, resolve_lsast, select_primaries
from truenorth.ambiguity.model import DoubleDifferences
from truenorth.ambiguity.row_identity import carry_matrix

WAVELENGTH_M = 0.1902936728
SEEDS = st.integers(0, 2**32 - 1)


def random_epoch(seed, n_satellites, length_m, sd_m):
    """One epoch of a random sky above 10 degrees, with its integers."""
    rng = np.random.default_rng(seed)
    azimuth = rng.uniform(0.0, 2.0 * np.pi, n_satellites)
    up = np.sort(rng.uniform(np.sin(np.radians(10.0)), 1.0, n_satellites))[::-1]
    level = np.sqrt(1.0 - up**2)
    rays = np.column_stack([level * np.sin(azimuth), level * np.cos(azimuth), up])
    design = -(rays[1:] - rays[0])
    m = n_satellites - 1
    cov = 2.0 * sd_m**2 * (np.eye(m) + 1.0)
    direction = rng.standard_normal(3)
    baseline = length_m * direction / np.linalg.norm(direction)
    integers = rng.integers(-30, 31, m)
    phase = design @ baseline + WAVELENGTH_M * integers + np.linalg.cholesky(cov) @ rng.standard_normal(m)
    problem = DoubleDifferences(
        phase_m=phase,
        design=design,
        wavelength_m=np.full(m, WAVELENGTH_M),
        cov_phase_m2=cov,
        code_m=np.empty(0),
        code_design=np.empty((0, 3)),
        cov_code_m2=np.empty((0, 0)),
        elevation_rad=np.arcsin(up[1:]),
        length_m=length_m,
        length_sd_m=0.003,
    )
    return problem, integers


@given(seed=SEEDS, length=st.floats(0.2, 1.2), tolerance=st.floats(0.005, 0.3), shell=st.booleans())
def test_every_lattice_point_of_the_region_is_visited_once(seed, length, tolerance, shell):
    problem, _ = random_epoch(seed, 6, length, 0.002)
    rows, _ = select_primaries(problem)
    if len(rows) == 0:
        return
    options = LsastOptions(region="shell" if shell else "sphere", coarse_length_tolerance_m=tolerance)
    inverse = np.linalg.inv(problem.design[rows])
    # All integers that any point of the sphere can have, row by row.
    reach = (length + tolerance) * np.linalg.norm(problem.design[rows], axis=1)
    ranges = [
        np.arange(np.ceil((p - r) / WAVELENGTH_M), np.floor((p + r) / WAVELENGTH_M) + 1)
        for p, r in zip(problem.phase_m[rows], reach, strict=True)
    ]
    grid = np.stack(np.meshgrid(*ranges, indexing="ij"), axis=-1).reshape(-1, 3)
    norm = np.linalg.norm((problem.phase_m[rows] - WAVELENGTH_M * grid) @ inverse.T, axis=1)
    low = max(0.0, length - tolerance) if shell else 0.0
    # Points within rounding errors of the border may fall to either side.
    border = np.count_nonzero(
        (np.abs(norm - low) < 1e-9) & (low > 0.0) | (np.abs(norm - length - tolerance) < 1e-9)
    )
    inside = np.count_nonzero((norm >= low) & (norm <= length + tolerance))
    assert abs(primary_region_count(problem, options) - inside) <= border


@given(seed=SEEDS, length=st.floats(0.2, 1.0), rounding=st.sampled_from(["sequential", "primary"]))
def test_the_best_candidate_is_that_of_brute_force(seed, length, rounding):
    problem, _ = random_epoch(seed, 6, length, 0.002)
    rows, _ = select_primaries(problem)
    options = LsastOptions(
        secondary_rounding=rounding, fine_length_tolerance_m=0.03, coarse_length_tolerance_m=0.06, n_keep=5
    )
    result = resolve_lsast(problem, options)
    if len(rows) == 0:
        return
    # Whatever was kept obeys the tests, and no kept candidate is beaten by one that was left out with
    # the same primaries: rounding again from the final baseline changes nothing for good sets.
    weight = np.linalg.inv(problem.cov_phase_m2)
    cov = np.linalg.inv(problem.design.T @ weight @ problem.design)
    primaries = np.linalg.inv(problem.design[rows])
    for k, integers in enumerate(result.integers_cyc):
        free = problem.phase_m - WAVELENGTH_M * integers
        baseline = cov @ problem.design.T @ weight @ free
        residual = free - problem.design @ baseline
        np.testing.assert_allclose(result.objective[k], residual @ weight @ residual, rtol=1e-7, atol=1e-9)
        assert abs(np.linalg.norm(baseline) - length) <= 0.03 + 1e-9
        assert abs(np.linalg.norm(primaries @ free[rows]) - length) <= 0.06 + 1e-9
    assert len(np.unique(result.integers_cyc[:, rows], axis=0)) == len(result.integers_cyc)


@given(seed=SEEDS, length=st.floats(0.15, 0.35), n_satellites=st.integers(4, 6))
def test_exhaustive_search_finds_the_least_of_all(seed, length, n_satellites):
    # All satellites are enumerated, so the best set must be the best of a plain loop over everything, with
    # the sphere's minimum found by bisection of its multiplier.
    problem, _ = random_epoch(seed, n_satellites, length, 0.002)
    if np.linalg.svd(problem.design, compute_uv=False)[-1] < 0.05:
        return
    problem = replace(problem, length_sd_m=np.nan)
    result = resolve_exhaustive(problem, ExhaustiveOptions(n_satellites=n_satellites, n_keep=50))
    weight = np.linalg.inv(problem.cov_phase_m2)
    normal = problem.design.T @ weight @ problem.design
    values, axes = np.linalg.eigh(normal)
    reach = length * np.linalg.norm(problem.design, axis=1) + 5.0 * np.sqrt(np.diag(problem.cov_phase_m2))
    ranges = [
        np.arange(np.ceil((p - r) / WAVELENGTH_M), np.floor((p + r) / WAVELENGTH_M) + 1)
        for p, r in zip(problem.phase_m, reach, strict=True)
    ]
    sets = np.array(list(product(*ranges)))
    free = problem.phase_m - WAVELENGTH_M * sets
    centre = np.linalg.solve(normal, problem.design.T @ weight @ free.T).T
    residual = free - centre @ problem.design.T
    cost = np.einsum("ni,ij,nj->n", residual, weight, residual)
    # (normal + multiplier) x = normal centre with |x| = length; the greatest multiplier is the minimum.
    right = (centre @ axes) * values
    low = np.full(len(sets), -values[0])
    high = np.linalg.norm(right, axis=1) / length
    for _ in range(200):
        middle = 0.5 * (low + high)
        with np.errstate(divide="ignore", invalid="ignore"):
            size = np.linalg.norm(right / (values + middle[:, None]), axis=1)
        long = size > length
        low, high = np.where(long, middle, low), np.where(long, high, middle)
    x = right / (values + high[:, None])
    off = x - centre @ axes
    cost += np.sum(off**2 * values, axis=1)
    best = np.sort(cost)[: len(result.objective)]
    np.testing.assert_allclose(result.objective[:3], best[:3], rtol=1e-5, atol=1e-6)
    np.testing.assert_array_equal(result.integers_cyc[0], sets[np.argmin(cost)])


@given(bound=st.integers(1, 4), digits=st.integers(1, 5))
def test_set_numbers_are_the_lexicographic_order(bound, digits):
    numbers = [set_index(s, bound) for s in product(range(-bound, bound + 1), repeat=min(digits, 3))]
    assert numbers == list(range(1, len(numbers) + 1))


@given(seed=SEEDS)
def test_integers_survive_any_change_of_rows_that_keeps_them_known(seed):
    rng = np.random.default_rng(seed)
    undifferenced = rng.integers(-50, 51, 12)

    def rows():
        chosen = rng.permutation(12)[: rng.integers(3, 10)]
        return chosen[1:], np.full(len(chosen) - 1, chosen[0])

    old_key, old_reference = rows()
    new_key, new_reference = rows()
    matrix, known = carry_matrix(old_key, old_reference, new_key, new_reference)
    old = undifferenced[old_key] - undifferenced[old_reference]
    new = undifferenced[new_key] - undifferenced[new_reference]
    np.testing.assert_array_equal((matrix @ old)[known], new[known])
    there = {*old_key, old_reference[0]}
    np.testing.assert_array_equal(known, [k in there and new_reference[0] in there for k in new_key])
    # Without references only rows with the same name are the same.
    matrix, known = carry_matrix(old_key, None, new_key, None)
    np.testing.assert_array_equal(known, np.isin(new_key, old_key))
