"""The joint search is exact: against rounding at attitudes spread over the whole group, and brute force.

The reference knows nothing of lists, trees or joins. Its candidates are the integers that rounding gives at
tens of thousands of attitudes, dense enough for the small arrays here that no candidate of a cost within
the margin can hide between them; each is adjusted from many starts with plain matrices.
"""

import numpy as np
import pytest

from joint_epochs import (
    Reference,
    closed_differences,
    draw_epoch,
    draw_sky,
    reachable_integers,
    same_integers,
    spread_rotations,
)
from truenorth.ambiguity.array_model import ArrayEpoch
from truenorth.ambiguity.joint import resolve_joint, resolve_joint_epochs
from truenorth.errors import Reason, Status

pytestmark = pytest.mark.jit

# A few decimetres: then a rotation of 5 degrees moves no phase by more than a seventh of a cycle.
SIZE_M = 0.35
ARRAYS = {
    "pair": SIZE_M * np.array([[0, 0, 0], [1, 0, 0.0]]),
    "line": SIZE_M * np.array([[0, 0, 0], [1, 0, 0], [0.45, 0, 0.0]]),
    "plane": SIZE_M * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0.0]]),
    "square": SIZE_M * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0.0]]),
    "tripod": SIZE_M * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0.3, 0.3, 0.8]]),
}
MARGIN = 20.0

CASES = [
    ("pair", 4, {}, True),
    ("pair", 4, {}, False),
    ("line", 4, {}, True),
    ("plane", 3, {}, True),
    ("plane", 4, {}, True),
    ("plane", 4, {}, False),
    ("plane", 4, {"position_sd_m": 0.01}, True),
    ("plane", 5, {"missing": 0.15}, True),
    ("plane", 3, {"n_groups": 2}, True),
    ("square", 4, {}, True),
    ("tripod", 4, {}, True),
    ("tripod", 5, {"missing": 0.2}, True),
]


