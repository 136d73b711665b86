"""Phase centres that turn with the platform, and maps of what antennas add, against the emulator's truth."""

import numpy as np
import pytest

import truenorth as tn
from truenorth.calibration import calibrate_array
from truenorth.calibration.phase_centres import (
    attitude_of_rows,
    correct_phases,
    direction_in_antenna,
    directions_of_rows,
    phase_centre_correction_m,
)
from truenorth.calibration.phase_maps import CSV_HEAD, PhaseMap, map_residuals, map_rows, read_phase_maps
from truenorth.calibration.sources import vectors_of_baselines
from truenorth.errors import ConfigError, FormatError, NoSolutionError
from truenorth.formats import parse_antex
from truenorth.rotations import rot_ned_from_body

L1_M = 299_792_458.0 / 1575.42e6


def line(text, label):
    return f"{text:<60}{label:<20}\n"


def antenna(name, offset_mm, slope_mm):
    zenith = np.arange(0.0, 91.0, 10.0)
    values = "".join(f"{slope_mm * (1.0 - np.cos(np.radians(z))):8.2f}" for z in zenith)
    return (
        line("", "START OF ANTENNA")
        + line(f"{name:<20}{'':<20}", "TYPE / SERIAL NO")
        + line("     0.0", "DAZI")
        + line("     0.0  90.0  10.0", "ZEN1 / ZEN2 / DZEN")
        + line("   G01", "START OF FREQUENCY")
        + line("".join(f"{x:10.2f}" for x in offset_mm), "NORTH / EAST / UP")
        + "   NOAZI"
        + values
        + "\n"
        + line("   G01", "END OF FREQUENCY")
        + line("", "END OF ANTENNA")
    )


ANTEX_TEXT = (
    line("     1.4            M", "ANTEX VERSION / SYST")
    + line("A", "PCV TYPE / REFANT")
    + line("", "END OF HEADER")
    + antenna("FLATPATCH       NONE", (12.0, -5.0, 40.0), 8.0)
    + antenna("CHOKERING       NONE", (0.5, 0.3, 90.0), -4.0)
)
ANTEX = parse_antex(ANTEX_TEXT.encode())


def test_an_antenna_whose_mark_looks_to_the_right_sees_forward_on_its_left():
    rot = rot_ned_from_body(np.radians(90.0), 0.0, 0.0)
    east = np.array([0.0, np.cos(0.5), -np.sin(0.5)])
    azimuth, elevation = direction_in_antenna(rot, east)
    assert azimuth == pytest.approx(0.0, abs=1e-12)
    assert elevation == pytest.approx(0.5)
    azimuth, _ = direction_in_antenna(rot, east, np.radians(90.0))
    assert azimuth == pytest.approx(np.radians(270.0))
    # The zenith of an antenna that rolls to the right leans away from a satellite on its left.
    rolled = rot_ned_from_body(0.0, 0.0, np.radians(10.0))
    _, elevation = direction_in_antenna(rolled, np.array([0.0, -np.cos(0.5), -np.sin(0.5)]))
    assert np.degrees(elevation) == pytest.approx(np.degrees(0.5) - 10.0)


def scenario(**changes):
    table = {
        "name": "turntable", "duration_s": 300.0, "interval_s": 3.0, "seed": 5,
        "place": {"latitude_deg": 47.0, "longitude_deg": 15.0, "height_m": 400.0},
        "platform": {
            "antennas": [
                {"name": "a", "position_body_m": [0.0, 0.0, 0.0]},
                {"name": "b", "position_body_m": [2.0, 0.0, 0.0]},
                {"name": "c", "position_body_m": [1.0, 1.0, 0.0]},
                {"name": "d", "position_body_m": [1.0, -1.0, -0.3]},
            ]
        },
        "motion": {"kind": "turntable", "rate_dps": 7.0},
        "receiver": {"signals": {"G": ["1C"], "E": ["1C"]}},
        "sky": {"kind": "nominal", "systems": "GE"},
        "visibility": {"elevation_mask_deg": 10.0},
    }  # fmt: skip
    return table | changes


def attitude_of(simulation):
    truth = simulation.truth
    return truth["time_ns"], rot_ned_from_body(truth["heading_rad"], truth["pitch_rad"], truth["roll_rad"])


SETTINGS = {
    "method": "filter", "systems": "GE", "bands": ("L1",), "elevation_mask_deg": 10.0, "length_use": "off"
}  # fmt: skip


def solve(simulation, observations):
    base, *others = observations.values()
    return [tn.solve_baseline(base, other, simulation.navigation, **SETTINGS) for other in others]


