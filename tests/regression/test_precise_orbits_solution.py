"""Precise orbits in the place of broadcast ones: the baseline of a pair must not move."""

from dataclasses import replace

import numpy as np

import truenorth
from truenorth.navigation import PreciseOrbits
from truenorth.observations import sat_id
from truenorth.orbits import compute_satellite_states, select_ephemerides
from truenorth.timescales import NS_PER_S


def _tabulate(navigation, first_ns, last_ns):
    """Orbits of the broadcast ephemerides on a five-minute grid, as an SP3 file would hold them."""
    step = 300 * NS_PER_S
    start = first_ns // step * step - 6 * step
    time_ns = np.arange(start, last_ns + 7 * step, step)
    sats = np.unique(navigation.kepler.sat)
    sats = sats[sats < sat_id("R01")]
    position = np.empty((len(time_ns), len(sats), 3))
    clock = np.empty((len(time_ns), len(sats)))
    for k, sat in enumerate(sats):
        # One ephemeris for the whole table, also where it would no longer be used.
        index, _ = select_ephemerides(navigation, np.array([sat]), np.array([first_ns]))
        column = np.full(len(time_ns), sat)
        ephemeris = np.full(len(time_ns), index[0])
        states = compute_satellite_states(navigation, column, time_ns, ephemeris=ephemeris)
        position[:, k] = states.position_ecef_m
        relativity = -2.0 * np.sum(states.position_ecef_m * states.velocity_ecef_mps, axis=1)
        clock[:, k] = states.clock_s - relativity / 299_792_458.0**2
    return PreciseOrbits(time_ns, sats.astype(np.int16), position, clock, np.full(len(sats), 0.01))


def test_baseline_with_tabulated_orbits_equals_the_broadcast_one(data_dir):
    folder = data_dir / "pair_1m_geodetic"
    base = truenorth.read_observations(folder / "base.obs.gz").select_epochs(slice(0, 20))
    rover = truenorth.read_observations(folder / "rover.obs.gz").select_epochs(slice(0, 20))
    navigation = truenorth.read_navigation(folder / "base.nav.gz")
    precise = replace(navigation, precise=_tabulate(navigation, base.time_ns[0], base.time_ns[-1]))
    options = {"length_m": 0.99, "systems": "G", "single_epoch": True}
    broadcast = truenorth.solve_baseline(base, rover, navigation, **options)
    tabulated = truenorth.solve_baseline(base, rover, precise, **options)
    assert broadcast.is_accepted.all()
    assert tabulated.is_accepted.all()
    # A metre of orbit is 0.05 micrometres on a metre of baseline; the table is good to centimetres.
    np.testing.assert_allclose(tabulated.baseline_enu_m, broadcast.baseline_enu_m, atol=1e-5)


def test_sp3_file_counts_as_navigation(data_dir):
    path = data_dir / "rinex_samples" / "ESA0OPSRAP_20232390000_01D_15M_ORB.SP3.gz"
    navigation = truenorth.read_navigation(path)
    assert navigation.precise is not None
    assert navigation.precise.n_sats > 50
    assert len(navigation.kepler) == 0
