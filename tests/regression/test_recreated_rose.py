"""The hardware simulator's session `moving_simulator_rose`, re-created from its truth file and navigation.

Satellites, motion and epochs are taken from the set; everything else is the emulator's. Double
differences between the moving rover and the static base must agree with the hardware's files.
"""

import numpy as np
import pytest

import truenorth as tn
from truenorth.observations import sat_name
from truenorth.simulation import simulate

FOLDER = "moving_simulator_rose"
BASE_DEG = (48.780735783, 9.171992250, 320.0)


def _scenario(folder, motion):
    return {
        "name": "rose",
        "start": "2023-01-08T10:00:00",
        "duration_s": 600.0,
        "folder": str(folder),
        "place": dict(zip(("latitude_deg", "longitude_deg", "height_m"), BASE_DEG, strict=True)),
        "platform": {"antennas": [{"name": "antenna", "position_body_m": [0.0, 0.0, 0.0]}]},
        "motion": motion,
        "sky": {
            "kind": "files",
            "files": ["RINEX_GN_Spirent.23N.gz", "RINEX_EN_Spirent.23L.gz"],
            "time_shift": "none",
        },
        # The hardware knows no wind-up.
        "environment": {"phase_windup": False},
        "receiver": {
            "signals": {"G": ["1C", "2X", "5I"], "E": ["1C", "5Q", "7Q"]},
            "noise": {"kind": "constant", "code_sd_m": 0.0, "phase_sd_m": 0.0, "doppler_sd_hz": 0.0},
            "bias": {"code_sd_m": 0.0, "phase_sd_cyc": 0.0},
            "clock": {"offset_sd_s": 0.0, "white_frequency": 0.0, "random_walk_frequency": 0.0},
        },
    }


@pytest.fixture(scope="module")
def sessions(data_dir, tmp_path_factory):
    folder = data_dir / FOLDER
    given = {
        "base": tn.read_observations(folder / "Base-static_MO_Spirent.obs.gz"),
        "rover": tn.read_observations(folder / "Rover-dynamic_MO_Spirent.obs.gz"),
    }
    motions = {
        "base": {"kind": "static"},
        "rover": {
            "kind": "table",
            "file": "Rover-dynamic_PVA_Spirent.csv.gz",
            "columns": {
                "time_s": "Time [s]",
                "x_m": "Pos ECEF X [m]", "y_m": "Pos ECEF Y [m]", "z_m": "Pos ECEF Z [m]",
                "roll_deg": "Roll [deg]", "pitch_deg": "Pitch [deg]", "heading_deg": "Yaw [deg]",
            },
        },
    }  # fmt: skip
    simulated = {
        name: simulate(_scenario(folder, motion)).observations["antenna"] for name, motion in motions.items()
    }
    return given, simulated


def _table(observations, column):
    """Values by (epoch, satellite, signal)."""
    values = getattr(observations, column)
    keys = zip(
        observations.time_ns[observations.epoch_of_row].tolist(),
        observations.sat.tolist(),
        observations.signal.tolist(),
        strict=True,
    )
    return {key: value for key, value in zip(keys, values, strict=True) if np.isfinite(value)}


def _double_differences(sessions, column):
    """Differences by signal, epoch and satellite.

    Simulated minus given, rover minus base; the receivers' clocks are still in.
    """
    given, simulated = sessions
    tables = [_table(source[name], column) for source in (simulated, given) for name in ("rover", "base")]
    common = set.intersection(*(set(table) for table in tables))
    groups = {}
    for key in sorted(common):
        time_ns, sat, signal = key
        difference = tables[0][key] - tables[1][key] - (tables[2][key] - tables[3][key])
        groups.setdefault((sat // 100, signal), {}).setdefault(time_ns, {})[sat] = difference
    return groups


def _spread(groups):
    """Residuals against the median of their epoch, which takes the clocks off; by signal and satellite."""
    rows = {}
    for (system, signal), epochs in groups.items():
        for values in epochs.values():
            middle = np.median(list(values.values()))
            for sat, value in values.items():
                rows.setdefault((system, signal, sat), []).append(value - middle)
    return {key: np.array(values) for key, values in rows.items()}


def test_codes_agree_to_a_centimetre(sessions):
    residuals = _spread(_double_differences(sessions, "code_m"))
    assert len({key[:2] for key in residuals}) == 6
    worst = max(residuals, key=lambda key: np.max(np.abs(residuals[key])))
    # Four values with three decimals each.
    assert np.max(np.abs(residuals[worst])) < 0.01, (sat_name(worst[2]), worst)
    assert np.sqrt(np.mean(np.concatenate(list(residuals.values())) ** 2)) < 0.003


def test_phases_agree_to_a_millimetre(sessions):
    residuals = _spread(_double_differences(sessions, "phase_cyc"))
    wavelength = {(0, 102): 0.19029367, (0, 223): 0.24421021, (0, 508): 0.25482805}
    wavelength |= {(2, 102): 0.19029367, (2, 516): 0.25482805, (2, 716): 0.24834937}
    for (system, signal, sat), cycles in residuals.items():
        # Each satellite has an unknown integer of its own, and the reference as well.
        metres = (cycles - np.rint(np.median(cycles))) * wavelength[system, signal]
        assert np.max(np.abs(metres - np.median(metres))) < 0.001, (sat_name(sat), signal)
        assert abs(np.median(metres)) < 0.001, (sat_name(sat), signal)
