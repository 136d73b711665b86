"""Arcs of continuous phase: slips of known size are found, and nothing else is."""

import importlib.util
import itertools
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from truenorth.ambiguity import slips
from truenorth.ambiguity.differencing import SingleDifferences
from truenorth.observations import LLI_SLIP, NO_CHANNEL, Observations, signal_id
from truenorth.timescales import NS_PER_S, gpst_from_calendar

TOOLS = Path(__file__).parents[2] / "tools"
_spec = importlib.util.spec_from_file_location("circular_sky", TOOLS / "circular_sky.py")
circular_sky = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(circular_sky)

START_NS = gpst_from_calendar(2024, 6, 24, 8, 0, 0)
WAVELENGTH_M = (0.190293673, 0.244210213)
SIGNALS = (signal_id("1C"), signal_id("2W"))


def simulate(
    n_epochs=20, n_sats=8, n_bands=1, step_s=1.0, seed=1, phase_sd_m=0.003, jumps=(), missing=(), flags=(),
    turn_m=0.2, drift_mps=30.0, doppler_sd_mps=0.03,
):  # fmt: skip
    """Single differences of a moving baseline, and the observations of both receivers.

    `jumps` holds (epoch, satellite, band, cycles), `missing` (epoch, satellite) and `flags`
    (receiver, epoch, satellite, band).
    """
    rng = np.random.default_rng(seed)
    time_s = step_s * np.arange(n_epochs)
    sky = circular_sky.directions_enu(time_s)
    chosen = np.argsort(-sky[0, :, 2])[:n_sats]
    angle = turn_m * time_s
    baseline = np.column_stack([np.cos(angle), np.sin(angle), 0.0 * angle])
    velocity = turn_m * np.column_stack([-np.sin(angle), np.cos(angle), 0.0 * angle])
    clock = drift_mps * time_s + 1e-3 * rng.standard_normal(n_epochs).cumsum()
    ambiguity = rng.integers(-50, 50, (n_sats, n_bands))
    records = []
    for e in range(n_epochs):
        for band in range(n_bands):
            for k in range(n_sats):
                for epoch, sat, b, cycles in jumps:
                    if (epoch, sat, b) == (e, k, band):
                        ambiguity[k, band] += cycles
                if (e, k) in missing:
                    continue
                h = -sky[e, chosen[k]]
                phase = h @ baseline[e] + clock[e] + WAVELENGTH_M[band] * ambiguity[k, band]
                phase += np.sqrt(2.0) * phase_sd_m * rng.standard_normal()
                doppler = h @ velocity[e] + drift_mps + doppler_sd_mps * rng.standard_normal()
                records.append((e, k + 1, band, phase, doppler, *h))
    table = np.array(records)
    n = len(table)
    epoch, sat, band = (table[:, k].astype(int) for k in range(3))
    counts = np.bincount(epoch, minlength=n_epochs)
    start = np.concatenate(([0], np.cumsum(counts))).astype(np.int64)
    time_ns = START_NS + np.round(time_s * NS_PER_S).astype(np.int64)
    signal = np.array(SIGNALS)[band].astype(np.int16)
    receivers = []
    for receiver in range(2):
        lli = np.zeros(n, np.uint8)
        for at, e, k, b in flags:
            if at == receiver:
                lli[(epoch == e) & (sat == k + 1) & (band == b)] = LLI_SLIP
        receivers.append(
            Observations(
                time_ns=time_ns,
                epoch_start=start,
                sat=sat.astype(np.int16),
                signal=signal,
                code_m=np.full(n, 2e7),
                phase_cyc=np.zeros(n),
                doppler_hz=np.zeros(n),
                cn0_dbhz=np.full(n, 45.0),
                lli=lli,
                clock_offset_s=np.full(n_epochs, np.nan),
                glonass_channel=np.full(100, NO_CHANNEL, dtype=np.int8),
            )
        )
    differences = SingleDifferences(
        time_ns=time_ns, base_epoch=np.arange(n_epochs), rover_epoch=np.arange(n_epochs),
        position_ecef_m=np.zeros((n_epochs, 3)), rot_enu_from_ecef=np.tile(np.eye(3), (n_epochs, 1, 1)),
        has_position=np.ones(n_epochs, bool), start=start, sat=sat.astype(np.int16), signal=signal,
        group=band.astype(np.int64), phase_m=table[:, 3].copy(), code_m=np.full(n, np.nan),
        design_enu=np.ascontiguousarray(table[:, 5:8]), wavelength_m=np.array(WAVELENGTH_M)[band],
        phase_variance_m2=np.full(n, 2.0 * phase_sd_m**2), code_variance_m2=np.full(n, 0.18),
        elevation_rad=np.full(n, 0.7), azimuth_rad=np.zeros(n), doppler_mps=table[:, 4].copy(),
        lli=receivers[0].lli | receivers[1].lli, integer_ok=np.ones(n, bool), group_names=("G 1C", "G 2W"),
        glonass_channel=np.zeros(n), base_row=np.arange(n), rover_row=np.arange(n),
    )  # fmt: skip
    return differences, *receivers


