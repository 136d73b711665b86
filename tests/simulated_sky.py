"""A sky of circular-ish orbits and a receiver under it: codes and Dopplers with known truth.

The simulation goes forward: from the time of reception back along the ray to the satellite, by
fixed-point iteration on the travel time, with `compute_satellite_states` asked for instants of true
time. It shares no formula with the solver but the orbits and the models of the atmosphere.
"""

import numpy as np

from truenorth.constants import SPEED_OF_LIGHT_MPS
from truenorth.frames import azimuth_elevation_from_enu, geodetic_from_ecef, rot_enu_from_ecef
from truenorth.navigation import KEPLER_COLUMNS, MessageType, build_navigation
from truenorth.observations import NO_CHANNEL, Observations, frequency_hz, signal_id
from truenorth.orbits import compute_satellite_states
from truenorth.orbits.atmosphere import klobuchar_delay_m, saastamoinen_delay_m
from truenorth.timescales import NS_PER_DAY, gpst_from_calendar

START_NS = gpst_from_calendar(2024, 6, 24, 8, 0, 0)
KLOBUCHAR = np.array([1.9e-8, 2.2e-8, -1.2e-7, -6.0e-8, 1.3e5, 1.6e5, -2.0e5, -2.6e5])
EARTH_RATE_RADPS = 7.2921151467e-5

_ORBITS = {
    # System code: square root of the semi-major axis, message, planes, satellites, first number.
    0: (5153.7, MessageType.LNAV, 6, 30, 1),
    2: (5440.6, MessageType.INAV, 3, 24, 1),
    3: (5282.6, MessageType.D1, 3, 24, 19),
}
_SIGNAL = {0: "1C", 2: "1C", 3: "2I"}


def navigation(systems=(0, 2, 3), *, klobuchar=True):
    """Broadcast ephemerides of whole constellations, valid around `START_NS`."""
    rows = []
    for system in systems:
        sqrt_a, message, planes, n_sats, first = _ORBITS[system]
        for k in range(n_sats):
            plane, slot = k % planes, k // planes
            elements = dict.fromkeys(KEPLER_COLUMNS, 0.0)
            elements |= {
                "sqrt_a": sqrt_a,
                "eccentricity": 0.002 + 0.0005 * slot,
                "i0_rad": np.radians(55.0),
                "omega0_rad": 2 * np.pi * plane / planes + 0.3 * system,
                "m0_rad": 2 * np.pi * slot * planes / n_sats + 0.7 * plane + 0.2 * system,
                "omega_dot_radps": -8e-9,
                "af0_s": 1e-5 * (k - 10),
                "af1_sps": 1e-12 * (k - 5),
                "tgd_s": 1e-9 * (k % 7),
                "ura_m": 2.0,
                "fit_interval_s": 4 * 3600.0,
            }
            sat = 100 * system + first + k
            times = (START_NS, START_NS, START_NS - 30 * 10**9)
            rows.append((sat, message, *times, 1, 1, 0, [elements[name] for name in KEPLER_COLUMNS]))
    return build_navigation(rows, klobuchar={"G": KLOBUCHAR} if klobuchar else {})


