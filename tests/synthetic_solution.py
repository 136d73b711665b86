"""A made-up `BaselineSolution` with known numbers, for tests of everything downstream of the solver."""

import numpy as np

from truenorth.attitude.solution import BaselineSolution, EpochEvent
from truenorth.config import GnssSettings, _describe
from truenorth.errors import Reason, Status
from truenorth.frames import azimuth_elevation_from_enu, ecef_from_geodetic, rot_enu_from_ecef
from truenorth.observations import sat_id, signal_id
from truenorth.timescales import NS_PER_S, gpst_from_calendar


def make_solution(n_epochs=120, *, azimuth_deg=350.0, rate_deg=0.25, length_m=0.99, seed=1, **changes):
    """A baseline that turns through north, with every status in it.

    Epochs 0-9 are float (ratio test), the last 5 have no solution, epoch 20-29 are held; the rest
    is fixed. Short runs (under 40 epochs) are fixed throughout.
    """
    rng = np.random.default_rng(seed)
    k = np.arange(n_epochs)
    status = np.full(n_epochs, Status.FIXED, dtype=np.uint8)
    reason = np.full(n_epochs, Reason.OK, dtype=np.uint8)
    if n_epochs >= 40:
        status[:10], reason[:10] = Status.FLOAT, Reason.RATIO_TEST
        status[20:30] = Status.HELD
        status[-5:], reason[-5:] = Status.NONE, Reason.TOO_FEW_SATELLITES
    accepted = (status == Status.FIXED) | (status == Status.HELD)

    noise_m = np.where(accepted, 0.002, 0.2)[:, None] * rng.standard_normal((n_epochs, 3)) * [1, 1, 2]
    azimuth_rad = np.radians(azimuth_deg + rate_deg * k)
    elevation_rad = np.radians(0.5)
    enu_m = length_m * np.stack(
        [
            np.cos(elevation_rad) * np.sin(azimuth_rad),
            np.cos(elevation_rad) * np.cos(azimuth_rad),
            np.full(n_epochs, np.sin(elevation_rad)),
        ],
        axis=1,
    )
    enu_m += noise_m
    enu_m[status == Status.NONE] = np.nan
    covariance = np.where(accepted, 0.002, 0.2)[:, None, None] ** 2 * np.array(
        [[1.0, 0.2, -0.3], [0.2, 1.0, 0.1], [-0.3, 0.1, 4.0]]
    )
    covariance[status == Status.NONE] = np.nan
    azimuth_rad, elevation_rad = azimuth_elevation_from_enu(enu_m)
    measured_m = np.linalg.norm(enu_m, axis=1)
    sd_m = np.sqrt(covariance[:, 0, 0])

    position_ecef_m = ecef_from_geodetic(np.radians(35.7), np.radians(139.7), 100.0)
    rot = rot_enu_from_ecef(np.radians(35.7), np.radians(139.7))
    sats = [sat_id(name) for name in ("G02", "G05", "G12", "G25", "E03", "E11", "C19", "C22")]
    epoch, which = (grid.ravel() for grid in np.meshgrid(k[accepted], np.arange(len(sats)), indexing="ij"))
    residual_elevation_rad = np.radians(20.0 + 8.0 * which + 0.01 * epoch)
    n_used = np.where(status == Status.NONE, 3, len(sats)).astype(np.int16)
    fields = {
        "time_ns": gpst_from_calendar(2024, 6, 24, 8, 20) + k * NS_PER_S,
        "status": status,
        "reason": reason,
        "baseline_ecef_m": enu_m @ rot,
        "baseline_enu_m": enu_m,
        "cov_enu_m2": covariance,
        "azimuth_rad": azimuth_rad,
        "elevation_rad": elevation_rad,
        "azimuth_sd_rad": sd_m / length_m,
        "elevation_sd_rad": 2.0 * sd_m / length_m,
        "length_m": measured_m,
        "length_sd_m": sd_m,
        "n_sats": n_used,
        "n_signals": (2 * (n_used - 1)).astype(np.int16),
        "pdop": np.where(accepted, 1.5, 2.5) + 0.001 * k,
        "hdop": np.full(n_epochs, 0.9),
        "vdop": np.full(n_epochs, 1.2),
        "azimuth_dop": np.full(n_epochs, 0.8),
        "elevation_dop": np.full(n_epochs, 1.6),
        "ratio": np.where(accepted, 20.0, 1.4),
        "success_probability": np.where(accepted, 0.9999, 0.6),
        "chi2": np.where(accepted, 10.0, 30.0),
        "chi2_limit": np.full(n_epochs, 40.0),
        "quality": np.where(accepted, 1, 3).astype(np.uint8) * (status != Status.NONE),
        "position_ecef_m": np.tile(position_ecef_m, (n_epochs, 1)),
        "residual_epoch": epoch,
        "residual_sat": np.array(sats, dtype=np.int16)[which],
        "residual_signal": np.full(len(epoch), signal_id("1C"), dtype=np.int16),
        "residual_m": 0.002 * rng.standard_normal(len(epoch)) / np.sin(residual_elevation_rad),
        "residual_elevation_rad": residual_elevation_rad,
        "residual_azimuth_rad": np.radians(45.0 * which + 0.02 * epoch),
        "residual_integer_cyc": np.zeros(len(epoch)),
        "residual_is_reference": which == len(sats) - 1,
        "settings": _describe(GnssSettings(length_m=length_m, method="filter", systems="GEC")),
        "inputs": {
            "base": {"path": "base.obs", "epochs": n_epochs},
            "rover": {"path": "rover.obs", "epochs": n_epochs},
            "navigation": ["brdc.nav"],
        },
        "warnings": ("no GLONASS channel for R07",),
        "events": (
            EpochEvent(
                gpst_from_calendar(2024, 6, 24, 8, 20, 3),
                "slip",
                "G05",
                "1C",
                1.2,
                0.1,
                "phase jumped by 1.2 cycles",
            ),
        ),
        "seconds": {"read": 0.1, "compile": 0.0, "solve": 0.2},
    }
    return BaselineSolution(**{**fields, **changes})
