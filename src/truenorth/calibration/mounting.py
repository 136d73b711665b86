r"""Boresight and lever arms: how an IMU, or anything else, is mounted against the array.

Boresight from two attitude series of one platform. With M_k = R_k^T(ned from imu) R_k(ned from array), the
constant C = rot_imu_from_array that minimises sum |M_k - C|^2 is, with sum M_k = U S V^T,

    C = U diag(1, 1, det U det V) V^T,

refined with the covariances of both where they are known. Its covariance is measured: the scatter of the
small rotations between M_k and C, and how long they stay alike.

Boresight from axes that were surveyed: by triad, which takes the first axis as it is and the second for the
turn about it, or by least squares of all axes. Lever arms from two trajectories of one platform,
p_imu - p_array = R_k l (+ a constant offset of the frames), or from marks (`body_coordinates`).

References
----------
B. J. McMillan et al., "GPS attitude determination error analysis", Proc. ION GPS (1994); F. L. Markley,
"Attitude determination using vector observations and the singular value decomposition", Journal of the
Astronautical Sciences 36 (1988); K. Landfahrer, "Attitude determination using a GPS multi antenna array", MSc
thesis, TU Graz, 2009, sec. 7.1; M. D. Shuster and S. D. Oh, "Three-axis attitude determination from vector
observations", Journal of Guidance and Control 4 (1981).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import ConfigError, NoSolutionError
from ..rotations import exp_so3, heading_pitch_roll, log_so3, skew
from .correlation import correlation_of
from .marks import body_coordinates

__all__ = [
    "Boresight",
    "LeverArm",
    "align_attitudes",
    "axes_of_marks",
    "body_coordinates",
    "boresight_from_axes",
    "lever_arm_from_tracks",
]

MIN_EPOCHS = 3
MAX_STEPS = 10
OUTLIER_SD = 6.0
"""Epochs whose rotation is off by more than so many robust standard deviations take no part."""


@dataclass(frozen=True, slots=True, eq=False)
class Boresight:
    """Constant rotation between two frames of one platform.

    Parameters
    ----------
    rot_b_from_a : ndarray, shape (3, 3)
        Components in frame a (the array, say) to those in frame b (the IMU).
    cov_rad2 : ndarray, shape (3, 3)
        Of a small rotation about the axes of b.
    n_used : int
        Epochs or axes that took part.
    effective : float
        Number of independent ones.
    residual_rad : ndarray, shape (n, 3)
        Small rotations about the axes of b that are left; NaN where there was none.
    is_test : ndarray of bool, shape (n,)
        Epochs that were kept for testing.
    test_mean_rad, test_sd_rad : ndarray, shape (3,)
        Of the residuals of the epochs that were kept for testing; NaN without.
    """

    rot_b_from_a: np.ndarray
    cov_rad2: np.ndarray
    n_used: int
    effective: float
    residual_rad: np.ndarray
    is_test: np.ndarray
    test_mean_rad: np.ndarray
    test_sd_rad: np.ndarray

    @property
    def angles_rad(self) -> np.ndarray:
        """Ndarray, shape (3,): heading, pitch, roll of frame a in frame b, each within half a circle."""
        angles = np.array([float(angle) for angle in heading_pitch_roll(self.rot_b_from_a)])
        return np.mod(angles + np.pi, 2.0 * np.pi) - np.pi

    @property
    def sd_rad(self) -> np.ndarray:
        """Ndarray, shape (3,): standard deviations of heading, pitch and roll."""
        heading = self.angles_rad[0]
        right = [-np.sin(heading), np.cos(heading), 0.0]
        inverse = np.linalg.inv(np.stack([[0.0, 0.0, 1.0], right, self.rot_b_from_a[:, 0]], axis=1))
        return np.sqrt(np.diag(inverse @ self.cov_rad2 @ inverse.T))

    def to_dict(self) -> dict:
        """Plain values for JSON, degrees."""
        names = ("heading", "pitch", "roll")
        described = {
            "rot_b_from_a": self.rot_b_from_a.tolist(),
            "epochs_used": self.n_used,
            "effective_epochs": self.effective,
        }
        for k, name in enumerate(names):
            described[f"{name}_deg"] = float(np.degrees(self.angles_rad[k]))
            described[f"{name}_sd_deg"] = float(np.degrees(self.sd_rad[k]))
        if np.isfinite(self.test_mean_rad).all():
            described["test_mean_deg"] = np.degrees(self.test_mean_rad).tolist()
            described["test_sd_deg"] = np.degrees(self.test_sd_rad).tolist()
        return described


def align_attitudes(
    rot_ned_from_a, rot_ned_from_b, *, cov_rad2=None, time_ns=None, test_share: float = 0.0
) -> Boresight:
    """Boresight between two frames from their attitudes at the same epochs.

    Parameters
    ----------
    rot_ned_from_a, rot_ned_from_b : ndarray, shape (n, 3, 3)
        Attitudes, of the array and of the IMU, say; NaN where there is none.
    cov_rad2 : ndarray, shape (n, 3, 3), optional
        Covariance of the difference of the two as a small rotation in north, east, down; without it all
        epochs weigh alike.
    time_ns : ndarray of int64, shape (n,), optional
        Epochs; evenly spaced where not given.
    test_share : float
        Share of the epochs, the last ones, that take no part, and whose errors are then reported: those that
        define the rotation have mean errors of zero by construction.

    Returns
    -------
    Boresight

    Raises
    ------
    ConfigError
        If `test_share` is impossible.
    NoSolutionError
        If there are fewer than three common epochs.
    """
    if not 0.0 <= test_share < 1.0:
        raise ConfigError(
            f"`test_share` is {test_share!r}; give a share from 0 to below 1",
            key="test_share",
            value=test_share,
        )
    rot_a, rot_b = np.asarray(rot_ned_from_a, dtype=float), np.asarray(rot_ned_from_b, dtype=float)
    n = len(rot_a)
    time_ns = np.arange(n) * 1_000_000_000 if time_ns is None else np.asarray(time_ns)
    known = np.flatnonzero(np.isfinite(rot_a).all((1, 2)) & np.isfinite(rot_b).all((1, 2)))
    if cov_rad2 is not None:
        known = known[np.isfinite(cov_rad2[known]).all((1, 2))]
    n_align = len(known) - round(test_share * len(known))
    if n_align < MIN_EPOCHS:
        raise NoSolutionError(
            f"could not align the attitudes: {n_align} common epochs, {MIN_EPOCHS} are needed"
        )
    relative = np.swapaxes(rot_b[known], 1, 2) @ rot_a[known]
    # A small rotation p in ned of the difference is R_b^T p about the axes of b.
    weight = np.broadcast_to(np.eye(3), (len(known), 3, 3))
    if cov_rad2 is not None:
        cov_b = np.swapaxes(rot_b[known], 1, 2) @ cov_rad2[known] @ rot_b[known]
        weight = np.linalg.inv(cov_b)
    aligns = np.arange(len(known)) < n_align
    used = aligns.copy()
    rot = _mean_rotation(relative[used])
    for _ in range(MAX_STEPS):
        left = log_so3(relative @ rot.T)
        spread = 1.4826 * np.median(np.abs(left[aligns]), axis=0) + 1e-12
        kept = aligns & (np.abs(left) < OUTLIER_SD * spread).all(1)
        used = kept if kept.sum() >= MIN_EPOCHS else used
        normal = weight[used].sum(0)
        step = np.linalg.solve(normal, np.einsum("nij,nj->i", weight[used], left[used]))
        rot = exp_so3(step) @ rot
        if np.max(np.abs(step)) < 1e-12:
            break
    left = log_so3(relative @ rot.T)
    influence = np.einsum("ij,njk,nk->ni", np.linalg.inv(normal), weight[used], left[used])
    cov, effective = _mean_covariance(influence, time_ns[known[used]], np.linalg.inv(normal))
    residual = np.full((n, 3), np.nan)
    residual[known] = left
    is_test = np.zeros(n, bool)
    is_test[known[n_align:]] = True
    test = residual[is_test] if is_test.any() else np.full((1, 3), np.nan)
    return Boresight(
        rot,
        cov,
        int(used.sum()),
        effective,
        residual,
        is_test,
        test.mean(0),
        test.std(0, ddof=1) if len(test) > 1 else np.full(3, np.nan),
    )


def _mean_rotation(rot):
    """Rotation nearest to all of some, by singular values (McMillan et al. 1994)."""
    u, _, vt = np.linalg.svd(rot.sum(0))
    u[:, 2] *= np.linalg.det(u) * np.linalg.det(vt)
    return u @ vt


def _mean_covariance(influence, time_ns, formal):
    """Covariance of a sum of correlated contributions, and how many independent ones say as much."""
    correlation = correlation_of(influence, time_ns)
    effective = len(influence) / correlation.inflation
    freedom = max(effective - 1.0, 3.0)
    cov = influence.T @ influence * correlation.inflation * freedom / (freedom - 2.0)
    # Few epochs scatter in fewer ways than there are axes.
    floor = 1e-9 * np.trace(cov) + 1e-30
    return cov + floor * formal / max(np.trace(formal), 1e-300), float(effective)


def axes_of_marks(lines_m):
    """Unit vectors of axes from marks along each.

    Parameters
    ----------
    lines_m : sequence of array_like, shape (k, 3)
        Marks along each axis, from back to front.

    Returns
    -------
    ndarray, shape (n, 3)
    """
    from .marks import fit_line

    return np.stack([fit_line(marks).direction for marks in lines_m])


def boresight_from_axes(axes_a, axes_b, *, method: str = "least_squares", sd_rad=None) -> Boresight:
    """Boresight from the same axes known in both frames.

    Parameters
    ----------
    axes_a, axes_b : array_like, shape (k, 3)
        Two axes or more, such as those of the IMU as the survey and as the protocol has them.
    method : str
        ``"triad"``: the first axis exactly, the second for the turn about it (Landfahrer 2009, sec. 7.1, with
        unit triads); ``"least_squares"``: all of them, by singular values.
    sd_rad : float or ndarray, shape (k,), optional
        Of the direction of each axis, both frames together; without it what they contradict one another by.

    Returns
    -------
    Boresight

    Raises
    ------
    ConfigError
        If there are fewer than two axes, or they are parallel.
    """
    axes_a, axes_b = (np.asarray(axes, dtype=float) for axes in (axes_a, axes_b))
    if method not in ("triad", "least_squares"):
        raise ConfigError(f"`method` is {method!r}; give triad or least_squares", key="method", value=method)
    if axes_a.shape != axes_b.shape or axes_a.ndim != 2 or len(axes_a) < 2:
        raise ConfigError("give the same two axes or more in both frames", key="axes")
    axes_a = axes_a / np.linalg.norm(axes_a, axis=1, keepdims=True)
    axes_b = axes_b / np.linalg.norm(axes_b, axis=1, keepdims=True)
    for axes in (axes_a, axes_b):
        if np.linalg.svd(axes)[1][1] < 0.05:
            raise ConfigError("the axes are parallel; give two that are not", key="axes")
    k = len(axes_a)
    sd = np.broadcast_to(np.asarray(1.0 if sd_rad is None else sd_rad, dtype=float), (k,))
    if method == "triad":
        rot = _triad(axes_b) @ _triad(axes_a).T
    else:
        profile = np.einsum("k,ki,kj->ij", sd**-2, axes_b, axes_a)
        u, _, vt = np.linalg.svd(profile)
        u[:, 2] *= np.linalg.det(u) * np.linalg.det(vt)
        rot = u @ vt
    turned = axes_a @ rot.T
    left = axes_b - turned
    # An error of a direction is two angles across it; of the rotation, those of all axes it rests on.
    across = np.einsum("kij,klj->kil", skew(turned), skew(turned))
    if method == "triad":
        cov = _triad_covariance(turned, sd)
    else:
        cov = np.linalg.inv(np.einsum("k,kij->ij", sd**-2, across))
    if sd_rad is None:
        freedom = 2 * k - 3
        cov = cov * np.sum(left**2) / freedom
    residual = np.cross(turned, axes_b)
    nothing = np.full(3, np.nan)
    return Boresight(rot, cov, k, float(k), residual, np.zeros(k, bool), nothing, nothing)


def _triad(axes):
    """Right-handed axes: the first as it is, the third across the first two."""
    third = np.cross(axes[0], axes[1])
    third = third / np.linalg.norm(third)
    return np.stack([axes[0], np.cross(third, axes[0]), third], axis=1)


def _triad_covariance(axes, sd):
    """Covariance of the rotation by triad: two angles of the first axis, one of the second about it."""
    frame = _triad(axes)
    first, second, third = frame.T
    along, across = axes[1] @ first, axes[1] @ second
    # Turns about second and third from the first axis; about first from the second, less what the first does.
    design = np.zeros((3, 4))
    design[:, 0], design[:, 1] = second, third
    # Error along third of axis 1 is a turn -p about second; along second, +p about third.
    design[:, 0] -= first * (-along / across)
    design[:, 2] = first / across
    variance = np.array([sd[0] ** 2, sd[0] ** 2, sd[1] ** 2, 0.0])
    return design @ np.diag(variance) @ design.T


@dataclass(frozen=True, slots=True, eq=False)
class LeverArm:
    """Where one point of a platform stands from another, in the body frame.

    Parameters
    ----------
    lever_body_m : ndarray, shape (3,)
        Forward, right, down.
    cov_m2 : ndarray, shape (3, 3)
        Its covariance.
    offset_ned_m : ndarray, shape (3,)
        Constant difference of the frames of the two trajectories; zero where not estimated.
    n_used : int
        Epochs that took part.
    effective : float
        Number of independent ones.
    residual_m : ndarray, shape (n, 3)
        North, east, down; NaN where there was none.
    """

    lever_body_m: np.ndarray
    cov_m2: np.ndarray
    offset_ned_m: np.ndarray
    n_used: int
    effective: float
    residual_m: np.ndarray

    @property
    def sd_m(self) -> np.ndarray:
        """Ndarray, shape (3,): standard deviations."""
        return np.sqrt(np.diag(self.cov_m2))


def lever_arm_from_tracks(
    position_a_ned_m,
    position_b_ned_m,
    rot_ned_from_body,
    *,
    cov_m2=None,
    time_ns=None,
    with_offset: bool = False,
) -> LeverArm:
    """Lever arm from a to b from their trajectories and the attitude.

    Parameters
    ----------
    position_a_ned_m, position_b_ned_m : ndarray, shape (n, 3)
        The two points at the same epochs, in one local frame of north, east, down.
    rot_ned_from_body : ndarray, shape (n, 3, 3)
        Attitude.
    cov_m2 : ndarray, shape (n, 3, 3), optional
        Covariance of the difference, in north, east, down; without it all epochs weigh alike.
    time_ns : ndarray of int64, shape (n,), optional
        Epochs.
    with_offset : bool
        Whether the frames of the two differ by a constant, which is estimated, too. The platform must turn.

    Returns
    -------
    LeverArm

    Raises
    ------
    NoSolutionError
        If there are too few epochs, or the platform did not turn enough to tell an offset from a lever arm.
    """
    apart = np.asarray(position_b_ned_m, dtype=float) - np.asarray(position_a_ned_m, dtype=float)
    rot = np.asarray(rot_ned_from_body, dtype=float)
    n = len(apart)
    time_ns = np.arange(n) * 1_000_000_000 if time_ns is None else np.asarray(time_ns)
    known = np.flatnonzero(np.isfinite(apart).all(1) & np.isfinite(rot).all((1, 2)))
    if len(known) < MIN_EPOCHS:
        raise NoSolutionError(
            f"could not find the lever arm: {len(known)} common epochs, {MIN_EPOCHS} are needed"
        )
    weight = np.broadcast_to(np.eye(3), (n, 3, 3)) if cov_m2 is None else np.linalg.inv(cov_m2)
    design = rot
    if with_offset:
        design = np.concatenate([rot, np.broadcast_to(np.eye(3), (n, 3, 3))], axis=2)
    used, x = known, np.zeros(design.shape[2])
    for _ in range(3):
        white = np.swapaxes(design[used], 1, 2) @ weight[used]
        normal = (white @ design[used]).sum(0)
        size = np.linalg.eigvalsh(normal)
        if size[0] < 1e-6 * size[-1]:
            raise NoSolutionError(
                "could not find the lever arm: the platform turned too little to tell it from an offset of "
                "the frames; turn about two axes, or leave the offset out"
            )
        x = np.linalg.solve(normal, np.einsum("nij,nj->i", white, apart[used]))
        left = apart - design @ x
        spread = 1.4826 * np.median(np.abs(left[known]), axis=0) + 1e-9
        used = known[(np.abs(left[known]) < OUTLIER_SD * spread).all(1)]
    white = np.swapaxes(design[used], 1, 2) @ weight[used]
    inverse = np.linalg.inv(normal)
    influence = np.einsum("ij,njk,nk->ni", inverse, white, left[used])
    cov, effective = _mean_covariance(influence, time_ns[used], inverse)
    residual = np.full((n, 3), np.nan)
    residual[known] = left[known]
    offset = x[3:] if with_offset else np.zeros(3)
    return LeverArm(x[:3], cov[:3, :3], offset, len(used), effective, residual)
