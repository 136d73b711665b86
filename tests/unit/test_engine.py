"""The compiled engine piece by piece against plain NumPy, and its memory and holding over many epochs."""

import importlib.util
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from truenorth._kernels import engine
from truenorth.ambiguity import resolution
from truenorth.ambiguity.carried import EngineState
from truenorth.errors import Reason, Status

TOOLS = Path(__file__).parents[2] / "tools"


def load(name):
    """A module of tools/, which is no package."""
    spec = importlib.util.spec_from_file_location(name, TOOLS / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules.setdefault(name, module)
    spec.loader.exec_module(module)
    return module


engine_run = load("engine_run")
circular_sky = load("circular_sky")

WAVELENGTHS_M = np.array([0.190293673, 0.244210213])


def test_codes_are_those_of_the_package():
    reasons = {name[2:]: value for name, value in vars(engine).items() if name.startswith("R_")}
    assert reasons
    assert reasons == {name: int(Reason[name]) for name in reasons}
    statuses = {name[2:]: value for name, value in vars(engine).items() if name.startswith("S_")}
    assert statuses == {status.name: int(status) for status in Status}
    kinds = {value for name, value in vars(engine).items() if name.startswith("E_")}
    assert kinds == set(resolution.ENGINE_EVENTS)


def test_inverses():
    rng = np.random.default_rng(1)
    for n in (1, 2, 5, 12):
        root = rng.standard_normal((n, n))
        matrix = root @ root.T + 0.1 * np.eye(n)
        inverse = np.empty((n, n))
        assert engine.cholesky_invert(matrix.copy(), n, inverse)
        assert inverse == pytest.approx(np.linalg.inv(matrix), rel=1e-8, abs=1e-10)
    root = rng.standard_normal((3, 3))
    inverse = np.empty((3, 3))
    assert engine.invert_3(root @ root.T, inverse)
    assert inverse == pytest.approx(np.linalg.inv(root @ root.T), rel=1e-8)
    flat = np.outer(root[0], root[0]) + np.outer(root[1], root[1])
    assert not engine.invert_3(flat, inverse)
    assert not engine.cholesky_invert(flat.copy(), 3, inverse)
    assert not engine.cholesky_invert(np.full((3, 3), np.nan), 3, inverse)


def random_rows(seed=2, n_sats=7, n_groups=2):
    """Single differences of one epoch with random geometry and unequal variances."""
    rng = np.random.default_rng(seed)
    m = n_sats * n_groups
    design = np.tile(rng.standard_normal((n_sats, 3)), (n_groups, 1))
    design /= np.linalg.norm(design, axis=1, keepdims=True)
    variance = 1e-5 * rng.uniform(0.5, 3.0, m)
    group = np.repeat(np.arange(n_groups), n_sats)
    y = 0.3 * rng.standard_normal(m)
    return y, design, variance, group


def centred(y, design, variance, group):
    """Outputs of the kernel: weights, centred design and observation, group totals, count."""
    m = len(y)
    w, hc, yc, total = np.empty(m), np.empty((m, 3)), np.empty(m), np.empty(m)
    n = engine.centre(0, m, y, design, variance, group, w, hc, yc, total)
    return w, hc, yc, total, n


def difference_operator(group, references):
    """Double differences against any reference row of each group."""
    lines = []
    for i, g in enumerate(group):
        if i != references[g]:
            line = np.zeros(len(group))
            line[i], line[references[g]] = 1.0, -1.0
            lines.append(line)
    return np.array(lines)


@pytest.mark.parametrize("references", [(0, 7), (3, 9), (6, 13)])
def test_centring_is_the_adjustment_of_double_differences(references):
    y, design, variance, group = random_rows()
    w, hc, yc, _, n = centred(y, design, variance, group)
    information, rhs = np.zeros((3, 3)), np.zeros(3)
    engine.accumulate(len(y), w, hc, yc, information, rhs)
    operator = difference_operator(group, references)
    weight = np.linalg.inv((operator * variance) @ operator.T)
    h, d = operator @ design, operator @ y
    assert n == len(operator)
    assert information == pytest.approx(h.T @ weight @ h, rel=1e-9)
    assert rhs == pytest.approx(h.T @ weight @ d, rel=1e-9)
    b = np.linalg.solve(information, rhs)
    residual = np.empty(len(y))
    chi2 = engine.residual_sum(len(y), w, hc, yc, b, residual)
    v = d - h @ b
    assert chi2 == pytest.approx(v @ weight @ v, rel=1e-9)


def test_the_worst_row_is_the_largest_normalised_residual():
    y, design, variance, group = random_rows(n_sats=8)
    rng = np.random.default_rng(3)
    y = design @ [0.3, -0.2, 0.1] + np.sqrt(variance) * rng.standard_normal(len(y))
    y[11] += 0.05
    w, hc, yc, total, _ = centred(y, design, variance, group)
    information, rhs = np.zeros((3, 3)), np.zeros(3)
    engine.accumulate(len(y), w, hc, yc, information, rhs)
    cov = np.linalg.inv(information)
    residual = np.empty(len(y))
    engine.residual_sum(len(y), w, hc, yc, cov @ rhs, residual)
    # Covariance of the residuals with the clocks of both groups and the baseline as unknowns.
    full = np.column_stack([design, group == 0, group == 1]).astype(float)
    cov_x = np.linalg.inv(full.T @ (w[:, None] * full))
    size = np.abs(residual) / np.sqrt(variance - np.einsum("ij,jk,ik->i", full, cov_x, full))
    worst, largest = engine.worst_row(len(y), w, hc, total, residual, cov)
    assert worst == 11 == np.argmax(size)
    assert largest == pytest.approx(size[11], rel=1e-8)


def batch_information(epochs, n_slots):
    """Information on the ambiguities from dense normal equations, baselines and clocks eliminated."""
    information, vector = np.zeros((n_slots, n_slots)), np.zeros(n_slots)
    for y, design, variance, group, slot, lam in epochs:
        nuisance = np.column_stack([design, *(group == g for g in np.unique(group))]).astype(float)
        a = np.zeros((len(y), n_slots))
        a[np.arange(len(y)), slot] = lam
        w = np.diag(1.0 / variance)
        reduced = w - w @ nuisance @ np.linalg.inv(nuisance.T @ w @ nuisance) @ nuisance.T @ w
        information += a.T @ reduced @ a
        vector += a.T @ reduced @ y
    return information, vector


def remembered(epochs, n_slots, share=1.0):
    """The same by the kernel."""
    memory, vector = np.zeros((n_slots + 3, n_slots + 3)), np.zeros(n_slots + 3)
    for y, design, variance, group, slot, lam in epochs:
        w, hc, yc, total, _ = centred(y, design, variance, group)
        information, rhs = np.zeros((3, 3)), np.zeros(3)
        engine.accumulate(len(y), w, hc, yc, information, rhs)
        cov = np.linalg.inv(information)
        engine.remember(len(y), lam, group, slot, w, hc, yc, total, cov, rhs, share, memory, vector)
    return memory, vector


def moving_epochs(n_epochs=4, n_sats=7):
    """Epochs with changing geometry; rows in another order at each, so slots are not row numbers."""
    rng = np.random.default_rng(4)
    found = []
    for k in range(n_epochs):
        y, design, variance, group = random_rows(seed=10 + k, n_sats=n_sats)
        slot = np.concatenate([rng.permutation(n_sats), n_sats + rng.permutation(n_sats)])
        lam = np.repeat(WAVELENGTHS_M, n_sats)
        found.append((y, design, variance, group, slot, lam))
    return found


def test_the_memory_is_the_marginal_of_the_batch_adjustment():
    epochs = moving_epochs()
    memory, vector = remembered(epochs, 14)
    information, right = batch_information(epochs, 14)
    assert memory[:14, :14] == pytest.approx(information, rel=1e-9, abs=1e-9 * information.max())
    assert vector[:14] == pytest.approx(right, rel=1e-9, abs=1e-9 * np.abs(right).max())
    # Nothing is known of the level of a group, so no reference satellite matters.
    for g in range(2):
        ones = np.zeros(14)
        ones[7 * g : 7 * g + 7] = 1.0 / WAVELENGTHS_M[g]
        assert memory[:14, :14] @ ones == pytest.approx(0.0, abs=1e-9 * information.max())
    half, _ = remembered(epochs, 14, share=0.5)
    assert half == pytest.approx(0.5 * memory, rel=1e-12, abs=1e-9)


def test_forgetting_marginalises():
    epochs = moving_epochs()
    memory, vector = remembered(epochs, 14)
    information, right = memory[:14, :14].copy(), vector[:14].copy()
    slot_arc = np.arange(17) + 100
    n_slots = engine.forget(memory, vector, slot_arc, 14, 4)
    assert n_slots == 13
    order = [0, 1, 2, 3, 13, 5, 6, 7, 8, 9, 10, 11, 12]
    assert slot_arc[:13].tolist() == [100 + k for k in order]
    keep = (
        information[np.ix_(order, order)]
        - np.outer(information[order, 4], information[4, order]) / information[4, 4]
    )
    wanted = right[order] - information[order, 4] * right[4] / information[4, 4]
    assert memory[:13, :13] == pytest.approx(keep, rel=1e-9, abs=1e-9 * keep.max())
    assert vector[:13] == pytest.approx(wanted, rel=1e-9, abs=1e-9 * np.abs(wanted).max())
    assert not memory[13:].any()
    assert not memory[:, 13:].any()
    assert not vector[13:].any()
    # A slot that knows nothing goes without a trace.
    before = memory.copy()
    assert engine.forget(memory, vector, slot_arc, 14, 13) == 13
    assert memory == pytest.approx(before)


def length_hessian(information, free, b, length, sd):
    """Numerical Hessian of the objective at b."""

    def cost(x):
        return 0.5 * (x - free) @ information @ (x - free) + 0.5 * ((np.linalg.norm(x) - length) / sd) ** 2

    h, hessian = 1e-5, np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            e, f = h * np.eye(3)[i], h * np.eye(3)[j]
            hessian[i, j] = (cost(b + e + f) - cost(b + e - f) - cost(b - e + f) + cost(b - e - f)) / (
                4 * h * h
            )
    return hessian


@pytest.mark.parametrize("sd", [0.5e-3, 3e-3, 0.02])
def test_result_with_the_length(sd):
    rng = np.random.default_rng(5)
    root = rng.standard_normal((3, 3))
    information = 1e5 * (root @ root.T + 0.3 * np.eye(3))
    free, b = np.array([0.5, 0.7, 0.55]), np.empty(3)
    length = 1.0
    engine.pull_to_length(free, information, length, sd**2, b)
    gradient = information @ (b - free) + (np.linalg.norm(b) - length) / sd**2 * b / np.linalg.norm(b)
    assert gradient == pytest.approx(0.0, abs=1e-9 * np.abs(information).max())
    row, cov, limits = np.full(engine.N_COLUMNS, np.nan), np.empty((3, 3)), np.arange(40.0)
    assert engine.write_result(free, b, information, cov, 3.0, 4, length, sd**2, True, limits, row)
    assert cov == pytest.approx(
        np.linalg.inv(length_hessian(information, free, b, length, sd)), rel=1e-4, abs=1e-10
    )
    assert row[engine.CHI2] == pytest.approx(3.0 + ((np.linalg.norm(b) - length) / sd) ** 2)
    assert row[engine.CHI2_DOF] == 5
    assert row[engine.CHI2_LIMIT] == 5.0
    assert row[engine.LENGTH] == pytest.approx(np.linalg.norm(free))
    u = free / np.linalg.norm(free)
    assert row[engine.LENGTH_SD] == pytest.approx(np.sqrt(u @ np.linalg.inv(information) @ u))


def test_an_exact_length_takes_all_variance_along_the_baseline():
    information = np.diag([3e5, 4e5, 2e5]) + 5e4
    b = np.array([0.3, 0.8, 0.2])
    length = float(np.linalg.norm(b))
    row, cov = np.full(engine.N_COLUMNS, np.nan), np.empty((3, 3))
    engine.write_result(b.copy(), b, information, cov, 3.0, 4, length, 0.0, True, np.arange(40.0), row)
    unit = b / length
    basis = np.linalg.svd(unit[None])[2][1:]
    assert np.sqrt(unit @ cov @ unit) == pytest.approx(1e-7, rel=0.01)
    # Across it, the inverse of the information in the tangent plane.
    assert basis @ cov @ basis.T == pytest.approx(np.linalg.inv(basis @ information @ basis.T), rel=1e-6)


# Many epochs.


def simulate(
    n_epochs=100, step_s=30.0, seed=1, phase_sd_m=0.002, code_sd_m=0.3, mask_deg=12.0, length_m=1.0,
    slips=(), told=False, n_bands=1, max_sats=99,
):  # fmt: skip
    """Rows of a turning baseline under 48 moving satellites that rise, set and change places.

    `slips` holds (epoch, rank by elevation, cycles) from that epoch on; told ones begin a new arc.
    `length_m` may be one length for each epoch.
    Returns rows, baselines, the true integers of all rows against the first row of their group, times.
    """
    rng = np.random.default_rng(seed)
    time_s = step_s * np.arange(n_epochs)
    sky = np.concatenate([circular_sky.directions_enu(time_s, phase_rad=p) for p in (0.0, 0.9)], axis=1)
    heading = 0.3 + 0.002 * time_s + seed
    baseline = np.column_stack([np.sin(heading), np.cos(heading), np.full(n_epochs, 0.1)])
    baseline *= np.broadcast_to(length_m, n_epochs)[:, None] / np.hypot(1.0, 0.1)
    ambiguity = rng.integers(-30, 30, (48, n_bands))
    parts = {name: [] for name in ("phase", "code", "design", "wavelength", "group", "arc", "truth")}
    start, in_view, passes = [0], set(), np.zeros(48, int)
    for e in range(n_epochs):
        seen = np.flatnonzero(sky[e, :, 2] > np.sin(np.radians(mask_deg)))
        seen = seen[np.argsort(-sky[e, seen, 2])][:max_sats]
        for epoch, rank, cycles in slips:
            if epoch == e:
                ambiguity[seen[rank]] += cycles
                passes[seen[rank]] += told
        for sat in set(seen.tolist()) - in_view:
            passes[sat] += 1
        in_view = set(seen.tolist())
        h = -sky[e, seen]
        for band in range(n_bands):
            clean = h @ baseline[e] + 5.0 * rng.standard_normal()
            noise = np.sqrt(2.0) * rng.standard_normal((2, len(seen)))
            parts["phase"].append(clean + WAVELENGTHS_M[band] * ambiguity[seen, band] + phase_sd_m * noise[0])
            parts["code"].append(clean + code_sd_m * noise[1])
            parts["design"].append(h)
            parts["wavelength"].append(np.full(len(seen), WAVELENGTHS_M[band]))
            parts["group"].append(np.full(len(seen), band))
            parts["truth"].append(ambiguity[seen, band] - ambiguity[seen[0], band])
            parts["arc"].append((passes[seen] * 48 + seen) * n_bands + band)
        start.append(start[-1] + n_bands * len(seen))
    c = {name: np.concatenate(blocks) for name, blocks in parts.items()}
    n = len(c["arc"])
    rows = engine_run.Rows(
        start=np.array(start), phase_m=c["phase"], code_m=c["code"], design=c["design"],
        wavelength_m=c["wavelength"], phase_variance_m2=np.full(n, 2.0 * phase_sd_m**2),
        code_variance_m2=np.full(n, 2.0 * code_sd_m**2), group=c["group"],
        arc=np.unique(c["arc"], return_inverse=True)[1].astype(np.int64),
    )  # fmt: skip
    return rows, baseline, c["truth"], time_s


def select_epochs(rows, epochs):
    """Rows of some epochs in the order given, and their indices."""
    turn = np.concatenate([np.arange(rows.start[e], rows.start[e + 1]) for e in epochs])
    start = np.concatenate(([0], np.cumsum(np.diff(rows.start)[list(epochs)])))
    names = set(rows.__dataclass_fields__) - {"start"}
    return replace(rows, start=start, **{name: getattr(rows, name)[turn] for name in names}), turn


def run_filter(rows, time_s, **options):
    """The engine with memory and holding, as method ``filter``."""
    defaults = {"length_m": 1.0, "length_sd_m": 0.003, "carry": True, "hold": True, "max_exclusions": 2}
    return engine_run.run_engine(rows, time_s=time_s, **{**defaults, **options})


def against_first(rows, integer):
    """Integers against the first row of each group that has one."""
    out = integer.copy()
    for a, b in zip(rows.start[:-1], rows.start[1:], strict=True):
        for g in np.unique(rows.group[a:b]):
            inside = a + np.flatnonzero(rows.group[a:b] == g)
            used = inside[np.isfinite(integer[inside])]
            if len(used):
                out[inside] = integer[inside] - integer[used[0]]
    return out


def wrong_rows(rows, run, truth):
    """Rows whose integer is not the true one; both against the same row of the group."""
    masked = np.where(np.isfinite(run.integer_cyc), truth, np.nan)
    gap = against_first(rows, run.integer_cyc) - against_first(rows, masked)
    return np.flatnonzero(np.isfinite(gap) & (gap != 0.0))


@pytest.mark.parametrize("n_bands", [1, 2])
def test_held_integers_survive_new_references_rising_and_setting_satellites(n_bands):
    rows, baseline, truth, time_s = simulate(n_epochs=250, step_s=45.0, n_bands=n_bands)
    first = rows.arc[rows.start[:-1]]
    assert np.sum(np.diff(first) != 0) >= 3, "the highest satellite must change"
    assert rows.arc.max() + 1 > np.diff(rows.start).max(), "satellites must rise and set"
    run = run_filter(rows, time_s)
    assert run.status[0] == Status.FIXED
    assert np.all(run.status[1:] == Status.HELD)
    assert len(wrong_rows(rows, run, truth)) == 0
    # New satellites take part after they repeat their integer three times.
    taking_part = np.add.reduceat(np.isfinite(run.integer_cyc).astype(int), rows.start[:-1])
    assert np.mean(taking_part == np.diff(rows.start)) > 0.7
    assert np.linalg.norm(run.baseline_m - baseline, axis=1).max() < 0.02
    # Nothing is released or struck.
    assert {int(kind) for kind in run.events[:, 2]} == {engine.E_FIXED, engine.E_ADDED}
    assert np.sum(run.events[:, 2] == engine.E_FIXED) == 1


def missing(rows, run):
    """Rows per epoch that took no part."""
    return np.add.reduceat(np.isnan(run.integer_cyc).astype(int), rows.start[:-1])


def test_a_told_slip_costs_its_satellites_a_few_epochs():
    rows, _, truth, time_s = simulate(n_epochs=60, step_s=5.0, slips=[(30, 2, 1), (30, 5, -3)], told=True)
    run = run_filter(rows, time_s)
    assert np.all(run.status[1:] == Status.HELD)
    assert len(wrong_rows(rows, run, truth)) == 0
    # Three epochs of votes, and the new integers stand.
    assert missing(rows, run)[29:34].tolist() == [0, 2, 2, 2, 0]


def test_an_untold_slip_is_struck_dropped_and_held_again():
    rows, _, truth, time_s = simulate(n_epochs=60, step_s=5.0, slips=[(30, 4, 1)])
    run = run_filter(rows, time_s)
    assert np.all(run.status[1:] == Status.HELD)
    assert len(wrong_rows(rows, run, truth)) == 0
    dropped = np.flatnonzero(run.events[:, 2] == engine.E_DROPPED)
    assert len(dropped) == 1
    epoch, row, _ = run.events[dropped[0]]
    assert 30 < epoch <= 30 + 2 * engine.STRIKES_TO_DROP
    # The same arc is held again with its new integer, and from then on all take part.
    added = run.events[dropped[0] + 1 :]
    assert rows.arc[row] in rows.arc[added[added[:, 2] == engine.E_ADDED, 1]]
    assert missing(rows, run)[-15:].sum() == missing(rows, run)[10:29].sum() == 0


def test_many_slips_at_once_release_everything_and_it_is_fixed_again():
    slips = [(30, rank, cycles) for rank, cycles in enumerate([1, -2, 3, 5, -1, 2, 4])]
    rows, _, truth, time_s = simulate(n_epochs=60, step_s=5.0, slips=slips)
    run = run_filter(rows, time_s)
    assert engine.E_RELEASED_RESIDUAL in run.events[run.events[:, 0] == 30, 2]
    assert len(wrong_rows(rows, run, truth)) == 0
    # The epoch stands by itself, its integers found anew.
    assert run.status[29:32].tolist() == [Status.HELD, Status.FIXED, Status.HELD]
    assert np.all(run.status[31:] == Status.HELD)
    assert np.flatnonzero(run.status == Status.FIXED).tolist() == [0, 30]


def test_a_hold_is_released_when_the_length_contradicts_it():
    # The antenna is moved while nobody tells.
    rows, _, _, time_s = simulate(step_s=5.0, length_m=np.where(np.arange(100) < 50, 1.0, 1.1))
    run = run_filter(rows, time_s)
    assert np.all(run.status[1:50] == Status.HELD)
    assert engine.E_RELEASED_LENGTH in run.events[run.events[:, 0] == 50, 2]
    assert not np.any(run.status[50:] == Status.HELD)
    assert run.reason[50] == Reason.HOLD_RELEASED
    # Unless nobody asked for the test.
    run = run_filter(rows, time_s, use_length=False, check_length=False)
    assert np.all(run.status[1:] == Status.HELD)


def test_integers_of_a_satellite_out_of_view_do_not_return_after_a_new_fix():
    # One satellite is away while all others slip and are fixed against another reference.
    rows, _, truth, time_s = simulate(n_epochs=60, step_s=5.0, slips=[(30, r, 3 + r) for r in range(8)])
    away = rows.arc[rows.start[30] + 9]
    inside = (np.arange(len(rows.arc)) >= rows.start[28]) & (np.arange(len(rows.arc)) < rows.start[34])
    keep = ~(inside & (rows.arc == away))
    counts = np.add.reduceat(keep.astype(int), rows.start[:-1])
    names = set(rows.__dataclass_fields__) - {"start"}
    gap = replace(
        rows,
        start=np.concatenate(([0], np.cumsum(counts))),
        **{name: getattr(rows, name)[keep] for name in names},
    )
    run = run_filter(gap, time_s)
    assert run.status[30] == Status.FIXED
    assert np.all(run.status[31:] == Status.HELD)
    assert len(wrong_rows(gap, run, truth[keep])) == 0
    # It comes back by votes, not as an outlier among the others.
    assert engine.E_DROPPED not in run.events[:, 2]
    back = np.flatnonzero((gap.arc == away) & (np.arange(len(gap.arc)) >= gap.start[34]))
    assert np.isnan(run.integer_cyc[back[:3]]).all()
    assert np.isfinite(run.integer_cyc[back[3:]]).all()


def test_a_fix_with_few_satellites_does_not_mix_with_what_was_held_before():
    # At epoch 30 a bridge leaves four satellites, too few to hold on to but enough to fix anew.
    rows, _, truth, time_s = simulate(n_epochs=60, step_s=5.0)
    keep = np.ones(len(rows.arc), bool)
    rank = np.arange(rows.start[31] - rows.start[30])
    keep[rows.start[30] : rows.start[31]] = np.isin(rank, [2, 5, 8, 11])
    counts = np.add.reduceat(keep.astype(int), rows.start[:-1])
    assert counts[30] == 4
    names = set(rows.__dataclass_fields__) - {"start"}
    gap = replace(
        rows,
        start=np.concatenate(([0], np.cumsum(counts))),
        **{name: getattr(rows, name)[keep] for name in names},
    )
    run = run_filter(gap, time_s)
    assert run.status[29:32].tolist() == [Status.HELD, Status.FIXED, Status.FIXED]
    assert np.all(run.status[32:] == Status.HELD)
    assert len(wrong_rows(gap, run, truth[keep])) == 0
    assert {int(kind) for kind in run.events[:, 2]} <= {engine.E_FIXED, engine.E_ADDED}


def test_backward_is_forward_where_both_hold_the_same_satellites():
    rows, _, truth, time_s = simulate(n_epochs=150)
    reverse, turn = select_epochs(rows, range(149, -1, -1))
    one, other = run_filter(rows, time_s), run_filter(reverse, time_s[::-1])
    assert len(wrong_rows(reverse, other, truth[turn])) == 0
    assert np.all(other.status >= Status.HELD)
    same = (one.n_phases == other.n_phases[::-1]) & (one.status == Status.HELD)
    same &= other.status[::-1] == Status.HELD
    assert same.mean() > 0.5
    # The same rows with the same integers are the same adjustment.
    assert one.baseline_m[same] == pytest.approx(other.baseline_m[::-1][same], abs=1e-9)
    assert one.chi2[same] == pytest.approx(other.chi2[::-1][same], rel=1e-6)


def test_memory_makes_few_satellites_enough():
    # Five satellites, phase only: an epoch alone is right four times in ten; half an hour settles it.
    alone_right, kept_right = [], []
    for seed in range(10):
        rows, _, truth, time_s = simulate(n_epochs=60, seed=seed, max_sats=5, phase_sd_m=0.003)
        alone = engine_run.run_engine(rows, length_m=1.0, use_code=False, probability=0.5)
        kept = engine_run.run_engine(rows, length_m=1.0, use_code=False, carry=True, time_s=time_s)
        last = slice(rows.start[-2], rows.start[-1])
        alone_right.append(np.array_equal(alone.integer_cyc[last], truth[last]))
        kept_right.append(np.array_equal(kept.integer_cyc[last], truth[last]))
        fixed = np.repeat(kept.status == Status.FIXED, np.diff(rows.start))
        assert not fixed[wrong_rows(rows, kept, truth)].any(), "an accepted epoch is wrong"
    assert all(kept_right)
    assert sum(alone_right) < 9


def test_what_two_correlated_epochs_teach():
    rows, _, _, time_s = simulate(n_epochs=10, step_s=1.0, max_sats=6, phase_sd_m=0.003)
    slow = engine_run.run_engine(
        rows, length_m=1.0, use_code=False, carry=True, time_s=time_s, correlation_s=1e7
    )
    # Noise that never changes: the memory holds one epoch, the first, whatever came between.
    ends, _ = select_epochs(rows, [0, 9])
    two = engine_run.run_engine(
        ends, length_m=1.0, use_code=False, carry=True, time_s=time_s[[0, 9]], correlation_s=1.0
    )
    assert slow.cost[9] == pytest.approx(two.cost[1], rel=1e-4)
    assert slow.probability[9] == pytest.approx(two.probability[1], abs=1e-4)


def test_a_fading_memory_forgets():
    rows, _, _, time_s = simulate(n_epochs=40, step_s=5.0, max_sats=6, phase_sd_m=0.003)
    one = engine_run.run_engine(
        rows, length_m=1.0, use_code=False, carry=True, memory_epochs=1.0, time_s=time_s
    )
    ends, _ = select_epochs(rows, [38, 39])
    two = engine_run.run_engine(ends, length_m=1.0, use_code=False, carry=True, time_s=time_s[38:])
    # A memory of one epoch is that of the epoch before.
    assert one.cost[39] == pytest.approx(two.cost[1], rel=1e-6)
    assert one.probability[39] == pytest.approx(two.probability[1], abs=1e-6)


def test_a_struck_phase_does_not_pin_what_the_memory_says_of_the_others():
    rows, baseline, truth, time_s = simulate(n_epochs=30, step_s=5.0, max_sats=8)
    spoilt = rows.start[29] + 3
    phase = rows.phase_m.copy()
    phase[spoilt] += 0.07
    options = {"hold": False, "use_code": False}
    run = run_filter(replace(rows, phase_m=phase), time_s, **options)
    assert np.all(run.status == Status.FIXED)
    assert len(wrong_rows(rows, run, truth)) == 0
    assert np.isnan(run.integer_cyc[spoilt])
    assert run.events[run.events[:, 0] == 29].tolist() == [[29, spoilt, engine.E_EXCLUDED]]
    # As if that satellite had left after the epoch before.
    keep = np.arange(len(phase)) != spoilt
    names = set(rows.__dataclass_fields__) - {"start"}
    without = replace(
        rows,
        start=rows.start - (np.arange(31) == 30),
        **{name: getattr(rows, name)[keep] for name in names},
    )
    clean = run_filter(without, time_s, **options)
    assert run.cost[29] == pytest.approx(clean.cost[29], rel=1e-6)
    assert run.baseline_m[29] == pytest.approx(clean.baseline_m[29], abs=1e-9)
    assert np.linalg.norm(run.baseline_m[29] - baseline[29]) < 0.02


def test_a_new_winner_must_persist():
    rows, _, truth, time_s = simulate(n_epochs=12, step_s=5.0)
    run = run_filter(rows, time_s, min_epochs_to_fix=4, hold=False)
    assert run.reason[:3].tolist() == [Reason.NOT_PERSISTENT] * 3
    assert np.all(run.status[3:] == Status.FIXED)
    assert len(wrong_rows(rows, run, truth)) == 0


def test_held_integers_wait_for_their_arcs_over_an_empty_epoch():
    rows, _, _, time_s = simulate(n_epochs=4, step_s=5.0)
    keep = np.r_[0 : rows.start[1], rows.start[2] : rows.start[4]]
    counts = np.diff(rows.start) * [1, 0, 1, 1]
    names = set(rows.__dataclass_fields__) - {"start"}
    gap = replace(
        rows,
        start=np.concatenate(([0], np.cumsum(counts))),
        **{name: getattr(rows, name)[keep] for name in names},
    )
    run = run_filter(gap, time_s)
    assert run.status.tolist() == [Status.FIXED, Status.NONE, Status.HELD, Status.HELD]
    assert run.reason[1] == Reason.TOO_FEW_SATELLITES


def resolved(status, baseline, n_phases):
    """A `ResolvedEpochs` of one row per epoch, baselines good to 2 mm."""
    n = len(status)
    table = np.full((n, engine.N_COLUMNS), np.nan)
    table[:, engine.BX : engine.BZ + 1] = baseline
    table[:, engine.COV : engine.COV + 3] = 4e-6
    table[:, engine.N_PHASES] = n_phases
    return resolution.ResolvedEpochs(
        table, np.array(status, np.uint8), np.zeros(n, np.uint8), np.arange(n), np.arange(n + 1),
        np.asarray(n_phases, float), np.asarray(n_phases, float),
    )  # fmt: skip


def test_combining_both_directions():
    one, off = [0.6, 0.8, 0.0], [0.6, 0.8, 0.1]
    forward = resolved([1, 3, 2, 2, 2], [one, one, one, one, one], [9, 9, 7, 8, 9])
    reverse = resolved([2, 1, 2, 2, 2], [one, one, one, off, one], [6, 8, 8, 8, 9])
    both = resolution._combine(forward, reverse)
    # Accepted beats float, more phases beat fewer, and integers that differ are not accepted.
    assert both.status.tolist() == [2, 3, 2, Status.FLOAT, 2]
    assert both.reason[3] == Reason.DIRECTIONS_DISAGREE
    assert both.residual_m.tolist() == [6.0, 9.0, 8.0, 8.0, 9.0]


@pytest.mark.parametrize("size", [1, 7, 40])
@pytest.mark.parametrize("mode", ["carried", "held"])
def test_blocks_of_epochs_are_the_whole_run(mode, size):
    rows, _, _, time_s = simulate(n_epochs=90, slips=[(30, 2, 1), (55, 0, 3)], n_bands=2)
    options = {"hold": mode == "held", "correlation_s": 60.0, "memory_epochs": 10.0}
    whole = run_filter(rows, time_s, **options)
    n_arcs, widest = int(rows.arc.max()) + 1, int(np.diff(rows.start).max())
    state = EngineState.begin(0, n_arcs, widest)
    every = np.arange(n_arcs)
    parts = []
    for first in range(0, 90, size):
        block, _ = select_epochs(rows, range(first, min(first + size, 90)))
        if len(parts) % 2:
            block = replace(block, arc=every[::-1][block.arc])
        parts.append(run_filter(block, time_s[first : first + size], state=state, **options))
        # Handed on under the numbers of the next block.
        state = state.go_on(every, every[::-1], n_arcs, widest)
    for name in ("table", "status", "reason", "residual_m", "integer_cyc", "numbers"):
        joined = np.concatenate([getattr(part, name) for part in parts])
        np.testing.assert_array_equal(joined, getattr(whole, name), err_msg=name)
    assert np.mean(whole.status >= Status.HELD) > 0.9
    assert len(whole.events)


def test_a_state_keeps_what_goes_on_and_nothing_else():
    rows, _, _, time_s = simulate(n_epochs=20)
    state = EngineState.begin(0, int(rows.arc.max()) + 1, int(np.diff(rows.start).max()))
    run_filter(rows, time_s, state=state)
    live = np.unique(rows.arc[rows.start[-2] :])
    new = state.go_on(live, 3 + np.arange(len(live))[::-1], len(live) + 5, 2)
    n = int(new.carried[engine.N_SLOTS])
    assert n == len(live)
    assert (
        np.isfinite(new.arc_value[engine.HELD]).sum() == np.isfinite(state.arc_value[engine.HELD, live]).sum()
    )
    # The slot of an arc names that arc.
    slots = new.arc_number[engine.SLOT]
    assert sorted(slots[slots >= 0]) == list(range(n))
    assert new.slot_arc[slots[slots >= 0]].tolist() == np.flatnonzero(slots >= 0).tolist()
    assert new.memory[:n, :n] == pytest.approx(state.memory[:n, :n], abs=0.0)
    assert not new.memory[n:].any()
