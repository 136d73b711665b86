"""What `summarize` and ``truenorth info`` say of real files."""

import json
from pathlib import Path

import numpy as np
import pytest

import truenorth as tn
from truenorth.cli.info import info


@pytest.mark.jit
def test_geodetic_file(data_dir):
    found = tn.summarize(data_dir / "pair_1m_geodetic" / "base.obs.gz")
    assert (found.format, found.version) == ("rinex_obs", "3.04")
    assert found.receiver == "SEPT MOSAIC-X5"
    assert (found.n_epochs, found.interval_s, found.header_interval_s) == (301, 1.0, 1.0)
    assert (found.start_gpst, found.end_gpst) == ("2024-06-24T08:20:00.000", "2024-06-24T08:25:00.000")
    assert found.gaps == ()
    assert [(s.letter, len(s.sats)) for s in found.systems] == [
        ("G", 12),
        ("R", 9),
        ("E", 9),
        ("C", 25),
        ("J", 2),
    ]
    gps = {signal.name: signal for signal in found.systems[0].signals}
    assert list(gps) == ["1C", "2L", "2W", "5Q"]
    assert gps["1C"].code_share > 0.99
    assert 30 < gps["1C"].mean_cn0_dbhz < 50
    assert found.glonass_channels == {
        "R01": 1, "R02": -4, "R03": 5, "R11": 0, "R12": -1, "R13": -2, "R17": 4, "R18": -3, "R24": 2
    }  # fmt: skip
    # Nagoya, Japan; the header's position is good to metres, so five decimals of a degree.
    np.testing.assert_allclose(found.approx_position_deg_m, (35.13471, 136.97757, 104.7), atol=2e-5 * 5e3)
    assert found.n_slips == sum(found.slips_by_sat.values())
    assert found.n_sats_max == 57


@pytest.mark.jit
def test_ublox_file_with_losses(data_dir):
    found = tn.summarize(data_dir / "pair_0.33m_ublox" / "base.obs.gz")
    assert found.interval_s == 1.0
    # The span and the epochs found must add up to what is missing.
    n_expected = round(found.duration_s / found.interval_s) + 1
    assert found.n_epochs + sum(gap.n_missing for gap in found.gaps) == n_expected
    assert found.n_slips > 0
    assert found.n_half_cycles > 0


@pytest.mark.jit
def test_ubx_navigation_and_orbits(data_dir):
    ubx = tn.summarize(data_dir / "pair_0.33m_ublox" / "rover.ubx.gz")
    assert ubx.format == "ubx"
    assert ubx.n_epochs > 1000
    assert set(ubx.navigation.n_by_system) == {"G", "R"}
    nav = tn.summarize(data_dir / "pair_1m_geodetic" / "base.nav.gz")
    assert nav.n_epochs == 0
    assert set(nav.navigation.n_by_system["E"]) == {"INAV", "FNAV"}
    sp3 = tn.summarize(data_dir / "rinex_samples" / "ESA0OPSRAP_20232390000_01D_15M_ORB.SP3.gz")
    assert (sp3.n_epochs, sp3.interval_s) == (96, 900.0)


@pytest.mark.jit
@pytest.mark.parametrize(
    "name",
    [
        "pair_1m_geodetic/base.obs.gz",
        "pair_0.33m_ublox/base.ubx.gz",
        "pair_38m_gps/brdc0770.11n",
        "rinex_samples/npaz3550.21o",
    ],
)
def test_text_and_json(data_dir, name, capsys):
    path = data_dir / name
    info([path], True)
    found = json.loads(capsys.readouterr().out)
    assert found["path"] == str(path)
    assert found == tn.summarize(path).to_dict()
    info([path, path], True)
    assert json.loads(capsys.readouterr().out) == [found, found]
    info([Path(path)], False)
    text = capsys.readouterr().out
    assert text.startswith(str(path))
    assert found["format"] in text
    assert max(map(len, text.splitlines()[1:])) < 150