def arcs_of(differences, found, sat, band=0):
    """Arcs of one satellite and band, epoch by epoch."""
    mask = (differences.sat == sat + 1) & (differences.signal == SIGNALS[band])
    return found.arc[mask]


def slips_of(found):
    """Sorted (seconds from the start, satellite, kind) of the slips."""
    return sorted(
        ((time_ns - START_NS) / NS_PER_S, int(name[1:]) - 1, text.partition(" by the ")[2].partition(":")[0])
        for time_ns, kind, name, _, _, _, text in found.events
        if kind == "slip"
    )


@pytest.mark.parametrize("n_bands", [1, 2])
@pytest.mark.parametrize("turn_m", [0.0, 0.2])
def test_without_slips_there_is_one_arc_per_signal(n_bands, turn_m):
    differences, base, rover = simulate(n_epochs=60, n_bands=n_bands, turn_m=turn_m)
    found = slips.find_arcs(differences, base, rover, baseline_change_m=1.0)
    assert found.n_arcs == 8 * n_bands
    assert found.events == []


@pytest.mark.parametrize("cycles", [1, -1, 2, 7, 1000])
@pytest.mark.parametrize("sat", [0, 3, 7])
def test_a_slip_of_one_satellite_is_found_and_told(cycles, sat):
    differences, base, rover = simulate(jumps=[(8, sat, 0, cycles)])
    found = slips.find_arcs(differences, base, rover, baseline_change_m=1.0)
    assert slips_of(found) == [(8.0, sat, "time-differenced phase")]
    arc = arcs_of(differences, found, sat)
    assert len(set(arc[:8])) == len(set(arc[8:])) == 1
    assert arc[7] != arc[8]
    assert found.n_arcs == 9
    statistic, limit = found.events[0][4:6]
    # The jump, less what the others' adjustment leaves of it: none, since it was taken out.
    assert statistic == pytest.approx(cycles * WAVELENGTH_M[0], abs=0.03)
    assert abs(statistic) > limit


@pytest.mark.parametrize("n_sats", [6, 7])
def test_a_satellite_that_holds_the_adjustment_down_is_blamed_itself(n_sats):
    # Noise as small as the highest satellites have: one of low redundancy bends the adjustment towards its
    # slip, and the largest plain residual is then another one's.
    for sat in range(n_sats):
        differences, base, rover = simulate(n_sats=n_sats, jumps=[(5, sat, 0, 7)], phase_sd_m=0.001)
        differences.phase_variance_m2[differences.sat == sat + 1] /= 9.0
        found = slips.find_arcs(differences, base, rover, baseline_change_m=1.0)
        assert [(t, k) for t, k, _ in slips_of(found)] == [(5.0, sat)]