def spread_m(simulation, baselines):
    """Errors of the baselines in the body frame: their means, and rms about the truth."""
    time_ns, rot = attitude_of(simulation)
    bodies = np.array([antenna.position_body_m for antenna in simulation.scenario.platform.antennas])
    means, rms = [], []
    for k, solution in enumerate(baselines, start=1):
        at = np.searchsorted(time_ns, solution.time_ns - 10_000_000)
        ned = solution.baseline_enu_m[:, [1, 0, 2]] * [1.0, 1.0, -1.0]
        body = np.einsum("nji,nj->ni", rot[at], ned)[solution.is_accepted]
        means.append(body.mean(0) - (bodies[k] - bodies[0]))
        rms.append(np.sqrt(np.mean(np.sum((body - (bodies[k] - bodies[0])) ** 2, axis=1))))
    return np.array(means), np.array(rms)


@pytest.mark.jit
def test_corrections_of_a_turning_platform_are_the_emulators(tmp_path):
    path = tmp_path / "antennas.atx"
    path.write_text(ANTEX_TEXT, encoding="ascii")
    table = scenario(antex=str(path))
    table["platform"]["antennas"] = [
        entry | {"receiver": {"antenna_type": kind}}
        for entry, kind in zip(
            table["platform"]["antennas"][:2], ("FLATPATCH       NONE", "CHOKERING       NONE"), strict=True
        )
    ]
    simulation = tn.simulate(table)
    time_ns, rot = attitude_of(simulation)
    corrected = {}
    for name, kind in (("a", "FLATPATCH"), ("b", "CHOKERING")):
        observations = simulation.observations[name]
        direction = directions_of_rows(observations, simulation.navigation)
        attitude = attitude_of_rows(observations, time_ns, rot)
        found = phase_centre_correction_m(
            ANTEX, f"{kind}       NONE", observations.sat, observations.signal, attitude, direction
        )
        truth = simulation.signal_truth[name]["phase_centre_m"]
        known = np.isfinite(found)
        assert np.mean(known) > 0.95
        # Directions by the broadcast from a place that is metres off.
        np.testing.assert_allclose(found[known], truth[known], atol=2e-6)
        assert np.ptp(truth) > 0.03
        corrected[name] = correct_phases(observations, found)
    before, _ = spread_m(simulation, solve(simulation, simulation.observations))
    after, _ = spread_m(simulation, solve(simulation, corrected))
    # Offsets of 12 - 0.5 and 5 + 0.3 mm turn with the platform, and the 50 mm of height partly hide.
    assert np.linalg.norm(before[0, :2]) > 0.010
    # What is left is noise of 100 epochs.
    assert np.linalg.norm(after[0, :2]) < 0.002
    assert abs(after[0, 2]) < 0.005


@pytest.mark.jit
def test_a_map_of_one_run_halves_the_multipath_of_another():
    """Masts beside the antennas that turn with the platform; half an hour later, other noise, another sky."""

    def masts(seed, start, duration_s):
        table = scenario(seed=seed, start=start, duration_s=duration_s)
        beside = {
            "a": (0.10, 1.0, 0.0),
            "b": (0.16, -1.0, 0.0),
            "c": (0.23, 0.0, -1.0),
            "d": (0.13, 0.0, 1.0),
        }
        for entry in table["platform"]["antennas"]:
            distance, forward, right = beside[entry["name"]]
            mast = {
                "name": "mast", "frame": "body", "distance_m": distance, "coefficient": 0.3,
                "normal": [forward, right, 0.0],
            }  # fmt: skip
            entry["receiver"] = {"multipath": {"reflectors": [mast]}}
        return tn.simulate(table)

    first = masts(1, "2024-06-24T08:00:00", 1200.0)
    names = list(first.observations)
    baselines = solve(first, first.observations)
    declared = np.array([antenna.position_body_m for antenna in first.scenario.platform.antennas])
    time_ns = first.observations["a"].time_ns
    calibration = calibrate_array(
        vectors_of_baselines(baselines, declared, time_ns, names=names), declared_m=declared
    )
    # Multipath that stays in the body frame moves the antennas; the statement allows for it.
    assert np.max(np.abs(calibration.positions_body_m - declared)) < 0.004
    maps = map_residuals(
        baselines,
        calibration.positions_body_m,
        calibration.time_ns,
        calibration.rot_ned_from_body,
        names=names,
    )
    assert [one.antenna for one in maps] == names
    assert all(one.repeatability > 0.9 for one in maps)
    # Only differences are seen: the maps sum to zero in every cell.
    np.testing.assert_allclose(sum(one.mean_m for one in maps)[np.isfinite(maps[0].mean_m)], 0.0, atol=1e-12)

    second = masts(2, "2024-06-24T08:30:00", 600.0)
    turn_ns, rot = attitude_of(second)
    corrected = {
        name: map_rows(second.observations[name], second.navigation, turn_ns, rot, [maps[k]])
        for k, name in enumerate(names)
    }

    def difference_m(name, observations):
        """Multipath of an antenna less that of the first, what was taken off taken off."""
        series = []
        for which in ("a", name):
            truth = second.signal_truth[which]
            off_m = (second.observations[which].phase_cyc - observations[which].phase_cyc) * L1_M
            key = np.rint(truth["time_ns"] / 3e9).astype(np.int64) * 1000 + truth["sat"]
            series.append((key, truth["phase_multipath_m"] - off_m))
        _, own, other = np.intersect1d(series[0][0], series[1][0], return_indices=True)
        return float(np.std(series[1][1][other] - series[0][1][own]))

    for name in names[1:]:
        injected = difference_m(name, second.observations)
        assert injected > 0.005
        assert difference_m(name, corrected) < 0.55 * injected
    _, before = spread_m(second, solve(second, second.observations))
    _, after = spread_m(second, solve(second, corrected))
    assert np.all(after < 0.8 * before)


