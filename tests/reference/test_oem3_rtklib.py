"""RTKLIB reads the same from our OEM3 logs as we do."""

import shutil
import subprocess

import numpy as np
import pytest

from simulated_sky import START_NS, navigation
from truenorth.formats import read_navigation, read_observations
from truenorth.formats.novatel_oem3 import read_oem3
from truenorth.formats.novatel_oem3_writer import write_oem3
from truenorth.observations import LLI_HALF_CYCLE, LLI_SLIP, NO_CHANNEL, Observations, signal_id
from truenorth.timescales import NS_PER_S

CONVBIN = shutil.which("convbin")
WAVELENGTH_M = {1: 299_792_458.0 / 1_575.42e6, 2: 299_792_458.0 / 1_227.60e6}


def tracks(n_epochs=120, n_sats=6):
    """Two frequencies of satellites in motion, with slips, half cycles and an outage."""
    rng = np.random.default_rng(8)
    shape = (n_epochs, n_sats, 2)
    time_s = np.arange(n_epochs)[:, None, None]
    rate = np.linspace(-800.0, 800.0, n_sats)[None, :, None]
    code_m = np.broadcast_to(2.2e7 + 1e6 * np.arange(n_sats)[None, :, None] + rate * time_s, shape)
    code_m = code_m.reshape(-1) + rng.normal(0.0, 0.3, n_epochs * n_sats * 2)
    sat = np.broadcast_to(1 + 5 * np.arange(n_sats)[None, :, None], shape).reshape(-1)
    signal = np.broadcast_to(np.array([signal_id("1C"), signal_id("2W")]), shape).reshape(-1)
    wavelength_m = np.array([WAVELENGTH_M[band] for band in signal // 100])
    lli = np.zeros(len(sat), dtype=np.uint8)
    lli[rng.random(len(sat)) < 0.02] |= LLI_SLIP
    half = (sat == 11) & (np.repeat(np.arange(n_epochs), 2 * n_sats) < 30)
    lli[half] |= LLI_HALF_CYCLE
    observations = Observations(
        time_ns=START_NS + NS_PER_S * np.arange(n_epochs),
        epoch_start=np.arange(n_epochs + 1) * 2 * n_sats,
        sat=sat.astype(np.int16),
        signal=signal.astype(np.int16),
        code_m=code_m,
        phase_cyc=code_m / wavelength_m + 1e5,
        doppler_hz=-np.broadcast_to(rate, shape).reshape(-1) / wavelength_m,
        cn0_dbhz=rng.uniform(25.0, 50.0, len(sat)),
        lli=lli,
        clock_offset_s=np.full(n_epochs, np.nan),
        glonass_channel=np.full(100, NO_CHANNEL, dtype=np.int8),
    )
    out = (sat == 16) & (np.repeat(np.arange(n_epochs), 2 * n_sats) // 20 == 2)
    return observations.select_rows(~out)


@pytest.mark.jit
@pytest.mark.skipif(CONVBIN is None, reason="RTKLIB's convbin is not installed")
@pytest.mark.parametrize("ranges", ["RGED", "RGEB"])
def test_rtklib_reads_the_same(tmp_path, ranges):
    log, obs, nav = (tmp_path / f"base.{kind}" for kind in ("oem3", "obs", "nav"))
    write_oem3(log, tracks(), navigation((0,)), ranges=ranges)
    how = [CONVBIN, "-r", "oem3", "-v", "3.03", "-od", "-os", "-oi", "-tr", "2024/6/24", "8:00:00"]
    done = subprocess.run([*how, "-o", obs, "-n", nav, log], capture_output=True, check=False)
    assert obs.exists(), done.stderr
    ours, our_navigation = read_oem3(log)
    theirs, their_navigation = read_observations(obs), read_navigation(nav)

    np.testing.assert_array_equal(theirs.time_ns, ours.time_ns)
    np.testing.assert_array_equal(theirs.epoch_start, ours.epoch_start)
    np.testing.assert_array_equal(theirs.sat, ours.sat)
    np.testing.assert_array_equal(theirs.signal // 100, ours.signal // 100)  # RTKLIB calls all of L2 P
    # RINEX has three decimals; RTKLIB keeps Doppler and C/N0 of the records in singles and quarters.
    limits = {"code_m": 5.1e-4, "phase_cyc": 5.1e-4, "doppler_hz": 1.1e-3, "cn0_dbhz": 0.13}
    for name, limit in limits.items():
        off = getattr(theirs, name) - getattr(ours, name)
        assert np.max(np.abs(off)) <= limit, name
    # The first phase of a signal is no slip to RTKLIB; else both go by the lock time and the parity.
    rows = np.lexsort((ours.epoch_of_row, ours.signal, ours.sat))
    first = np.ones(ours.n_rows, dtype=bool)
    first[rows[1:]] = (np.diff(ours.sat[rows]) != 0) | (np.diff(ours.signal[rows]) != 0)
    np.testing.assert_array_equal(theirs.lli[~first] & LLI_SLIP, ours.lli[~first] & LLI_SLIP)
    assert 10 < np.sum(ours.lli[~first] & LLI_SLIP) < 60

    for name in ("sat", "toe_ns", "toc_ns", "iode", "iodc", "health"):
        np.testing.assert_array_equal(
            getattr(their_navigation.kepler, name), getattr(our_navigation.kepler, name), err_msg=name
        )
    # Twelve digits of RINEX; the last column, the fit interval, is in whole hours.
    np.testing.assert_allclose(
        their_navigation.kepler.elements[:, :-1],
        our_navigation.kepler.elements[:, :-1],
        rtol=1e-11,
        atol=0.0,
    )
    np.testing.assert_allclose(their_navigation.klobuchar["G"], our_navigation.klobuchar["G"], rtol=1e-3)
