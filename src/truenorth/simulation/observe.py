"""What one simulated receiver measures, block of epochs after block, with every term that went into it.

    code_m  = range + c (dT - dt) + T + I + c TGD + bias + multipath + noise
    phase_m = range + c (dT - dt) + T - I + lambda (N + slips + bias + wind-up) + phase centre
              + multipath + noise

The range is that of a ray which left the satellite when it had to: the emission time is solved for,
with the turn of the Earth on the way and the delay of the atmosphere. Everything is evaluated at the
receiver's own true time of reception, tag minus clock offset. Nothing here is shared with the solver but the
orbits and the models of the atmosphere.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..constants import GLONASS, SPEED_OF_LIGHT_MPS, SYSTEMS
from ..frames import azimuth_elevation_from_enu, geodetic_from_ecef, rot_enu_from_ecef
from ..gravity import EARTH_RATE_RADPS
from ..observations import ObservationMeta, Observations, frequency_hz, signal_id, signal_name
from .environment import ionosphere_l1_m, troposphere_m
from .faults import BlunderFault, DeadFault, LostFault, SlipFault, concerns
from .multipath import reflected_ray
from .randomness import stream
from .receivers import ConstantNoise, ReceiverClock, antenna_gain_db, chip_length_m, noise_sd

__all__ = ["AntennaBlock", "AntennaSimulator", "Rays", "RaysInView"]

_L1_HZ = 1575.42e6
_LOWEST_RAD = np.radians(-3.0)

# Oguz 2006, sec. 2.2.5: noise of 0.7 m of the satellite clock, 0.5 m each of ionosphere and troposphere.
_OGUZ_NOISE_M = float(np.sqrt(0.7**2 + 0.5**2 + 0.5**2))


@dataclass(frozen=True, slots=True, eq=False)
class Rays:
    """Satellites above (or little below) the horizon of the platform at some epochs.

    Parameters
    ----------
    epoch : ndarray of int64, shape (n,)
        Index of the epoch in the block, increasing.
    sat : ndarray of int64, shape (n,)
        Satellite, increasing within an epoch.
    travel_s : ndarray, shape (n,)
        Approximate travel time.
    windup_cyc : ndarray, shape (n,)
        Carrier wind-up, continuous in time for every satellite.
    """

    epoch: np.ndarray
    sat: np.ndarray
    travel_s: np.ndarray
    windup_cyc: np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class AntennaBlock:
    """Some epochs of one receiver.

    Parameters
    ----------
    observations : Observations
        What the receiver gives.
    truth : dict of str to ndarray, shape (n_rows,)
        Terms of every row of ``observations``; metres, cycles, radians by the names.
    clock_offset_s, clock_drift_sps : ndarray, shape (n_epochs of the block,)
        Clock reading minus GPS time and its rate, of all epochs of the block.
    position_ecef_m : ndarray, shape (n_epochs of the block, 3)
        Antenna reference point at the true time of reception.
    slips : tuple
        (time_ns, antenna, satellite, signal, cycles) of the slips on schedule that took place.
    """

    observations: Observations
    truth: dict[str, np.ndarray]
    clock_offset_s: np.ndarray
    clock_drift_sps: np.ndarray
    position_ecef_m: np.ndarray
    slips: tuple[tuple[int, str, int, int, int], ...]


class RaysInView:
    """Finds the candidate rays of a platform; the wind-up of its satellites is carried between blocks.

    All antennas of a platform turn together, so wind-up is that of the platform: its whole cycles are then
    the same for all antennas, whatever each of them loses on the way.

    Parameters
    ----------
    sky : Sky
        Where satellites are.
    trajectory : Trajectory
        How the platform moves.
    start_ns : int
        GPS time of the start, nanoseconds.
    phase_windup : bool
        Whether the carrier winds up at all.
    """

    def __init__(self, sky, trajectory, start_ns, *, phase_windup=True):
        self._sky = sky
        self._trajectory = trajectory
        self._start_ns = start_ns
        self._sats = np.asarray(sky.satellites, dtype=np.int64)
        self._windup_cyc = np.full(len(self._sats), np.nan)
        self._phase_windup = phase_windup

    def step(self, time_s):
        """Rays at instants after the start, which go on from the previous call.

        Parameters
        ----------
        time_s : ndarray, shape (n,)
            Seconds since the start.

        Returns
        -------
        Rays
        """
        motion = self._trajectory.at(time_s)
        n, m = len(time_s), len(self._sats)
        time_ns = self._start_ns + np.rint(time_s * 1e9).astype(np.int64)
        epoch, sat = np.repeat(np.arange(n), m), np.tile(self._sats, n)
        position, velocity, _, _, status = self._sky.true_states(sat, time_ns[epoch], np.full(n * m, 0.075))
        ray = position - motion.position_ecef_m[epoch]
        distance = np.linalg.norm(ray, axis=1)
        latitude, longitude, _ = geodetic_from_ecef(motion.position_ecef_m)
        up = rot_enu_from_ecef(latitude, longitude)[:, 2, :]
        with np.errstate(invalid="ignore"):
            is_up = np.einsum("ni,ni->n", ray, up[epoch]) > np.sin(_LOWEST_RAD) * distance
        keep = (status == 0) & is_up
        epoch, sat, distance = epoch[keep], sat[keep], distance[keep]
        windup = np.zeros(len(sat))
        if self._phase_windup:
            unit = ray[keep] / distance[:, None]
            turn = _windup_turn(unit, position[keep], velocity[keep], motion.rot_ecef_from_body[epoch])
            windup = self._unwrap(sat, turn)
        return Rays(epoch, sat, distance / SPEED_OF_LIGHT_MPS, windup)

    def _unwrap(self, sat, turn):
        """Turns in cycles made continuous satellite by satellite, from where the last block ended."""
        windup = np.empty(len(sat))
        order = np.argsort(sat, kind="stable")
        starts = np.flatnonzero(np.diff(sat[order], prepend=-1))
        for first, last in zip(starts, [*starts[1:], len(sat)], strict=True):
            rows = order[first:last]
            place = np.searchsorted(self._sats, sat[rows[0]])
            before = self._windup_cyc[place]
            values = turn[rows] if np.isnan(before) else np.concatenate(([before], turn[rows]))
            values = np.unwrap(values, period=1.0)
            windup[rows] = values[-len(rows) :]
            self._windup_cyc[place] = values[-1]
        return windup


def _windup_turn(unit_ecef, satellite_ecef_m, satellite_ecef_mps, rot_ecef_from_body):
    """Carrier wind-up of rays but for whole cycles (Wu et al. 1993), shape (n,)."""
    k = -unit_ecef
    forward, left = rot_ecef_from_body[:, :, 0], -rot_ecef_from_body[:, :, 1]
    receiver = forward - k * np.einsum("ni,ni->n", k, forward)[:, None] + np.cross(k, left)
    # Satellite axes: z to the Earth, y against the orbit normal; the antenna's own yaw is common to all.
    radial = satellite_ecef_m / np.linalg.norm(satellite_ecef_m, axis=1)[:, None]
    inertial = satellite_ecef_mps + EARTH_RATE_RADPS * np.stack(
        [-satellite_ecef_m[:, 1], satellite_ecef_m[:, 0], np.zeros(len(k))], axis=-1
    )
    y = -np.cross(radial, inertial)
    y /= np.linalg.norm(y, axis=1)[:, None]
    x = np.cross(y, -radial)
    satellite = x - k * np.einsum("ni,ni->n", k, x)[:, None] - np.cross(k, y)
    sine = np.einsum("ni,ni->n", k, np.cross(satellite, receiver))
    return np.arctan2(sine, np.einsum("ni,ni->n", satellite, receiver)) / (2.0 * np.pi)


class AntennaSimulator:
    """One antenna with its receiver; its clock, channels and multipath are carried between blocks.

    Parameters
    ----------
    scenario : Scenario
        All settings.
    index : int
        Which antenna of the platform.
    sky : Sky
        Where satellites are.
    trajectory : Trajectory
        How the platform moves.
    visibility : Visibility
        What stands in the way.
    origin_ecef_m : ndarray, shape (3,)
        Where the gradient of the ionosphere counts from.
    antex : Antex, optional
        Phase centres.
    """

    def __init__(self, scenario, index, sky, trajectory, visibility, origin_ecef_m, antex=None):
        self._scenario = scenario
        self._index = index
        self._antenna = scenario.platform.antennas[index]
        self._receiver = self._antenna.receiver
        self._sky = sky
        self._trajectory = trajectory
        self._visibility = visibility
        self._origin = origin_ecef_m
        self._antex = antex
        name, seed = self._antenna.name, scenario.seed
        clock = self._receiver.clock
        self._clock = ReceiverClock(clock, stream(seed, "clock", clock.oscillator or f"antenna {name}"))
        self._normal = stream(seed, "noise", name)
        self._uniform = stream(seed, "channels", name)
        self._sats = np.asarray(sky.satellites, dtype=np.int64)
        self._plan_signals(stream(seed, "bias", name))
        from .._kernels.tracking import N_STATE

        self._state = np.full((len(self._sats) * self._signals.shape[1], N_STATE), np.nan)
        self._state[:, 2] = 0.0
        self._slips = scenario.slips.draw(
            stream(seed, "scheduled slips"), scenario.duration_s, len(scenario.platform.antennas)
        )

    def _plan_signals(self, generator):
        """Signals by system in the order of their codes, -1 for none, and their biases."""
        by_system = [
            sorted({signal_id(name) for name in self._receiver.signals.get(letter, ())}) for letter in SYSTEMS
        ]
        width = max(1, *(len(names) for names in by_system))
        self._signals = np.full((len(SYSTEMS), width), -1)
        self._chip_m = np.full((len(SYSTEMS), width), 293.05)
        for system, names in enumerate(by_system):
            for k, signal in enumerate(names):
                self._signals[system, k] = signal
                self._chip_m[system, k] = chip_length_m(SYSTEMS[system], signal_name(signal))
        bias = self._receiver.bias
        draws = generator.standard_normal((*self._signals.shape, 2))
        self._code_bias_m = bias.code_sd_m * draws[..., 0]
        self._phase_bias_cyc = bias.phase_sd_cyc * draws[..., 1]
        self._channel = self._sky.navigation.glonass_channels()

    @property
    def declared_signals(self) -> dict[str, tuple[str, ...]]:
        """Signals by system letter, in the order of the columns of a file."""
        return {
            letter: tuple(signal_name(s) for s in row if s >= 0)
            for letter, row in zip(SYSTEMS, self._signals, strict=True)
            if np.any(row >= 0)
        }

    def step(self, first, last, rays):
        """Epochs ``first`` to ``last - 1`` of the scenario.

        Parameters
        ----------
        first, last : int
            Range of epochs; goes on where the previous call ended.
        rays : Rays
            From `RaysInView` for the same epochs.

        Returns
        -------
        AntennaBlock
        """
        scenario, receiver = self._scenario, self._receiver
        grid_s = scenario.epoch_s(first, last)
        grid_ns = scenario.start_ns + np.arange(first, last) * scenario.interval_ns
        tag_ns = grid_ns + round(receiver.tag_offset_s * 1e9)
        clock_s, clock_rate, unfollowed_s = self._clock.step(grid_s)
        # Sampled when the clock shows the tag.
        true_s = grid_s + receiver.tag_offset_s - clock_s
        motion = self._trajectory.at(true_s)
        position, velocity = self._antenna_motion(motion)
        ray = self._propagate(rays, tag_ns, clock_s, position, velocity, motion)
        ray = self._receive(ray, true_s, motion)
        rows = self._measure(ray, grid_s, clock_s, clock_rate, unfollowed_s)
        return self._assemble(rows, grid_s, tag_ns, clock_s, clock_rate, position)

    def _antenna_motion(self, motion):
        """Position and velocity of the antenna reference point, flexure included."""
        lever = np.array(self._antenna.position_body_m)
        flexure = self._scenario.platform.flexure
        share = np.linalg.norm(lever) / flexure.reference_m
        phase = 2.0 * np.pi / flexure.period_s
        swing = share * np.array(flexure.amplitude_m)
        body = lever + swing * np.sin(phase * motion.time_s)[:, None]
        body_rate = (
            np.cross(motion.rate_body_radps, body) + phase * swing * np.cos(phase * motion.time_s)[:, None]
        )
        rot = motion.rot_ecef_from_body
        position = motion.position_ecef_m + np.einsum("nij,nj->ni", rot, body)
        velocity = motion.velocity_ecef_mps + np.einsum("nij,nj->ni", rot, body_rate)
        return position, velocity

    def _propagate(self, rays, tag_ns, clock_s, position, velocity, motion):
        """Solve for the emission of every ray: ranges, directions, delays; arrays by name, one row a ray."""
        environment = self._scenario.environment
        is_tracked = self._signals[rays.sat // 100, 0] >= 0
        e, sat, travel = rays.epoch[is_tracked], rays.sat[is_tracked], rays.travel_s[is_tracked]
        windup = rays.windup_cyc[is_tracked]
        where, speed, sat_clock, sat_drift, status = self._sky.true_states(
            sat, tag_ns[e], clock_s[e] + travel
        )
        good = status == 0
        e, sat, travel, windup = e[good], sat[good], travel[good], windup[good]
        where, speed, sat_clock, sat_drift = where[good], speed[good], sat_clock[good], sat_drift[good]
        latitude, longitude, _ = geodetic_from_ecef(position)
        to_enu = rot_enu_from_ecef(latitude, longitude)[e]
        at = position[e]
        coefficients = self._sky.navigation.klobuchar.get("G")
        delay_m = iono_m = tropo_m = None
        for _ in range(3):
            # Turned into the frame of the time of reception.
            c, s = np.cos(EARTH_RATE_RADPS * travel), np.sin(EARTH_RATE_RADPS * travel)
            turned = np.stack(
                [c * where[:, 0] + s * where[:, 1], c * where[:, 1] - s * where[:, 0], where[:, 2]], axis=-1
            )
            line = turned - at
            distance = np.linalg.norm(line, axis=1)
            if delay_m is None:
                azimuth, elevation = azimuth_elevation_from_enu(np.einsum("nij,nj->ni", to_enu, line))
                iono_m = ionosphere_l1_m(
                    environment, coefficients, self._origin, at, azimuth, elevation, tag_ns[e]
                )
                tropo_m = troposphere_m(environment, at, elevation)
                delay_m = iono_m + tropo_m
            later = (distance + delay_m) / SPEED_OF_LIGHT_MPS - travel
            travel = travel + later
            where = where - speed * later[:, None]
            sat_clock = sat_clock - sat_drift * later
        unit = line / distance[:, None]
        turned_speed = np.stack(
            [c * speed[:, 0] + s * speed[:, 1], c * speed[:, 1] - s * speed[:, 0], speed[:, 2]], axis=-1
        )
        # The emission time runs slower than that of reception by the Doppler factor itself.
        turning = EARTH_RATE_RADPS * np.stack([turned[:, 1], -turned[:, 0], np.zeros(len(e))], axis=-1)
        closing = np.einsum("ni,ni->n", unit, turned_speed - velocity[e])
        drag = np.einsum("ni,ni->n", unit, turned_speed - turning) / SPEED_OF_LIGHT_MPS
        unit_body = np.einsum("nji,nj->ni", motion.rot_ecef_from_body[e], unit)
        return {
            "epoch": e,
            "sat": sat,
            "azimuth_rad": azimuth,
            "elevation_rad": elevation,
            "unit_body": unit_body,
            "windup_cyc": windup,
            "range_m": SPEED_OF_LIGHT_MPS * travel - delay_m,
            "range_rate_mps": closing / (1.0 + drag),
            "satellite_clock_m": SPEED_OF_LIGHT_MPS * sat_clock,
            "satellite_drift_mps": SPEED_OF_LIGHT_MPS * sat_drift,
            "troposphere_m": tropo_m,
            "ionosphere_l1_m": iono_m,
        }

    def _receive(self, ray, true_s, motion):
        """What stands in the way and how the antenna hears the ray; blocked rays go."""
        receiver = self._receiver
        unit = ray["unit_body"]
        azimuth_body = np.arctan2(unit[:, 1], unit[:, 0])
        elevation_body = np.arcsin(np.clip(-unit[:, 2], -1.0, 1.0))
        loss_db = self._visibility.attenuation_db(
            true_s[ray["epoch"]],
            ray["sat"],
            ray["azimuth_rad"],
            ray["elevation_rad"],
            azimuth_body,
            elevation_body,
        )
        keep = np.isfinite(loss_db)
        if receiver.channels:
            keep &= _is_among_highest(ray["epoch"], ray["elevation_rad"], keep, receiver.channels)
        ray = {name: values[keep] for name, values in ray.items()}
        boresight = np.array(receiver.boresight_body) / np.linalg.norm(receiver.boresight_body)
        ray["loss_db"] = loss_db[keep]
        ray["azimuth_body_rad"] = azimuth_body[keep]
        ray["gain_db"] = antenna_gain_db(receiver, ray["unit_body"] @ boresight)
        ray["echoes"] = [
            self._echo(ray, reflector, boresight, motion) for reflector in receiver.multipath.reflectors
        ]
        return ray

    def _echo(self, ray, reflector, boresight, motion):
        """Extra path (m) and relative amplitude of one reflected ray; amplitude 0 where there is none."""
        normal = np.array(reflector.normal) / np.linalg.norm(reflector.normal)
        if reflector.frame == "world":
            latitude, longitude, _ = geodetic_from_ecef(motion.position_ecef_m)
            enu = rot_enu_from_ecef(latitude, longitude)
            normal_ecef = normal[0] * enu[:, 1] + normal[1] * enu[:, 0] - normal[2] * enu[:, 2]
            body = np.einsum("nji,nj->ni", motion.rot_ecef_from_body, normal_ecef)[ray["epoch"]]
        else:
            body = np.broadcast_to(normal, ray["unit_body"].shape)
        towards = np.einsum("ni,ni->n", body, ray["unit_body"])
        mirrored = ray["unit_body"] - 2.0 * towards[:, None] * body
        gain = antenna_gain_db(self._receiver, mirrored @ boresight) - ray["gain_db"]
        low, high = np.radians(reflector.elevation_deg)
        is_hit = (towards > 0.0) & (ray["elevation_rad"] >= low) & (ray["elevation_rad"] <= high)
        amplitude = np.where(is_hit, np.minimum(reflector.coefficient * 10.0 ** (gain / 20.0), 0.99), 0.0)
        return 2.0 * reflector.distance_m * np.maximum(towards, 0.0), amplitude

    def _measure(self, ray, grid_s, clock_s, clock_rate, unfollowed_s):
        """Rows of signals with every term, in the order of a file."""
        scenario, receiver = self._scenario, self._receiver
        system = ray["sat"] // 100
        of_ray, column = np.nonzero(self._signals[system] >= 0)
        signal = self._signals[system[of_ray], column]
        sat, epoch = ray["sat"][of_ray], ray["epoch"][of_ray]
        freq = frequency_hz(sat, signal, self._channel)
        known = np.isfinite(freq)
        of_ray, column, signal, sat, epoch, freq = (
            v[known] for v in (of_ray, column, signal, sat, epoch, freq)
        )
        n = len(sat)
        system = sat // 100
        wavelength = SPEED_OF_LIGHT_MPS / freq
        chip = self._chip_m[system, column]
        normal = self._normal.standard_normal((n, 6))
        uniform = self._uniform.random((n, 5))
        row = {"epoch": epoch, "sat": sat, "signal": signal, "wavelength_m": wavelength}
        for name in (
            "azimuth_rad", "elevation_rad", "range_m", "range_rate_mps", "satellite_clock_m", "troposphere_m",
            "windup_cyc",
        ):  # fmt: skip
            row[name] = ray[name][of_ray]
        row["satellite_drift_mps"] = ray["satellite_drift_mps"][of_ray]
        row["ionosphere_m"] = ray["ionosphere_l1_m"][of_ray] * (_L1_HZ / freq) ** 2
        row["receiver_clock_m"] = SPEED_OF_LIGHT_MPS * clock_s[epoch]
        row["phase_clock_m"] = SPEED_OF_LIGHT_MPS * (clock_s + unfollowed_s)[epoch]
        row["receiver_drift_mps"] = SPEED_OF_LIGHT_MPS * clock_rate[epoch]
        row["group_delay_m"] = self._group_delay_m(sat, signal, grid_s)
        self._add_multipath(row, ray, of_ray, wavelength, chip)
        cn0 = (
            receiver.zenith_cn0_dbhz + ray["gain_db"][of_ray] - ray["loss_db"][of_ray] + row.pop("fading_db")
        )
        cn0 = cn0 + receiver.cn0_sd_db * normal[:, 3]
        row["cn0_dbhz"] = cn0
        code_sd, phase_sd, doppler_sd = noise_sd(receiver.noise, cn0, wavelength, chip)
        if scenario.environment.signal_model == "oguz_2006":
            code_sd = np.hypot(code_sd, _OGUZ_NOISE_M)
        row["code_noise_m"] = code_sd * normal[:, 0]
        row["phase_noise_m"] = phase_sd * normal[:, 1]
        row["doppler_noise_hz"] = doppler_sd * normal[:, 2]
        row["code_bias_m"] = self._code_bias_m[system, column]
        row["phase_bias_m"] = self._phase_bias_cyc[system, column] * wavelength
        fdma = (system == GLONASS) & np.isin(signal // 100, (1, 2))
        if np.any(fdma):
            number = np.where(fdma, self._channel[sat % 100].astype(float), 0.0)
            row["code_bias_m"] = row["code_bias_m"] + number * receiver.bias.glonass_code_m_per_channel
            row["phase_bias_m"] = row["phase_bias_m"] + number * receiver.bias.glonass_phase_m_per_channel
        row["phase_centre_m"] = self._phase_centre_m(ray, of_ray, signal)
        self._track(row, ray, of_ray, column, grid_s, normal, uniform, cn0)
        return row

    def _group_delay_m(self, sat, signal, grid_s):
        """What the broadcast group delays say of each row."""
        from ..orbits import group_delay_s, select_ephemerides

        if len(sat) == 0:
            return np.zeros(0)
        key, of_key = np.unique(sat * 1000 + signal, return_inverse=True)
        middle_ns = self._scenario.start_ns + round(float(np.mean(grid_s)) * 1e9)
        index, _ = select_ephemerides(self._sky.navigation, key // 1000, middle_ns, include_unhealthy=True)
        delay = group_delay_s(self._sky.navigation, index, key // 1000, key % 1000)
        return SPEED_OF_LIGHT_MPS * np.nan_to_num(delay)[of_key]

    def _add_multipath(self, row, ray, of_ray, wavelength, chip):
        """Reflected rays by geometry; the Gauss-Markov part is drawn channel by channel."""
        n = len(of_ray)
        code, phase, fading = np.zeros(n), np.zeros(n), np.zeros(n)
        noise = self._receiver.noise
        spacing = 0.5 if isinstance(noise, ConstantNoise) else noise.correlator_spacing_chips
        for path_m, amplitude in ray["echoes"]:
            errors = reflected_ray(path_m[of_ray], amplitude[of_ray], wavelength, chip, spacing)
            code, phase, fading = code + errors[0], phase + errors[1], fading + errors[2]
        row["code_multipath_m"], row["phase_multipath_m"], row["fading_db"] = code, phase, fading

    def _phase_centre_m(self, ray, of_ray, signal):
        """Phase-centre offset and variation of the receiver antenna, metres added to the phase."""
        if self._antex is None or not self._receiver.antenna_type:
            return np.zeros(len(of_ray))
        # Mounted with its north mark forward.
        unit = ray["unit_body"]
        elevation = np.arcsin(np.clip(-unit[:, 2], -1.0, 1.0))
        system = ray["sat"][of_ray] // 100
        correction = np.zeros(len(of_ray))
        for key in np.unique(system * 1000 + signal):
            rows = system * 1000 + signal == key
            band = f"{SYSTEMS[key // 1000]}{key % 1000 // 100:02d}"
            correction[rows] = self._antex.range_correction_m(
                self._receiver.antenna_type,
                band,
                ray["azimuth_body_rad"][of_ray][rows],
                elevation[of_ray][rows],
            )
        return correction

    def _track(self, row, ray, of_ray, column, grid_s, normal, uniform, cn0):
        """Lock, ambiguities, slips and Gauss-Markov multipath of every channel, by the compiled step."""
        from .._kernels.tracking import track_channels

        scenario, receiver = self._scenario, self._receiver
        tracking, process = receiver.tracking, receiver.multipath.gauss_markov
        n = len(of_ray)
        time_s = np.ascontiguousarray(grid_s[row["epoch"]])
        forced, dead = self._faults(row, time_s, scenario.interval_s)
        lift = 1.0 + (process.horizon_factor - 1.0) * (1.0 - np.sin(np.maximum(row["elevation_rad"], 0.0)))
        speed = np.linalg.norm(self._trajectory.at(grid_s).velocity_ecef_mps, axis=1)
        tau = np.where(speed > 0.5, process.tau_moving_s, process.tau_s)[row["epoch"]]
        place = np.searchsorted(self._sats, row["sat"])
        flags = [np.zeros(n, dtype=np.uint8) for _ in range(3)]
        values = [np.zeros(n) for _ in range(5)]
        track_channels(
            np.ascontiguousarray(place * self._signals.shape[1] + column).astype(np.int64),
            time_s, 1.5 * scenario.interval_s, cn0, tracking.acquire_dbhz, tracking.lose_dbhz,
            tracking.code_wait_s, tracking.phase_wait_s, tracking.slips_per_hour / 3600.0,
            float(tracking.slip_cycles), tracking.slip_flag_share,
            tracking.half_cycle_s, tracking.half_cycle_share,
            dead, forced, np.ascontiguousarray(normal[:, 4:6]), uniform,
            process.code_sd_m * lift, process.phase_sd_m * lift, tau, 0.0,
            self._state, flags[0], flags[1], values[0], values[1], values[2], flags[2], values[3], values[4],
        )  # fmt: skip
        row["has_code"], row["has_phase"], row["lli"] = flags
        row["integer_cyc"], row["half_cyc"], row["slip_cyc"] = values[:3]
        row["code_multipath_m"] = row["code_multipath_m"] + values[3]
        row["phase_multipath_m"] = row["phase_multipath_m"] + values[4]

    def _faults(self, row, time_s, interval_s):
        """Cycles that are forced on each row, and rows that are lost; blunders are added to the row."""
        n = len(time_s)
        forced, dead = np.zeros(n), np.zeros(n, dtype=np.uint8)
        row["code_fault_m"], row["phase_fault_m"] = np.zeros(n), np.zeros(n)
        name = self._antenna.name
        for fault in self._scenario.faults:
            if fault.antenna != name:
                continue
            if isinstance(fault, SlipFault):
                here = (time_s >= fault.time_s) & (time_s - interval_s < fault.time_s)
                forced[here & concerns(fault, row["sat"], row["signal"])] += fault.cycles
                continue
            during = (time_s >= fault.start_s) & (time_s < fault.end_s)
            if isinstance(fault, DeadFault):
                dead[during] = 1
            elif isinstance(fault, LostFault):
                dead[during & concerns(fault, row["sat"], row["signal"])] = 1
            elif isinstance(fault, BlunderFault):
                rows = during & concerns(fault, row["sat"], row["signal"])
                row["code_fault_m"][rows] += fault.code_m
                row["phase_fault_m"][rows] += fault.phase_m
        row["scheduled"] = self._scheduled_slips(row, time_s, interval_s, forced)
        return forced, dead

    def _scheduled_slips(self, row, time_s, interval_s, forced):
        """Slips at random instants fall on a satellite well in view; returns rows and cycles."""
        times, antennas, places, cycles = self._slips
        happened = []
        if len(time_s) == 0:
            return happened
        for k in np.flatnonzero(antennas == self._index):
            due = times[k]
            if not time_s[0] - interval_s < due <= time_s[-1]:
                continue
            here = np.flatnonzero((time_s >= due) & (time_s - interval_s < due))
            here = here[(row["elevation_rad"][here] > np.radians(15.0)) & (row["cn0_dbhz"][here] > 35.0)]
            if len(here):
                chosen = here[int(places[k] * len(here))]
                forced[chosen] += cycles[k]
                happened.append((chosen, int(cycles[k])))
        return happened

    def _assemble(self, row, grid_s, tag_ns, clock_s, clock_rate, position):
        """Observations and truth of the block."""
        scenario = self._scenario
        is_simple = scenario.environment.signal_model == "oguz_2006"
        wavelength = row["wavelength_m"]
        code = row["range_m"] + row["troposphere_m"] + row["ionosphere_m"]
        code = code + row["receiver_clock_m"] - row["satellite_clock_m"] + row["group_delay_m"]
        for name in ("code_bias_m", "code_multipath_m", "code_noise_m", "code_fault_m"):
            code = code + row[name]
        cycles = row["integer_cyc"] + row["half_cyc"] + row["slip_cyc"]
        phase = row["range_m"] + row["phase_multipath_m"] + row["phase_noise_m"] + row["phase_fault_m"]
        rate = row["range_rate_mps"]
        if not is_simple:
            phase = phase + row["phase_clock_m"] - row["satellite_clock_m"]
            phase = (
                phase
                + row["troposphere_m"]
                - row["ionosphere_m"]
                + row["phase_bias_m"]
                + row["phase_centre_m"]
            )
            cycles = cycles + row["windup_cyc"]
            # Counted by the receiver's own seconds.
            rate = rate * (1.0 - row["receiver_drift_mps"] / SPEED_OF_LIGHT_MPS)
            rate = rate + row["receiver_drift_mps"] - row["satellite_drift_mps"]
        # Whole cycles are added last, so that nothing of the fraction is lost.
        phase_cyc = phase / wavelength + cycles
        doppler = -rate / wavelength + row["doppler_noise_hz"]
        columns = {"code_m": code, "phase_cyc": phase_cyc, "doppler_hz": doppler, "cn0_dbhz": row["cn0_dbhz"]}
        if scenario.output.quantise:
            columns = {name: np.round(values, 3) for name, values in columns.items()}
        columns["code_m"] = np.where(row["has_code"] != 0, columns["code_m"], np.nan)
        columns["phase_cyc"] = np.where(row["has_phase"] != 0, columns["phase_cyc"], np.nan)
        columns["doppler_hz"] = np.where(row["has_code"] != 0, columns["doppler_hz"], np.nan)
        keep = (row["has_code"] != 0) | (row["has_phase"] != 0)
        slips = tuple(
            (
                int(tag_ns[row["epoch"][k]]),
                self._antenna.name,
                int(row["sat"][k]),
                int(row["signal"][k]),
                cycles_k,
            )
            for k, cycles_k in row.pop("scheduled")
            if row["has_phase"][k] and not row["lli"][k] & 1
        )
        is_alive = self._alive(grid_s)
        counts = np.bincount(row["epoch"][keep], minlength=len(grid_s))[is_alive]
        observations = Observations(
            time_ns=tag_ns[is_alive],
            epoch_start=np.concatenate(([0], np.cumsum(counts))).astype(np.int64),
            sat=row["sat"][keep].astype(np.int16),
            signal=row["signal"][keep].astype(np.int16),
            lli=np.where(row["has_phase"] != 0, row["lli"], 0)[keep].astype(np.uint8),
            clock_offset_s=np.full(int(np.count_nonzero(is_alive)), np.nan),
            glonass_channel=self._channel.copy(),
            meta=self.meta,
            **{name: values[keep] for name, values in columns.items()},
        )
        left_out = ("has_code", "has_phase", "epoch", "wavelength_m", "range_rate_mps")
        truth = {name: values[keep] for name, values in row.items() if name not in left_out}
        truth["time_ns"] = tag_ns[row["epoch"][keep]]
        return AntennaBlock(observations, truth, clock_s, clock_rate, position, slips)

    def _alive(self, grid_s):
        """Epochs that a dead receiver does not give."""
        alive = np.ones(len(grid_s), dtype=bool)
        for fault in self._scenario.faults:
            if isinstance(fault, DeadFault) and fault.antenna == self._antenna.name:
                alive &= ~((grid_s >= fault.start_s) & (grid_s < fault.end_s))
        return alive

    @property
    def meta(self) -> ObservationMeta:
        """What the header of the file says."""
        return ObservationMeta(
            path=f"{self._scenario.name}/{self._antenna.name}",
            format="simulated",
            marker=self._antenna.name,
            receiver_type=self._receiver.type,
            antenna_type=self._receiver.antenna_type,
            approx_position_ecef_m=tuple(float(v) for v in np.round(self._origin, 4)),
            interval_s=self._scenario.interval_s,
        )


def _is_among_highest(epoch, elevation, usable, count):
    """The ``count`` highest usable rays of each epoch."""
    order = np.lexsort((-elevation, ~usable, epoch))
    sorted_epoch = epoch[order]
    first = np.searchsorted(sorted_epoch, sorted_epoch, side="left")
    rank = np.arange(len(epoch)) - first
    chosen = np.zeros(len(epoch), dtype=bool)
    chosen[order] = rank < count
    return chosen & usable