@pytest.mark.jit
def test_maps_of_noise_correct_little():
    simulation = tn.simulate(scenario(duration_s=900.0))
    names = list(simulation.observations)
    baselines = solve(simulation, simulation.observations)
    declared = np.array([antenna.position_body_m for antenna in simulation.scenario.platform.antennas])
    maps = map_residuals(baselines, declared, *attitude_of(simulation), names=names)
    assert all(abs(one.repeatability) < 0.5 for one in maps)
    assert np.mean([one.share for one in maps]) < 0.4


def a_map(**changes):
    mean = np.full((8, 6), 0.004)
    mean[4:, :] = np.nan
    values = {"antenna": "a", "band": 1, "mean_m": mean, "sd_m": 0.25 * mean, "count": np.full((8, 6), 9)}
    return PhaseMap(**(values | changes))


def test_a_map_corrects_where_it_has_cells():
    found = a_map()
    half, high = np.radians(67.5), np.radians(52.5)
    assert found.correction_m(half, high) == pytest.approx(0.004)
    assert found.correction_m(np.radians(247.5), high) == 0.0
    assert found.rms_m == pytest.approx(0.004)
    assert a_map(repeatability=0.5).correction_m(half, high) == pytest.approx(0.004 * 2.0 / 3.0)
    assert a_map(repeatability=-0.5).correction_m(half, high) == 0.0
    # Between the middles of two cells the mean of both; at the zenith that of the highest.
    stepped = np.full((8, 6), 0.002)
    stepped[1] = 0.006
    between = a_map(mean_m=stepped)
    assert between.correction_m(np.radians(45.0), high) == pytest.approx(0.004)
    assert between.correction_m(half, 0.5 * np.pi) == pytest.approx(0.006)


def test_maps_are_written_and_read(tmp_path):
    path = tmp_path / "maps.csv"
    maps = (a_map(), a_map(antenna="b", band=2, repeatability=0.5))
    path.write_text("\n".join([CSV_HEAD, *(one.to_csv() for one in maps)]) + "\n", encoding="utf-8")
    back = read_phase_maps(path)
    assert [(one.antenna, one.band) for one in back] == [("a", 1), ("b", 2)]
    for one, other in zip(maps, back, strict=True):
        np.testing.assert_allclose(other.mean_m, one.share * one.mean_m, atol=1e-6)
        np.testing.assert_array_equal(other.count, one.count)
    path.write_text(CSV_HEAD + "\na,L1,0,45\n", encoding="utf-8")
    with pytest.raises(FormatError, match=r"maps.csv, line 2: this line is no cell"):
        read_phase_maps(path)
    path.write_text("time,heading\n", encoding="utf-8")
    with pytest.raises(FormatError, match="no table of phase maps"):
        read_phase_maps(path)
    with pytest.raises(FormatError, match="could not read"):
        read_phase_maps(tmp_path / "nothing.csv")


def test_a_map_needs_residuals_and_sound_cells():
    from synthetic_array import make_baselines

    baselines = make_baselines(20)
    rot = np.tile(np.eye(3), (20, 1, 1))
    with pytest.raises(ConfigError, match="cells"):
        map_residuals(
            baselines, np.zeros((4, 3)), baselines[0].time_ns, rot, names="abcd", azimuth_step_deg=0.0
        )
    with pytest.raises(NoSolutionError, match="could not map"):
        map_residuals(baselines, np.zeros((4, 3)), baselines[0].time_ns, rot * np.nan, names="abcd")
