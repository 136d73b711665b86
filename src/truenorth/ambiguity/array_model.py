r"""One epoch of raw phases of a rigid array, as the joint search takes it.

One row is one antenna, satellite and signal. With R the attitude, l_a the body coordinates of antenna a and
e the direction to the satellite,

    phase_m = lambda N + h . (R l_a) + c_s + t_ag + noise,      h = -e in north, east, down
    code_m  =            h . (R l_a) + c'_s + t'_ag + noise

c_s is all that the antennas share of a satellite and signal (orbit, clock, atmosphere, and the place of
the platform), t_ag the clock and hardware delay of an antenna in the group g of signals of one system, band
and tracking. Noise is independent from row to row. Eliminating every c_s and t_ag is the adjustment of all
double differences with their full covariance, between satellites and between the baselines that share an
antenna, for every choice of reference satellite and reference antenna; no antenna is the reference, and none
need see all satellites. Integers are fixed up to constants of a satellite and of a clock: replacing N by
N + m_s + n_ag changes nothing.

References
----------
P. J. G. Teunissen, "The affine constrained GNSS attitude model and its multivariate integer least-squares
solution", Journal of Geodesy 86 (2012); G. Giorgi, P. J. G. Teunissen, S. Verhagen, P. J. Buist,
"Instantaneous ambiguity resolution in GNSS-based attitude determination applications: a multivariate
constrained approach", Journal of Guidance, Control, and Dynamics 35 (2012).
"""

from dataclasses import dataclass

import numpy as np

__all__ = ["ArrayEpoch"]


@dataclass(frozen=True, slots=True, eq=False)
class ArrayEpoch:
    """One epoch of all antennas; rows sorted by (group, satellite, antenna).

    Parameters
    ----------
    antenna : ndarray of int64, shape (n,)
        Index into `positions_body_m`.
    satellite : ndarray of int64, shape (n,)
        Number of the satellite and signal, 0, 1, ... in the order of the rows: one number for each c_s.
    group : ndarray of int64, shape (n,)
        Number of the system, band and tracking, 0, 1, ... in the order of the rows.
    phase_m, code_m : ndarray, shape (n,)
        Observed less modelled, metres; NaN where there is none.
    design_ned : ndarray, shape (n, 3)
        -e; the same for all rows of a satellite.
    wavelength_m : ndarray, shape (n,)
        Of the carrier.
    phase_variance_m2, code_variance_m2 : ndarray, shape (n,)
        Of the undifferenced observation of this antenna.
    positions_body_m : ndarray, shape (n_antennas, 3)
        Body coordinates l_a.
    position_sd_m : float
        Standard deviation of each body coordinate, independent; 0 takes them as exact.
    """

    antenna: np.ndarray
    satellite: np.ndarray
    group: np.ndarray
    phase_m: np.ndarray
    code_m: np.ndarray
    design_ned: np.ndarray
    wavelength_m: np.ndarray
    phase_variance_m2: np.ndarray
    code_variance_m2: np.ndarray
    positions_body_m: np.ndarray
    position_sd_m: float = 0.0

    @property
    def n_antennas(self):
        """int: Antennas of the platform, also those without a row."""
        return len(self.positions_body_m)
