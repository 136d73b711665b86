r"""What an accelerometer on a turntable feels of the Earth's rotation, exactly, and north from it.

The table turns by :math:`\Omega` about its own upward normal, counter-clockwise positive. In its axes
(x forward at angle zero, y right, z down) the accelerometer stands at :math:`\rho\,e_r`,
:math:`e_r = (\cos\alpha, -\sin\alpha, 0)`, and its axis is the normal, leaning by a outwards and by b along
the motion (of a table that turns counter-clockwise). With the Earth rate w and the specific force f of a
platform at rest, both in table axes, the part that varies once a revolution is :math:`h \cdot e_r`,

.. math::
    h = \frac{\rho\,(2 \Omega + w_u)\, w_h + a f_h + b\, z \times f_h}{\sqrt{1 + a^2 + b^2}},

where h as an index takes the two components in the plane of the table and u the upward one. This is exact
but for the lean times :math:`\rho w^2` (1e-13 m/s^2). On a level table at heading :math:`\psi` it is the
textbook's :math:`2\Omega w_N \rho \cos(\alpha - \psi)` (Oguz 2006, eq. 5.12; there :math:`\psi` is counted
counter-clockwise). The rest is constant: gravity along the normal, bias, and
:math:`-a \rho (\Omega + w_u)^2`.

What can be told apart:

- A tilt of the platform turns w out of the plane and reaches the azimuth by about
  :math:`\theta \tan\varphi` (Oguz 2006, eq. 5.20). Its part about the north axis is the harm; the amplitude
  only feels the other part, and the mean only its square, below any bias. So tilt must be measured by
  something else; where it is known, it is taken off exactly.
- A leaning axis alone gives no harmonic. A leaning axis on a tilted table does: lean times tilt times
  gravity, 1 mrad times 1 mrad being 1e-5 m/s^2, or 1.6 degrees at latitude 40. It does not change with the
  speed of the table while the Coriolis term does: runs at two speeds separate them, best at equal speeds in
  opposite directions.

References
----------
P. Oguz, Implementation of Northfinding Techniques, M.Sc. thesis, Middle East Technical University (2006),
ch. 5.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..gravity import EARTH_RATE_RADPS
from ..rotations import rot_ned_from_body
from ..sensors.turntable_accelerometer import TurntableAccelerometerDescription
from .site import Site

__all__ = [
    "TableGeometry",
    "first_harmonic_mps2",
    "heading_from_harmonic_rad",
    "heading_jacobian",
    "inclination_error_rad",
    "table_geometry",
]


class TableGeometry(NamedTuple):
    """A table on a platform of known tilt: everything but the heading.

    Parameters
    ----------
    rot_table_from_level : ndarray, shape (3, 3)
        From the level frame at the platform's heading to table axes.
    force_plane_mps2 : ndarray, shape (2,)
        Specific force in the plane of the table: gravity felt because of the tilt.
    radius_m : float
        Of the accelerometer.
    lean_rad : ndarray, shape (2,)
        Of its axis, outwards and along the motion.
    north_radps, down_radps, up_radps : float
        Earth rate: northward and downward, and along the table's normal upward to first order.
    """

    rot_table_from_level: np.ndarray
    force_plane_mps2: np.ndarray
    radius_m: float
    lean_rad: np.ndarray
    north_radps: float
    down_radps: float
    up_radps: float

    def gain_mps(self, rate_radps: float) -> float:
        """Acceleration per Earth rate in the plane, ``rho (2 Omega + w_u) / sqrt(1 + a^2 + b^2)``."""
        return float(self.radius_m * (2.0 * rate_radps + self.up_radps) / self.lean_norm)

    @property
    def lean_norm(self) -> float:
        """float: Length of the axis before it is made a unit vector."""
        return float(np.sqrt(1.0 + self.lean_rad @ self.lean_rad))

    @property
    def lean_mps2(self) -> np.ndarray:
        """ndarray, shape (2,): What gravity adds to the harmonic because the axis leans."""
        a, b = self.lean_rad
        fx, fy = self.force_plane_mps2
        return np.array([a * fx - b * fy, a * fy + b * fx]) / self.lean_norm

    def rate_plane_radps(self, heading_rad: float) -> np.ndarray:
        """Earth rate in the plane of the table at a heading, shape (2,)."""
        level = np.array(
            [
                self.north_radps * np.cos(heading_rad),
                -self.north_radps * np.sin(heading_rad),
                self.down_radps,
            ]
        )
        return np.asarray((self.rot_table_from_level @ level)[:2])


def table_geometry(
    sensor: TurntableAccelerometerDescription,
    site: Site,
    *,
    tilt_rad: tuple[float, float] = (0.0, 0.0),
) -> TableGeometry:
    """Geometry of a described table on a platform of known tilt.

    Parameters
    ----------
    sensor : TurntableAccelerometerDescription
        Its radius, its tilt in the platform and the lean of its axis.
    site : Site
        Where.
    tilt_rad : tuple of float
        Pitch and roll of the platform.

    Returns
    -------
    TableGeometry
    """
    pitch, roll = tilt_rad
    level_from_body = rot_ned_from_body(0.0, pitch, roll)
    body_from_table = rot_ned_from_body(
        0.0, np.radians(sensor.tilt_pitch_deg), np.radians(sensor.tilt_roll_deg)
    )
    rot = (level_from_body @ body_from_table).T
    north = site.horizontal_rate_radps
    down = float(-EARTH_RATE_RADPS * np.sin(site.latitude_rad))
    return TableGeometry(
        rot_table_from_level=rot,
        force_plane_mps2=(rot @ site.force_ned_mps2)[:2],
        radius_m=sensor.radius_m,
        lean_rad=1e-3 * np.array(sensor.axis_error_mrad),
        north_radps=north,
        down_radps=down,
        up_radps=float(-rot[2, 2] * down),
    )


def first_harmonic_mps2(geometry: TableGeometry, rate_radps: float, heading_rad: float) -> np.ndarray:
    """Vector h of the once-per-revolution signal ``h . (cos alpha, -sin alpha)``.

    Parameters
    ----------
    geometry : TableGeometry
        The table.
    rate_radps : float
        Its speed, counter-clockwise positive.
    heading_rad : float
        Of the platform.

    Returns
    -------
    ndarray, shape (2,)
        m/s^2; on a level table its direction is that of north, forward and right.
    """
    rate_plane = geometry.rate_plane_radps(heading_rad)
    return np.asarray(geometry.gain_mps(rate_radps) * rate_plane + geometry.lean_mps2)


def heading_from_harmonic_rad(
    geometry: TableGeometry, rate_plane_radps: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    r"""Heading from the Earth rate in the plane of a table whose tilt is known.

    With the rotation Q from level to table axes, cut to the plane,
    :math:`w_h = Q_{hh} v + Q_{hd} w_D` is solved for the level north vector
    :math:`v = w_N (\cos\psi, -\sin\psi)`: exact for any tilt.

    Parameters
    ----------
    geometry : TableGeometry
        The table.
    rate_plane_radps : ndarray, shape (..., 2)
        Measured harmonic less that of the lean, over the gain.

    Returns
    -------
    heading_rad : ndarray, shape (...)
        Clockwise from true north in [0, 2 pi).
    north_radps : ndarray, shape (...)
        Horizontal Earth rate that was found; should be that of the latitude.
    """
    rot = geometry.rot_table_from_level
    level = (rate_plane_radps - rot[:2, 2] * geometry.down_radps) @ np.linalg.inv(rot[:2, :2]).T
    heading = np.mod(np.arctan2(-level[..., 1], level[..., 0]), 2.0 * np.pi)
    # The remainder of a tiny negative angle rounds up to the full circle itself.
    return np.where(heading >= 2.0 * np.pi, 0.0, heading), np.hypot(level[..., 0], level[..., 1])


def heading_jacobian(geometry: TableGeometry, heading_rad: float) -> np.ndarray:
    """Derivative of the heading by the Earth rate in the plane of the table, shape (2,), s."""
    across = np.array([-np.sin(heading_rad), -np.cos(heading_rad)]) / geometry.north_radps
    return np.asarray(across @ np.linalg.inv(geometry.rot_table_from_level[:2, :2]))


def inclination_error_rad(inclination_rad: float, latitude_rad: float, axis_rad: float) -> float:
    """Azimuth error of a tilted table, ``atan(tilt tan(latitude) cos(axis))``, radians.

    The published first-order formula (Oguz 2006, eq. 5.20), kept as a check of `heading_from_harmonic_rad`,
    which is exact.

    Parameters
    ----------
    inclination_rad : float
        Tilt of the table.
    latitude_rad : float
        Of the place.
    axis_rad : float
        Azimuth of the horizontal axis about which it is tilted.

    Returns
    -------
    float
        Its size; the sign depends on the sense of the tilt.
    """
    return float(np.arctan(inclination_rad * np.tan(latitude_rad) * np.cos(axis_rad)))
