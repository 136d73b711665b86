"""Made-up baselines of a rigid array with known attitude, for tests of everything above the baselines."""

import numpy as np

from synthetic_solution import make_solution
from truenorth.attitude.array import attitude_from_baselines
from truenorth.config import GnssSettings, _describe
from truenorth.errors import Reason, Status
from truenorth.frames import azimuth_elevation_from_enu
from truenorth.rotations import rot_ned_from_body

BODY_M = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [1.0, 1.5, -0.3], [0.5, -1.2, 0.1]])
NAMES = ("aft", "fore", "right", "left")
_ENU_FROM_NED = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])


def true_angles(n):
    """Heading through north, pitch and roll of a lively platform; radians, shape (n, 3)."""
    k = np.arange(n)
    heading = np.mod(np.radians(340.0) + 0.01 * k, 2.0 * np.pi)
    return np.stack([heading, 0.05 * np.sin(0.1 * k), 0.1 * np.cos(0.07 * k)], axis=1)


def make_baselines(n=200, *, body_m=BODY_M, sd_m=(0.003, 0.003, 0.006), seed=1, angles=None, **settings):
    """Baselines as a solver without length would give them: errors of each antenna are independent."""
    rng = np.random.default_rng(seed)
    body_m = np.asarray(body_m, dtype=float)
    angles = true_angles(n) if angles is None else angles
    rot = rot_ned_from_body(*angles.T)
    position_m = np.einsum("nij,kj->nki", rot, body_m) @ _ENU_FROM_NED.T
    position_m += np.array(sd_m) * rng.standard_normal(position_m.shape)
    cov = np.tile(2.0 * np.diag(np.square(sd_m)), (n, 1, 1))
    baselines = []
    for k in range(1, len(body_m)):
        enu_m = position_m[:, k] - position_m[:, 0]
        azimuth_rad, elevation_rad = azimuth_elevation_from_enu(enu_m)
        length_m = float(np.linalg.norm(body_m[k] - body_m[0]))
        options = GnssSettings(length_m=length_m, method="lambda", **settings)
        baselines.append(
            make_solution(
                n, baseline_enu_m=enu_m, cov_enu_m2=cov.copy(), azimuth_rad=azimuth_rad,
                elevation_rad=elevation_rad, length_m=length_m, settings=_describe(options),
                status=np.full(n, Status.FIXED, np.uint8), reason=np.full(n, Reason.OK, np.uint8),
                warnings=(),
            )
        )  # fmt: skip
    return baselines


def make_attitude(n=200, *, baselines=None, body_m=BODY_M, names=NAMES, **settings):
    """Attitude from made-up baselines."""
    options = {key: settings.pop(key) for key in ("residual_significance", "length_sd_m") if key in settings}
    baselines = make_baselines(n, body_m=body_m, **settings) if baselines is None else baselines
    return attitude_from_baselines(
        baselines,
        np.asarray(body_m, dtype=float),
        baselines[0].time_ns,
        names=names,
        settings=GnssSettings(**options),
    )