def brute_force(epoch, use_code, bound, rotations, starts):
    """Closed differences, and cost by integers, of all sets of integers that cost no more than the bound."""
    rows, combinations = closed_differences(epoch)
    integers = reachable_integers(epoch, rotations, rows, combinations)
    full = np.zeros((len(integers), len(epoch.antenna)), dtype=np.int64)
    full[:, rows] = integers
    reference = Reference(epoch, use_code)
    free = np.array([reference.free_cost(one) for one in full])
    full = full[free <= bound]
    costs = np.concatenate(
        [reference.costs(part, starts)[0] for part in np.array_split(full, max(len(full) // 400, 1))]
    )
    kept = costs <= bound
    return combinations, {
        tuple(key): cost for key, cost in zip(full[kept][:, rows], costs[kept], strict=True)
    }


@pytest.mark.parametrize(("name", "n_satellites", "options", "use_code"), CASES)
def test_every_candidate_within_the_margin_is_found_at_its_true_cost(name, n_satellites, options, use_code):
    rng = np.random.default_rng([0, n_satellites])
    epoch, _, _ = draw_epoch(rng, ARRAYS[name], n_satellites, **options)
    found = resolve_joint(epoch, use_code=use_code, candidates=3000, margin=MARGIN)
    assert found.reason in (Reason.OK, Reason.PROBABILITY_TEST)
    combinations, expected = brute_force(
        epoch, use_code, found.complete_to, spread_rotations(15_000), spread_rotations(8, 5)
    )
    got = {
        tuple(np.rint(combinations @ one).astype(int)): cost
        for one, cost in zip(found.candidates_cyc, found.candidate_cost, strict=True)
    }
    # Costs at the very edge of the margin may fall on either side of it.
    edge = found.complete_to - 1e-4
    assert {k for k, v in expected.items() if v < edge} <= set(got)
    assert {k for k, v in got.items() if v < edge} <= set(expected)
    for key in set(got) & set(expected):
        # The reference may stop a little short of a minimum in a flat valley.
        assert expected[key] - 1e-2 < got[key] < expected[key] + 1e-4
    assert found.objective == pytest.approx(min(expected.values()), abs=1e-3)


def test_nothing_depends_on_constants_units_of_the_body_frame_or_the_order_of_antennas():
    rng = np.random.default_rng(4)
    epoch, _, _ = draw_epoch(rng, ARRAYS["tripod"], 5)
    found = resolve_joint(epoch, candidates=50)
    n = len(epoch.antenna)
    # Constants of satellites and clocks, whole cycles, another body frame.
    turn = spread_rotations(1, 3)[0]
    cycles = rng.integers(-9, 10, n)
    phase = (
        epoch.phase_m + 1e4 * rng.random(5)[epoch.satellite] + 1e5 * rng.random(4)[epoch.antenna]
        + cycles * epoch.wavelength_m
    )  # fmt: skip
    moved = ArrayEpoch(
        epoch.antenna, epoch.satellite, epoch.group, phase, epoch.code_m, epoch.design_ned,
        epoch.wavelength_m, epoch.phase_variance_m2, epoch.code_variance_m2,
        epoch.positions_body_m @ turn.T + 3.0,
    )  # fmt: skip
    other = resolve_joint(moved, candidates=50)
    np.testing.assert_allclose(other.candidate_cost, found.candidate_cost, atol=1e-4)
    assert same_integers(epoch, other.integers_cyc - cycles, found.integers_cyc)
    np.testing.assert_allclose(other.rot_ned_from_body @ turn, found.rot_ned_from_body, atol=1e-5)
    np.testing.assert_allclose(other.success_probability, found.success_probability, rtol=1e-3)
    # Antennas numbered otherwise.
    order = np.array([2, 0, 3, 1])
    rows = np.lexsort([order[epoch.antenna], epoch.satellite])
    renamed = ArrayEpoch(
        order[epoch.antenna][rows], epoch.satellite, epoch.group, epoch.phase_m[rows], epoch.code_m[rows],
        epoch.design_ned, epoch.wavelength_m, epoch.phase_variance_m2[rows], epoch.code_variance_m2[rows],
        epoch.positions_body_m[np.argsort(order)],
    )  # fmt: skip
    third = resolve_joint(renamed, candidates=50)
    np.testing.assert_allclose(third.candidate_cost, found.candidate_cost, atol=1e-6)
    back = np.empty(n, np.int64)
    back[rows] = third.integers_cyc
    assert same_integers(epoch, back, found.integers_cyc)


def test_several_epochs_cost_what_their_sum_does_and_rising_satellites_are_fixed():
    rng = np.random.default_rng(8)
    sky = draw_sky(rng, 5)
    first, integers, _ = draw_epoch(rng, 2.0 * ARRAYS["square"], 5, sky=sky)
    epochs, arcs = [], []
    for k in range(3):
        epoch, drawn, _ = draw_epoch(rng, 2.0 * ARRAYS["square"], 5, sky=sky)
        phase = epoch.phase_m + (integers - drawn) * epoch.wavelength_m
        # The last satellite rises after the first epoch.
        seen = (epoch.satellite < 4) | (k > 0)
        rows = [a[seen] for a in (epoch.antenna, epoch.satellite, epoch.group, phase, epoch.code_m)]
        rows += [a[seen] for a in (epoch.design_ned, epoch.wavelength_m)]
        rows += [epoch.phase_variance_m2[seen], epoch.code_variance_m2[seen]]
        epochs.append(ArrayEpoch(*rows, epoch.positions_body_m))
        arcs.append(np.flatnonzero(seen))
    found = resolve_joint_epochs(epochs, arcs)
    assert found.status is Status.FIXED
    assert found.is_fixed.all()
    assert same_integers(first, found.integers_cyc, integers)
    costs = []
    for epoch, number, rot in zip(epochs, arcs, found.rot_ned_from_body, strict=True):
        old = number < 16
        part = ArrayEpoch(
            epoch.antenna[old], epoch.satellite[old], epoch.group[old], epoch.phase_m[old], epoch.code_m[old],
            epoch.design_ned[old], epoch.wavelength_m[old], epoch.phase_variance_m2[old],
            epoch.code_variance_m2[old], epoch.positions_body_m,
        )  # fmt: skip
        cost, at = Reference(part).costs(found.integers_cyc[None, number[old]], spread_rotations(20, 2))
        costs.append(cost[0])
        np.testing.assert_allclose(at[0], rot, atol=1e-4)
    assert found.objective == pytest.approx(sum(costs), abs=1e-4)
