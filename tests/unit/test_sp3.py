"""SP3 text and the interpolation of precise orbits, on a made-up circular orbit."""

import numpy as np
import pytest

from truenorth.constants import SPEED_OF_LIGHT_MPS
from truenorth.errors import FormatError
from truenorth.formats.sp3 import parse_sp3, read_sp3
from truenorth.navigation import build_navigation
from truenorth.observations import sat_id
from truenorth.orbits import (
    OrbitStatus,
    compute_satellite_states,
    compute_transmission_states,
    interpolate_precise,
)
from truenorth.timescales import NS_PER_S, gpst_to_datetime64, parse_gpst

START = parse_gpst("2024-06-24T00:00:00")
STEP = 900 * NS_PER_S
EARTH_RATE = 7.292115e-5
RADIUS, TILT = 26_560_000.0, 0.96
RATE = np.sqrt(398_600.4418e9 / RADIUS**3)


def circle(time_ns, phase=0.0):
    """Position and velocity (Earth-fixed) of a circular orbit about an Earth that turns steadily."""
    t = (np.asarray(time_ns) - START) / NS_PER_S
    u, turn = RATE * t + phase, EARTH_RATE * t
    x, y, z = np.cos(u), np.sin(u) * np.cos(TILT), np.sin(u) * np.sin(TILT)
    vx, vy, vz = -RATE * np.sin(u), RATE * np.cos(u) * np.cos(TILT), RATE * np.cos(u) * np.sin(TILT)
    c, s = np.cos(turn), np.sin(turn)
    position = RADIUS * np.stack([x * c + y * s, y * c - x * s, z], axis=-1)
    velocity = RADIUS * np.stack([vx * c + vy * s, vy * c - vx * s, vz], axis=-1)
    velocity[..., 0] += EARTH_RATE * position[..., 1]
    velocity[..., 1] -= EARTH_RATE * position[..., 0]
    return position, velocity


def clock_us(time_ns):
    return 120.0 + 1e-5 * (time_ns - START) / NS_PER_S


def text(version="c", n_epochs=24, sats=("G01", "E11"), scale="GPS", skip=()):
    """An SP3 file of the circle; every satellite has its own phase."""
    lines = [f"#{version}P2024  6 24  0  0  0.00000000{n_epochs:8d} ORBIT ITRF2 BHN MADE"]
    lines += ["## 2320  86400.00000000   900.00000000 60485 0.0000000000000"]
    lines += [f"+  {len(sats):3d}   " + "".join(sats) + "  0" * (17 - len(sats))]
    lines += ["++       " + "".join(f"{5:3d}" for _ in sats) + "  0" * (17 - len(sats))]
    lines += [f"%c M  cc {scale} ccc cccc cccc cccc cccc ccccc ccccc ccccc ccccc", "/* MADE UP"]
    for k in range(n_epochs):
        time_ns = START + k * STEP
        stamp = str(gpst_to_datetime64(time_ns))
        lines.append(
            f"*  2024 {int(stamp[5:7]):2d} {int(stamp[8:10]):2d} {int(stamp[11:13]):2d}"
            f" {int(stamp[14:16]):2d} {0.0:11.8f}"
        )
        for j, sat in enumerate(sats):
            x, y, z = circle(time_ns, j)[0] / 1e3
            values = f"{x:14.6f}{y:14.6f}{z:14.6f}{clock_us(time_ns):14.6f}"
            if (k, sat) in skip:
                values = f"{0.0:14.6f}{0.0:14.6f}{0.0:14.6f}{999999.999999:14.6f}"
            lines.append(f"P{sat}{values}")
    return "\n".join([*lines, "EOF"]) + "\n"


def test_everything_of_the_file_arrives(tmp_path):
    path = tmp_path / "made.sp3"
    path.write_text(text())
    orbits = read_sp3(path)
    assert (orbits.n_epochs, orbits.n_sats) == (24, 2)
    assert list(orbits.sat) == [sat_id("G01"), sat_id("E11")]
    assert orbits.time_ns[0] == START
    assert orbits.time_ns[-1] == START + 23 * STEP
    np.testing.assert_allclose(orbits.position_ecef_m[:, 1], circle(orbits.time_ns, 1)[0], atol=1e-3)
    np.testing.assert_allclose(orbits.clock_s[5], 1e-6 * clock_us(START + 5 * STEP), atol=1e-12)
    np.testing.assert_array_equal(orbits.sd_m, [0.032, 0.032])
    assert (orbits.frame, orbits.agency, orbits.path) == ("ITRF2", "MADE", str(path))


@pytest.mark.parametrize("version", ["a", "b", "c", "d"])
def test_versions(version):
    sats = ("  1", " 22") if version == "a" else ("G01", "G22")
    orbits = parse_sp3(text(version, 3, sats).encode())
    assert list(orbits.sat) == [1, 22]
    assert np.isfinite(orbits.position_ecef_m).all()


@pytest.mark.parametrize(
    ("scale", "shift_s"), [("GPS", 0), ("ccc", 0), ("GAL", 0), ("UTC", 18), ("BDT", 14), ("TAI", -19)]
)
def test_time_scales(scale, shift_s):
    assert parse_sp3(text(scale=scale, n_epochs=2).encode()).time_ns[0] == START + shift_s * NS_PER_S