def test_slips_of_two_satellites_at_one_epoch_are_both_found():
    differences, base, rover = simulate(jumps=[(5, 1, 0, 1), (5, 6, 0, -4)], n_sats=9)
    found = slips.find_arcs(differences, base, rover, baseline_change_m=1.0)
    assert [(t, sat) for t, sat, _ in slips_of(found)] == [(5.0, 1), (5.0, 6)]


def test_a_slip_on_one_of_two_bands_leaves_the_other_alone_or_breaks_both():
    differences, base, rover = simulate(jumps=[(5, 2, 1, 1)], n_bands=2)
    found = slips.find_arcs(differences, base, rover, baseline_change_m=1.0)
    assert {(t, sat) for t, sat, _ in slips_of(found)} == {(5.0, 2)}
    assert len(set(arcs_of(differences, found, 2, band=1))) == 2
    assert len(set(arcs_of(differences, found, 2, band=0))) == 1


@pytest.mark.parametrize("n_sats", [2, 3, 4])
@pytest.mark.parametrize("band", [0, 1])
def test_few_satellites_do_not_tell_which_band_slipped_so_both_did(n_sats, band):
    differences, base, rover = simulate(n_sats=n_sats, n_bands=2, jumps=[(5, 1, band, 1)], turn_m=0.0)
    found = slips.find_arcs(differences, base, rover, baseline_change_m=1.0)
    for b in range(2):
        arc = arcs_of(differences, found, 1, band=b)
        assert arc[4] != arc[5]
    assert {(t, sat) for t, sat, _ in slips_of(found)} == {(5.0, 1)}
    assert "geometry-free combination" in [kind for _, _, kind in slips_of(found)]


def test_doppler_tells_with_few_satellites():
    differences, base, rover = simulate(n_sats=3, jumps=[(5, 2, 0, 6)])
    found = slips.find_arcs(differences, base, rover, baseline_change_m=1.0)
    assert (5.0, 2, "Doppler prediction") in slips_of(found)
    assert {sat for _, sat, _ in slips_of(found)} == {2}


@pytest.mark.parametrize("receiver", [0, 1])
def test_a_loss_of_lock_of_either_receiver_ends_the_arc(receiver):
    differences, base, rover = simulate(flags=[(receiver, 6, 4, 0)])
    found = slips.find_arcs(differences, base, rover, baseline_change_m=1.0)
    assert slips_of(found) == [(6.0, 4, "loss-of-lock flag")]
    arc = arcs_of(differences, found, 4)
    assert arc[5] != arc[6]
    assert len(set(arc)) == 2


def test_a_flag_at_an_epoch_without_a_difference_counts_at_the_next():
    differences, base, rover = simulate(flags=[(1, 6, 4, 0)])
    # The base has nothing of this satellite at that epoch, so there is no single difference of it.
    lost = np.flatnonzero((differences.sat == 5) & (differences.epoch_of_row == 6))
    differences.phase_m[lost] = np.nan
    found = slips.find_arcs(differences, base, rover, baseline_change_m=1.0)
    assert slips_of(found) == [(7.0, 4, "loss-of-lock flag")]
    assert found.arc[lost].tolist() == [-1]


@pytest.mark.parametrize("drift_mps", [0.0, 30.0, -300.0])
@pytest.mark.parametrize("turn_m", [0.0, 0.2])
def test_gaps_end_an_arc_only_when_they_are_long(drift_mps, turn_m):
    # The others' change of clock and baseline over the gap is known, however fast.
    gone = [(e, 3) for e in range(5, 10)]
    for step_s, n_arcs in ((1.0, 8), (10.0, 9)):
        differences, base, rover = simulate(
            missing=gone, step_s=step_s, turn_m=turn_m / step_s, drift_mps=drift_mps
        )
        found = slips.find_arcs(differences, base, rover, baseline_change_m=1.0)
        assert found.n_arcs == n_arcs
        assert found.events == []