def code_m(nav, sat, tag_ns, position_ecef_m, velocity_ecef_mps, clock_s, *, atmosphere=True):
    """Pseudoranges without noise, elevations; position and velocity hold at the time of reception."""
    position_ecef_m = np.asarray(position_ecef_m, dtype=float)
    lat, lon, height = geodetic_from_ecef(position_ecef_m)
    to_enu = rot_enu_from_ecef(lat, lon)
    system = sat // 100
    signal = np.array([signal_id(_SIGNAL[s]) for s in system])
    delay_m = np.zeros(len(sat))
    travel_s = np.full(len(sat), 0.07)
    for _ in range(6):
        # Whole nanoseconds for the orbit, the rest by the satellite's velocity and clock drift.
        back_ns = np.rint((travel_s + clock_s) * 1e9).astype(np.int64)
        rest_s = back_ns * 1e-9 - (travel_s + clock_s)
        states = compute_satellite_states(nav, sat, tag_ns - back_ns)
        where = states.position_ecef_m + states.velocity_ecef_mps * rest_s[:, None]
        flight_s = travel_s - delay_m / SPEED_OF_LIGHT_MPS
        c, s = np.cos(EARTH_RATE_RADPS * flight_s), np.sin(EARTH_RATE_RADPS * flight_s)
        turned = np.stack(
            [c * where[:, 0] + s * where[:, 1], c * where[:, 1] - s * where[:, 0], where[:, 2]], axis=-1
        )
        ray = turned - position_ecef_m
        distance = np.linalg.norm(ray, axis=1)
        azimuth, elevation = azimuth_elevation_from_enu(ray @ to_enu.T)
        if atmosphere:
            day_s = (tag_ns % NS_PER_DAY) / 1e9
            iono_m = klobuchar_delay_m(KLOBUCHAR, lat, lon, azimuth, np.maximum(elevation, 0), day_s)
            iono_m = iono_m * (1575.42e6 / frequency_hz(sat, signal)) ** 2
            delay_m = iono_m + saastamoinen_delay_m(lat, height, elevation)
        travel_s = (distance + delay_m) / SPEED_OF_LIGHT_MPS
    sat_clock_s = states.clock_s + states.clock_drift_sps * rest_s
    from truenorth.orbits import group_delay_s

    group_s = group_delay_s(nav, states.ephemeris_index, sat, signal)
    return SPEED_OF_LIGHT_MPS * (travel_s + clock_s - sat_clock_s + group_s), elevation


def observe(
    nav,
    position_ecef_m,
    *,
    n_epochs=1,
    velocity_ecef_mps=(0.0, 0.0, 0.0),
    clock_s=0.0,
    clock_drift_sps=0.0,
    system_offset_s=None,
    min_elevation_deg=10.5,
    tag_ns=START_NS + 600 * 10**9,
    step_ns=10**9,
    atmosphere=True,
    sats=None,
):
    """Observations of a receiver that moves uniformly; each epoch's row per satellite in view."""
    velocity_ecef_mps = np.asarray(velocity_ecef_mps, dtype=float)
    known = np.unique(nav.kepler.sat).astype(np.int64) if sats is None else np.asarray(sats)
    offsets = system_offset_s or {}
    columns = {name: [] for name in ("sat", "code", "doppler")}
    start, tags = [0], tag_ns + step_ns * np.arange(n_epochs)
    for tag in tags:

        def codes(shift_ns, sat, tag=tag, **options):
            """Codes at a tag shifted by some time; the receiver moves and its clock drifts."""
            tag_s = (tag + shift_ns - tag_ns) / 1e9
            clock = clock_s + clock_drift_sps * tag_s
            # Uniform motion in true time, counted from the first epoch's true time of reception.
            true_s = tag_s - (clock - clock_s)
            return code_m(
                nav, sat, tag + shift_ns, position_ecef_m + velocity_ecef_mps * true_s, None, clock, **options
            )

        _, elevation = codes(0, known)
        sat = known[elevation > np.radians(min_elevation_deg)] if sats is None else known
        code, _ = codes(0, sat, atmosphere=atmosphere)
        code = code + SPEED_OF_LIGHT_MPS * np.array([offsets.get(int(s) // 100, 0.0) for s in sat])
        half_ns = 200_000_000
        later, earlier = codes(half_ns, sat, atmosphere=False)[0], codes(-half_ns, sat, atmosphere=False)[0]
        signal = np.array([signal_id(_SIGNAL[s]) for s in sat // 100])
        columns["sat"].append(sat)
        columns["code"].append(code)
        rate = (later - earlier) / (2 * half_ns / 1e9)
        columns["doppler"].append(-rate * frequency_hz(sat, signal) / SPEED_OF_LIGHT_MPS)
        start.append(start[-1] + len(sat))
    sat = np.concatenate(columns["sat"])
    n = len(sat)
    return Observations(
        time_ns=tags,
        epoch_start=np.array(start),
        sat=sat.astype(np.int16),
        signal=np.array([signal_id(_SIGNAL[s]) for s in sat // 100], dtype=np.int16),
        code_m=np.concatenate(columns["code"]),
        phase_cyc=np.full(n, np.nan),
        doppler_hz=np.concatenate(columns["doppler"]),
        cn0_dbhz=np.full(n, 45.0),
        lli=np.zeros(n, dtype=np.uint8),
        clock_offset_s=np.full(n_epochs, np.nan),
        glonass_channel=np.full(100, NO_CHANNEL, dtype=np.int8),
    )
