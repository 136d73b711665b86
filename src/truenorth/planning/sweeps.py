"""Accuracy of an attitude against the error of positions, and against the size of the array.

Positions of antennas, from whatever method, have errors in north, east and up; body coordinates are exact.
Two ways lead to the angles: the published one through three antennas and a cross product, propagated step by
step, and the weighted adjustment of all antennas with their full covariance.

    error       the same error for every coordinate, from a millimetre to half a metre
    coordinate  one coordinate of one antenna, with all others held
    length      the baselines a ahead and b at an angle to it, each against the closed form

Reference: K. Landfahrer, "Attitude determination using a GPS multi antenna array", MSc thesis, TU Graz, 2009,
sections 3.9 and 3.10 (after Farrell and Barth 1999).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..attitude.error_chain import baseline_length_model, three_antenna_chain
from ..attitude.vector_methods import MIN_ACROSS_M
from ..attitude.vectors import angle_jacobian, array_extent_m
from ..errors import ConfigError
from ..rotations import rot_ned_from_body, skew
from .plan import ANGLES

__all__ = [
    "LANDFAHRER_ANGLES_DEG",
    "LANDFAHRER_ANTENNAS",
    "Sweep",
    "sweep_coordinate",
    "sweep_error",
    "sweep_length",
]

LANDFAHRER_ANTENNAS = ((0.0, 0.0, 0.0), (1.3345, 0.7825, 0.0), (0.0, 1.565, 0.0))
"""Left, front and right antenna of the cross on the car's roof, its arms 2.669 and 1.565 m, crossing in
their middles (Landfahrer 2009, chapter 4; where they cross is assumed)."""

LANDFAHRER_ANGLES_DEG = (-12.0, 6.0, 2.0)
"""Heading, pitch and roll of the published sweeps; their yaw of 12 degrees is a heading of -12."""

ERRORS_M = tuple(np.geomspace(0.001, 0.5, 28).tolist())
LENGTHS_M = tuple(np.geomspace(0.1, 10.0, 21).tolist())

_AXES = ("north", "east", "up")
_ENU_FROM_NED = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])


@dataclass(frozen=True, slots=True, eq=False)
class Sweep:
    """Standard deviations of the angles against one quantity, n values of it.

    Parameters
    ----------
    title : str
        One line.
    name : str
        Name of the quantity with its unit, as of a column.
    label : str
        The same in words.
    x : ndarray, shape (n,)
        Its values.
    curves_deg : dict of str to ndarray, shape (n, 3)
        Heading, pitch and roll by method; NaN for what is not observed.
    """

    title: str
    name: str
    label: str
    x: np.ndarray
    curves_deg: dict[str, np.ndarray]

    def columns(self) -> dict[str, np.ndarray]:
        """One row a value: name of the column and its values."""
        return {
            self.name: self.x,
            **{
                f"{angle}_sd_deg_{method.replace(' ', '_')}": curve[:, k]
                for method, curve in self.curves_deg.items()
                for k, angle in enumerate(ANGLES)
            },
        }

    def to_dict(self) -> dict[str, Any]:
        """Values that JSON can hold."""

        def plain(values: np.ndarray) -> list[float | None]:
            return [float(value) if np.isfinite(value) else None for value in values]

        return {"title": self.title, **{name: plain(values) for name, values in self.columns().items()}}

    def __str__(self) -> str:
        """About ten rows of the sweep."""
        lines = [
            self.title,
            f"{'':<13}" + "".join(f"{method:>30}" for method in self.curves_deg),
            f"{self.name:<13}" + "".join(f"{angle:>10}" for angle in ANGLES) * len(self.curves_deg),
        ]
        rows = np.unique(np.rint(np.linspace(0, len(self.x) - 1, min(len(self.x), 10))).astype(int))
        for k in rows:
            words = "".join(
                f"{'-':>10}" if not np.isfinite(value) else f"{value:10.4g}"
                for curve in self.curves_deg.values()
                for value in curve[k]
            )
            lines.append(f"{self.x[k]:<13.4g}{words}")
        return "\n".join(lines)


def sweep_error(
    antennas: Any = LANDFAHRER_ANTENNAS,
    *,
    angles_deg: tuple[float, float, float] = LANDFAHRER_ANGLES_DEG,
    errors_m: Any = ERRORS_M,
) -> Sweep:
    """Sweep the error that all coordinates of all antennas have in common.

    Parameters
    ----------
    antennas : array_like, shape (k, 3)
        Body coordinates, metres forward, right, down.
    angles_deg : tuple of float
        Heading, pitch and roll.
    errors_m : array_like, shape (n,)
        Standard deviation of each coordinate, independent.

    Returns
    -------
    Sweep

    Examples
    --------
    >>> found = sweep_error(errors_m=[0.01, 0.1])
    >>> (found.curves_deg["adjusted"][1] / found.curves_deg["adjusted"][0]).round(9).tolist()
    [10.0, 10.0, 10.0]
    """
    positions_m, errors_m = _antennas(antennas), _errors(errors_m)
    variance = np.broadcast_to(errors_m[:, None, None] ** 2, (len(errors_m), len(positions_m), 3))
    return Sweep(
        title=f"every coordinate of {len(positions_m)} antennas off by the same",
        name="error_m",
        label="error of every coordinate, m",
        x=errors_m,
        curves_deg=_both(positions_m, variance, angles_deg),
    )


def sweep_coordinate(
    antennas: Any = LANDFAHRER_ANTENNAS,
    *,
    antenna: int = 1,
    axis: str = "north",
    others_m: float = 0.1,
    angles_deg: tuple[float, float, float] = LANDFAHRER_ANGLES_DEG,
    errors_m: Any = ERRORS_M,
) -> Sweep:
    """Sweep the error of one coordinate of one antenna.

    Parameters
    ----------
    antennas : array_like, shape (k, 3)
        Body coordinates, metres forward, right, down.
    antenna : int
        Which one, from 0.
    axis : str
        ``north``, ``east`` or ``up``.
    others_m : float
        Error of all other coordinates.
    angles_deg : tuple of float
        Heading, pitch and roll.
    errors_m : array_like, shape (n,)
        Standard deviation of the coordinate.

    Returns
    -------
    Sweep
    """
    positions_m, errors_m = _antennas(antennas), _errors(errors_m)
    if axis not in _AXES:
        raise ConfigError(f"`axis` is {axis!r}; give one of " + ", ".join(_AXES), key="axis", value=axis)
    if not 0 <= antenna < len(positions_m):
        raise ConfigError(
            f"`antenna` is {antenna!r}; give 0 to {len(positions_m) - 1}", key="antenna", value=antenna
        )
    if not others_m > 0.0:
        raise ConfigError(f"`others_m` is {others_m!r}; give a positive error", key="others_m")
    variance = np.full((len(errors_m), len(positions_m), 3), others_m**2)
    variance[:, antenna, _AXES.index(axis)] = errors_m**2
    return Sweep(
        title=f"{axis} of antenna {antenna + 1} swept, {others_m:g} m everywhere else",
        name="error_m",
        label=f"error of {axis} of antenna {antenna + 1}, m",
        x=errors_m,
        curves_deg=_both(positions_m, variance, angles_deg),
    )


def sweep_length(
    *,
    which: str = "a",
    lengths_m: Any = LENGTHS_M,
    a_m: float = 2.16,
    b_m: float = 1.57,
    included_angle_deg: float = 45.0,
    error_m: float = 0.01,
    form: str = "sine",
) -> Sweep:
    """Sweep the length of one of two baselines: a ahead, b at an angle to it.

    Parameters
    ----------
    which : str
        ``a`` or ``b``.
    lengths_m : array_like, shape (n,)
        Its lengths.
    a_m, b_m : float
        Length of the one that is held; by default the published example.
    included_angle_deg : float
        Angle between them.
    error_m : float
        Closed form: of each coordinate difference. Adjusted: of each coordinate of each antenna.
    form : str
        ``sine``, or ``cosine`` as printed, see `truenorth.attitude.error_chain.baseline_length_model`.

    Returns
    -------
    Sweep

    Examples
    --------
    >>> sweep_length(which="a", lengths_m=[0.1, 10.0]).curves_deg["closed form"][:, 1].round(4).tolist()
    [5.7296, 0.0573]
    """
    if which not in ("a", "b"):
        raise ConfigError(f"`which` is {which!r}; give a or b", key="which", value=which)
    lengths_m = np.atleast_1d(np.asarray(lengths_m, dtype=float))
    if not (np.all(lengths_m > 0.0) and a_m > 0.0 and b_m > 0.0 and error_m > 0.0):
        raise ConfigError("lengths and errors of a sweep must be positive metres", key="lengths_m")
    gamma = float(np.radians(included_angle_deg))
    if not np.sin(gamma) > 1e-6:
        raise ConfigError(
            f"`included_angle_deg` is {included_angle_deg!r}; give an angle between 0 and 180",
            key="included_angle_deg",
            value=included_angle_deg,
        )
    a = lengths_m if which == "a" else np.full(len(lengths_m), a_m)
    b = lengths_m if which == "b" else np.full(len(lengths_m), b_m)
    closed = baseline_length_model(error_m, a, b, gamma, form=form)
    shape = np.shape(lengths_m)
    angles = (closed.yaw_rad, closed.pitch_rad, closed.roll_rad)
    adjusted = np.empty((len(lengths_m), 3))
    for k in range(len(lengths_m)):
        positions_m = np.array(
            [[0.0, 0.0, 0.0], [a[k], 0.0, 0.0], [b[k] * np.cos(gamma), b[k] * np.sin(gamma), 0.0]]
        )
        adjusted[k] = _adjusted(positions_m, np.full((1, 3, 3), error_m**2), (0.0, 0.0, 0.0))[0]
    held = f"b = {b_m:g} m" if which == "a" else f"a = {a_m:g} m"
    return Sweep(
        title=f"baseline {which} swept, {held}, {included_angle_deg:g} deg between, error {error_m:g} m",
        name=f"{which}_m",
        label=f"length of baseline {which}, m",
        x=lengths_m,
        curves_deg={
            "closed form": np.degrees(np.stack([np.broadcast_to(angle, shape) for angle in angles], axis=-1)),
            "adjusted": adjusted,
        },
    )


def _antennas(antennas: Any) -> np.ndarray:
    positions_m = np.asarray(antennas, dtype=float)
    if positions_m.ndim != 2 or positions_m.shape[1] != 3 or not np.all(np.isfinite(positions_m)):
        raise ConfigError("`antennas` are not points of three coordinates in metres", key="antennas")
    if len(positions_m) < 3:
        raise ConfigError(
            f"a sweep of errors needs three antennas, {len(positions_m)} are given; give another one",
            key="antennas",
        )
    if array_extent_m(positions_m - positions_m[0])[1] < MIN_ACROSS_M:
        raise ConfigError(
            "a sweep of errors needs antennas that are not all on one line; move one off it", key="antennas"
        )
    return positions_m


def _errors(errors_m: Any) -> np.ndarray:
    errors_m = np.atleast_1d(np.asarray(errors_m, dtype=float))
    if not np.all((errors_m > 0.0) & np.isfinite(errors_m)):
        raise ConfigError(
            "`errors_m` are not all positive; give standard deviations in metres", key="errors_m"
        )
    return errors_m


def _both(
    positions_m: np.ndarray, variance_m2: np.ndarray, angles_deg: tuple[float, float, float]
) -> dict[str, np.ndarray]:
    """Published chain, where the first three antennas span a plane, and adjustment."""
    curves = {}
    if array_extent_m(positions_m[:3] - positions_m[0])[1] >= MIN_ACROSS_M:
        curves["three vectors"] = _published(positions_m[:3], variance_m2[:, :3], angles_deg)
    curves["adjusted"] = _adjusted(positions_m, variance_m2, angles_deg)
    return curves


def _published(
    positions_m: np.ndarray, variance_m2: np.ndarray, angles_deg: tuple[float, float, float]
) -> np.ndarray:
    """Heading, pitch and roll by the direct method, degrees; variances of north, east, up."""
    enu_m = positions_m @ rot_ned_from_body(*np.radians(angles_deg)).T @ _ENU_FROM_NED.T
    rfu_m = positions_m @ _ENU_FROM_NED.T
    variance = variance_m2[..., [1, 0, 2]].reshape(len(variance_m2), 9)
    cov = variance[:, :, None] * np.eye(9)
    chain = three_antenna_chain(enu_m, cov, rfu_m, np.zeros((9, 9)))
    return np.degrees(chain.sd_rad[..., [2, 1, 0]])


def _adjusted(
    positions_m: np.ndarray, variance_m2: np.ndarray, angles_deg: tuple[float, float, float]
) -> np.ndarray:
    """Heading, pitch and roll by weighted least squares over all antennas, degrees."""
    rot = rot_ned_from_body(*np.radians(angles_deg))
    lever = skew((positions_m - positions_m[0]) @ rot.T)
    weight = 1.0 / variance_m2
    # A common shift is unknown: what the weighted mean of the columns takes is eliminated, axis by axis.
    mean = np.einsum("nai,aij->nij", weight, lever) / weight.sum(1)[:, :, None]
    centred = lever - mean[:, None]
    normal = np.einsum("naij,nai,naik->njk", centred, weight, centred)
    inverse = angle_jacobian(rot[None])[0]
    cov = inverse @ np.linalg.inv(normal) @ inverse.T
    return np.degrees(np.sqrt(np.einsum("nii->ni", cov)))