def test_missing_values_and_short_last_lines():
    made = text(skip={(3, "E11")})
    orbits = parse_sp3(made.encode())
    assert np.isnan(orbits.position_ecef_m[3, 1]).all()
    assert np.isnan(orbits.clock_s[3, 1])
    assert np.isfinite(orbits.position_ecef_m[3, 0]).all()
    cut = "\r\n".join([*made.splitlines()[:-2], "PE11 -2925.0"])
    assert np.isnan(parse_sp3(cut.encode()).position_ecef_m[-1, 1]).all()
    no_clock = "\n".join(line[:46] if line.startswith("P") else line for line in made.splitlines())
    assert np.isnan(parse_sp3(no_clock.encode()).clock_s).all()


@pytest.mark.parametrize(
    ("made", "message"),
    [
        ("", "not SP3"),
        ("     3.04           N\n", "not SP3"),
        ("#cP2024  6 24\n", "no positions"),
        (text().replace("PG01", "PG0x", 1), "is not a satellite"),
        (text().replace("*  2024  6 24  0 15", "*  2024  6 24  0 00"), "not later"),
        (text().replace("*  2024  6 24  0 15", "*  2024 16 24  0 15"), "is not a time"),
        (text().replace("   120.000000", "   12O.000000", 1), "is not a number"),
        (
            "#cP\n" + "\n".join(line for line in text().splitlines() if line[0] == "P"),
            "before the first epoch",
        ),
        ("\n".join(line[:30] if line[0] == "P" else line for line in text().splitlines()), "too short"),
    ],
)
def test_bad_text_is_refused(made, message):
    with pytest.raises(FormatError, match=message):
        parse_sp3(made.encode(), path="made.sp3")


def test_interpolation_follows_the_circle():
    orbits = parse_sp3(text().encode())
    # Eight epochs in from the ends the eleven nodes lie around the time.
    at = START + np.arange(6 * 900 + 17, 17 * 900, 211) * NS_PER_S
    position, velocity, clock, drift, status = interpolate_precise(orbits, np.full(len(at), 211), at)
    true_position, true_velocity = circle(at, 1)
    assert not status.any()
    # Truncation of the polynomial: below 1 mm at 15 min; the nodes are rounded to 1 mm in the file.
    np.testing.assert_allclose(position, true_position, rtol=0, atol=2e-3)
    np.testing.assert_allclose(velocity, true_velocity, rtol=0, atol=1e-5)
    # A circle has no periodic relativity. The clock is written to 1e-12 s.
    np.testing.assert_allclose(clock, 1e-6 * clock_us(at), rtol=0, atol=2e-12)
    np.testing.assert_allclose(drift, 1e-11, rtol=1e-3)


def test_epochs_themselves_and_the_ends():
    orbits = parse_sp3(text().encode())
    position, _, _, _, status = interpolate_precise(orbits, np.full(24, 1), orbits.time_ns)
    assert not status.any()
    np.testing.assert_allclose(position, orbits.position_ecef_m[:, 0], rtol=0, atol=1e-6)
    outside = np.array([START - 1, orbits.time_ns[-1] + 1])
    assert list(interpolate_precise(orbits, [1, 1], outside)[4]) == [OrbitStatus.TOO_OLD] * 2


def test_gaps_and_unknown_satellites():
    orbits = parse_sp3(text(skip={(12, "E11")}).encode())
    at = START + 12 * STEP + 100
    assert list(interpolate_precise(orbits, [1, 211, 7, 999], np.full(4, at))[4]) == [
        OrbitStatus.OK,
        OrbitStatus.NOT_COMPUTABLE,  # no clock on one side
        OrbitStatus.NO_EPHEMERIS,
        OrbitStatus.NO_EPHEMERIS,
    ]
    near = START + 9 * STEP + 100
    assert interpolate_precise(orbits, [211], near)[4][0] == OrbitStatus.TOO_OLD
    few = parse_sp3(text(n_epochs=10).encode())
    assert interpolate_precise(few, [1], START + 5 * STEP)[4][0] == OrbitStatus.TOO_OLD


def test_precise_orbits_instead_of_broadcast():
    orbits = parse_sp3(text().encode())
    tag = START + 12 * STEP + 7 * NS_PER_S
    states = compute_transmission_states(
        build_navigation(), [1, 211, 7], tag, [2.2e7, 2.3e7, 2.2e7], precise=orbits
    )
    assert list(states.status) == [OrbitStatus.OK, OrbitStatus.OK, OrbitStatus.NO_EPHEMERIS]
    np.testing.assert_array_equal(states.ura_m[:2], 0.032)
    flight_ns = np.rint((np.array([2.2e7, 2.3e7]) / SPEED_OF_LIGHT_MPS + states.clock_s[:2]) * 1e9)
    t_tx_ns = tag - flight_ns.astype(np.int64)
    there = compute_satellite_states(build_navigation(), [1, 211], t_tx_ns, precise=orbits)
    # Half a nanosecond of rounding is 2 micrometres of flight.
    np.testing.assert_allclose(states.position_ecef_m[:2], there.position_ecef_m, rtol=0, atol=3e-6)
    np.testing.assert_allclose(states.clock_s[:2], there.clock_s, rtol=0, atol=1e-16)
