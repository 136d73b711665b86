"""Six made-up satellites: enough to make Numba compile an engine or a search ahead of its use."""

import numpy as np

from ..config import GnssSettings
from ..observations import NO_CHANNEL, Observations, sat_id, signal_id
from .array_model import ArrayEpoch
from .differencing import SingleDifferences
from .joint import resolve_joint
from .resolution import resolve_epochs

__all__ = ["rehearse_engine", "rehearse_search"]


def rehearse_engine():
    """Resolve two made-up epochs; compiles, and caches, the engine."""
    n, epochs = 6, 2
    azimuth = np.tile(np.arange(n) * 1.1, epochs)
    elevation = np.tile(np.linspace(1.3, 0.4, n), epochs)
    towards = np.stack(
        [np.cos(elevation) * np.sin(azimuth), np.cos(elevation) * np.cos(azimuth), np.sin(elevation)], axis=1
    )
    rows = n * epochs
    sat = np.tile(np.arange(n) + sat_id("G01"), epochs).astype(np.int16)
    signal = np.full(rows, signal_id("1C"), np.int16)
    start = np.arange(epochs + 1) * n
    time_ns = np.arange(epochs, dtype=np.int64) * 1_000_000_000
    zeros = np.zeros(rows)
    observations = Observations(
        time_ns=time_ns,
        epoch_start=start,
        sat=sat,
        signal=signal,
        code_m=zeros,
        phase_cyc=zeros,
        doppler_hz=zeros,
        cn0_dbhz=zeros,
        lli=np.zeros(rows, np.uint8),
        clock_offset_s=np.full(epochs, np.nan),
        glonass_channel=np.full(100, NO_CHANNEL, np.int8),
    )
    baseline_m = np.array([0.0, 1.0, 0.0])
    distance = -towards @ baseline_m
    differences = SingleDifferences(
        time_ns=time_ns,
        base_epoch=np.arange(epochs),
        rover_epoch=np.arange(epochs),
        position_ecef_m=np.zeros((epochs, 3)),
        rot_enu_from_ecef=np.tile(np.eye(3), (epochs, 1, 1)),
        has_position=np.ones(epochs, bool),
        start=start,
        sat=sat,
        signal=signal,
        group=np.zeros(rows, np.int64),
        phase_m=distance,
        code_m=distance.copy(),
        design_enu=-towards,
        wavelength_m=np.full(rows, 0.19),
        phase_variance_m2=np.full(rows, 1e-5),
        code_variance_m2=np.full(rows, 0.1),
        elevation_rad=elevation,
        azimuth_rad=azimuth,
        doppler_mps=zeros,
        lli=np.zeros(rows, np.uint8),
        integer_ok=np.ones(rows, bool),
        group_names=("G 1C",),
        glonass_channel=zeros,
        base_row=np.arange(rows),
        rover_row=np.arange(rows),
    )
    return resolve_epochs(
        differences, observations, observations, GnssSettings(length_m=1.0, single_epoch=True)
    )


def rehearse_search():
    """Search the integers of a made-up array of four antennas; compiles, and caches, the joint search."""
    body_m = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]])
    azimuth, elevation = np.arange(6) * 1.1, np.linspace(1.3, 0.4, 6)
    design = -np.stack(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), -np.sin(elevation)], axis=1
    )
    antenna, satellite = np.tile(np.arange(4), 6), np.repeat(np.arange(6), 4)
    distance = np.sum(design[satellite] * body_m[antenna], axis=1)
    n = len(antenna)
    return resolve_joint(
        ArrayEpoch(
            antenna=antenna,
            satellite=satellite,
            group=np.zeros(n, np.int64),
            phase_m=distance,
            code_m=distance.copy(),
            design_ned=design[satellite],
            wavelength_m=np.full(n, 0.19),
            phase_variance_m2=np.full(n, 1e-5),
            code_variance_m2=np.full(n, 0.1),
            positions_body_m=body_m,
            position_sd_m=0.001,
        )
    )