def test_a_slip_inside_a_short_gap_is_found_after_it():
    differences, base, rover = simulate(
        missing=[(e, 3) for e in range(5, 8)], jumps=[(8, 3, 0, 2)], turn_m=0.05
    )
    found = slips.find_arcs(differences, base, rover, baseline_change_m=1.0)
    assert [(t, sat) for t, sat, _ in slips_of(found)] == [(8.0, 3)]


def test_noise_alone_breaks_no_arcs():
    # 8 standard deviations and a quarter cycle: nothing in 8 x 500 differences, noise as modelled.
    differences, base, rover = simulate(n_epochs=500, phase_sd_m=0.004, n_bands=1)
    found = slips.find_arcs(differences, base, rover, baseline_change_m=1.0)
    assert found.n_arcs == 8


def cut(differences, receivers, borders):
    """Blocks of differences and observations between the borders, rows counted anew in each."""
    for first, stop in itertools.pairwise(borders):
        part = slice(differences.start[first], differences.start[stop])
        per_row = {
            field.name: getattr(differences, field.name)[part]
            for field in fields(differences)
            if field.name != "time_ns" and len(getattr(differences, field.name)) == len(differences.sat)
        }
        per_epoch = ("time_ns", "position_ecef_m", "rot_enu_from_ecef", "has_position")
        block = replace(
            differences,
            **{
                name: value - part.start if name.endswith("_row") else value
                for name, value in per_row.items()
            },
            **{name: getattr(differences, name)[first:stop] for name in per_epoch},
            start=differences.start[first : stop + 1] - part.start,
        )
        yield block, *(receiver.select_epochs(slice(first, stop)) for receiver in receivers)


@pytest.mark.parametrize("size", [1, 7, 20])
@pytest.mark.parametrize("case", ["one flag", "slips", "few satellites", "slow"])
def test_blocks_have_the_arcs_of_the_whole(case, size):
    options = {
        "one flag": {},
        "slips": {
            "jumps": [(8, 3, 0, 2), (20, 1, 1, -1), (20, 4, 0, 5)],
            "flags": [(0, 14, 2, 0), (1, 21, 5, 1), (0, 35, 6, 0)],
            "missing": [(e, 6) for e in range(30, 38)] + [(e, 5) for e in range(20, 23)],
        },
        "few satellites": {"n_sats": 3, "jumps": [(20, 2, 0, 6)]},
        "slow": {"step_s": 10.0, "missing": [(e, 3) for e in range(19, 23)] + [(e, 1) for e in (24, 25)]},
    }[case]
    differences, *receivers = simulate(n_epochs=45, **{"n_bands": 2, **options})
    # A flag at an epoch of one receiver only, around the border between two blocks.
    lost = np.flatnonzero((differences.sat == 2) & np.isin(differences.epoch_of_row, (20, 21)))
    differences.phase_m[lost] = np.nan
    receivers[1].lli[lost[0]] = LLI_SLIP
    whole = slips.find_arcs(differences, *receivers, baseline_change_m=1.0)
    past, events, number, n_arcs, arc = slips.NO_ARCS, [], {}, 0, []
    for block in cut(differences, receivers, [*range(0, 45, size), 45]):
        found = slips.find_arcs(*block, baseline_change_m=1.0, past=past)
        # Numbers of the run for those of the block: known for what goes on, new for what begins.
        now = {here: number[was] for was, here in zip(past.arc.tolist(), found.resumed.tolist(), strict=True)}
        for here in range(found.n_arcs):
            if here not in now:
                now[here] = n_arcs
                n_arcs += 1
        arc += [now.get(here, -1) for here in found.arc.tolist()]
        past, number = found.ends, now
        events += found.events
    # The same partition of the rows, under other numbers.
    pairs = set(zip(arc, whole.arc.tolist(), strict=True)) - {(-1, -1)}
    assert len(pairs) == n_arcs == whole.n_arcs
    assert len({a for a, _ in pairs}) == len({b for _, b in pairs}) == n_arcs
    assert whole.events
    # As text, because what a flag tells has no statistic and NaN differs from itself.
    assert str(events) == str(sorted(whole.events, key=lambda event: event[0]))
