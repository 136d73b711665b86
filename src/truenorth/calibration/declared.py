r"""Measured against declared body coordinates: whether they agree, and which antenna is elsewhere.

The difference d of the two, with covariance Q = C_measured + C_declared, is known up to a motion G x, so

    T = min_x (d - G x)^T Q^-1 (d - G x)

is chi-square of 3 m - 6 degrees of freedom where both describe one array. If antenna a is not where it is
declared, adding its three coordinates to the unknowns, G -> [G, H_a], lowers T by a chi-square of three (of
what is observable of them), and the added unknowns are the displacement. The fewest antennas that bring T
below its limit are held to be elsewhere, provided that no others do it nearly as well.

Reference: W. Baarda, "A testing procedure for use in geodetic networks", Netherlands Geodetic Commission 2
(1968), in the form of multivariate alternatives.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from ..ambiguity.acceptance import chi2_quantile
from .body_frame import motion_jacobian

__all__ = ["DeclaredCheck", "check_declared"]

CLEARLY_WORSE = 9.2
"""Another explanation must be worse by this much in chi-square, a likelihood ratio of a hundred."""

MIN_SD_M = 1e-5
"""No coordinate is declared better than to a hundredth of a millimetre."""


@dataclass(frozen=True, slots=True, eq=False)
class DeclaredCheck:
    """Outcome of the comparison with declared coordinates.

    Parameters
    ----------
    names : tuple of str
        Of the antennas.
    declared_m : ndarray, shape (m, 3)
        What was declared.
    declared_sd_m : float
        How well, each coordinate.
    difference_m : ndarray, shape (m, 3)
        Measured less declared, in the frame of the calibration.
    difference_sd_m : ndarray, shape (m, 3)
        Standard deviations of the differences, declared ones included.
    statistic, limit : float
        Test of all coordinates together, and its limit.
    degrees : int
        Its degrees of freedom.
    antenna_statistic, antenna_limit : ndarray, shape (m,)
        By how much the statistic falls when the antenna may be elsewhere, and the limit of that.
    is_wrong : ndarray of bool, shape (m,)
        Antennas that are not where they are declared.
    is_explained : bool
        Whether they explain the contradiction, and no others do.
    """

    names: tuple[str, ...]
    declared_m: np.ndarray
    declared_sd_m: float
    difference_m: np.ndarray
    difference_sd_m: np.ndarray
    statistic: float
    limit: float
    degrees: int
    antenna_statistic: np.ndarray
    antenna_limit: np.ndarray
    is_wrong: np.ndarray
    is_explained: bool

    @property
    def agrees(self) -> bool:
        """bool: Whether all coordinates agree, together and antenna by antenna."""
        return self.statistic <= self.limit and bool(np.all(self.antenna_statistic <= self.antenna_limit))

    def verdict(self, k: int) -> str:
        """One word for an antenna."""
        if self.is_wrong[k]:
            return "elsewhere"
        return "agrees" if self.agrees or self.is_explained else "in doubt"

    def sentence(self) -> str:
        """The outcome in a sentence."""
        test = f"chi-square {self.statistic:.1f} of {self.degrees} degrees of freedom, limit {self.limit:.1f}"
        worst = int(np.argmax(self.antenna_statistic - self.antenna_limit))
        if not self.agrees and self.statistic <= self.limit:
            test += (
                f"; for {self.names[worst]} alone {self.antenna_statistic[worst]:.1f}, limit "
                f"{self.antenna_limit[worst]:.1f}"
            )
        if self.agrees:
            return f"the declared coordinates agree with the measured ones ({test})"
        if not self.is_wrong.any():
            return (
                f"the declared coordinates contradict the measured ones ({test}), and which antenna "
                "is elsewhere cannot be told; measure them anew"
            )
        parts = [
            f"{name} is off by {1e3 * np.linalg.norm(self.difference_m[k]):.1f} mm "
            f"({_directions(self.difference_m[k])})"
            for k, name in enumerate(self.names)
            if self.is_wrong[k]
        ]
        return (
            f"the declared coordinates contradict the measured ones ({test}): {', '.join(parts)}; the others "
            "agree"
        )

    def in_frame(self, positions_m: np.ndarray, cov_m2: np.ndarray) -> DeclaredCheck:
        """The same outcome with differences in the final frame."""
        variance = np.maximum(np.diag(cov_m2), 0.0).reshape(-1, 3) + self.declared_sd_m**2
        return replace(self, difference_m=positions_m - self.declared_m, difference_sd_m=np.sqrt(variance))

    def to_dict(self) -> dict:
        """Plain values for JSON."""
        return {
            "agrees": bool(self.agrees),
            "sentence": self.sentence(),
            "statistic": self.statistic,
            "limit": self.limit,
            "degrees_of_freedom": self.degrees,
            "declared_sd_m": self.declared_sd_m,
            "antennas": [
                {
                    "name": name,
                    "declared_m": self.declared_m[k].tolist(),
                    "difference_m": self.difference_m[k].tolist(),
                    "difference_sd_m": self.difference_sd_m[k].tolist(),
                    "statistic": float(self.antenna_statistic[k]),
                    "limit": float(self.antenna_limit[k]),
                    "verdict": self.verdict(k),
                }
                for k, name in enumerate(self.names)
            ],
        }


def _directions(difference_m):
    """A displacement in words."""
    words = (("forward", "aft"), ("right", "left"), ("down", "up"))
    said = [
        f"{1e3 * abs(value):.1f} mm {pair[0 if value > 0.0 else 1]}"
        for value, pair in zip(difference_m, words, strict=True)
        if abs(value) >= 0.5e-3
    ]
    return ", ".join(said) or "less than 0.5 mm on each axis"


def check_declared(positions_m, cov_m2, declared_m, declared_sd_m, names, *, significance=1e-3):
    """Compare measured coordinates with declared ones.

    Parameters
    ----------
    positions_m : ndarray, shape (m, 3)
        Measured, in a frame near that of the declared ones.
    cov_m2 : ndarray, shape (3 m, 3 m)
        Their covariance; singular for motions of the frame.
    declared_m : ndarray, shape (m, 3)
        Declared.
    declared_sd_m : float
        Standard deviation of each.
    names : sequence of str
        Of the antennas.
    significance : float
        False-alarm rate.

    Returns
    -------
    DeclaredCheck
    """
    m = len(positions_m)
    cov = cov_m2 + max(declared_sd_m, MIN_SD_M) ** 2 * np.eye(3 * m)
    factor = np.linalg.inv(np.linalg.cholesky(cov))
    difference = factor @ (positions_m - declared_m).ravel()
    motion = factor @ motion_jacobian(declared_m)
    own = [factor[:, 3 * k : 3 * k + 3] for k in range(m)]

    def left(wrong):
        """Square sum that is left when some antennas may be elsewhere, and its degrees of freedom."""
        design = np.hstack([motion, *(own[k] for k in wrong)])
        axes, size, _ = np.linalg.svd(design, full_matrices=False)
        axes = axes[:, size > 1e-7 * size[0]]
        rest = difference - axes @ (axes.T @ difference)
        return float(rest @ rest), 3 * m - axes.shape[1]

    def limit(degrees):
        return chi2_quantile(1.0 - significance, degrees) if degrees > 0 else 0.0

    total, degrees = left(())
    statistic, wrong = total, []
    single = [left((k,)) for k in range(m)]
    drop = np.array([total - value for value, _ in single])
    drop_limit = np.array(
        [chi2_quantile(1.0 - significance / m, max(degrees - count, 1)) for _, count in single]
    )
    explained = False
    contradicts = total > limit(degrees) or bool(np.any(drop > drop_limit))
    for size in range(1, m - 1) if contradicts else ():
        tried = sorted((left(some)[0], some) for some in combinations(range(m), size))
        best, blamed = tried[0]
        if best <= limit(left(blamed)[1]):
            # Others must not explain the data nearly as well.
            explained = tried[1][0] - best > CLEARLY_WORSE
            wrong = list(blamed) if explained else []
            break
    is_wrong = np.zeros(m, bool)
    is_wrong[wrong] = True
    return DeclaredCheck(
        names=tuple(names),
        declared_m=declared_m,
        declared_sd_m=declared_sd_m,
        difference_m=positions_m - declared_m,
        difference_sd_m=np.sqrt(np.maximum(np.diag(cov), 0.0)).reshape(-1, 3),
        statistic=statistic,
        limit=limit(degrees),
        degrees=degrees,
        antenna_statistic=drop,
        antenna_limit=drop_limit,
        is_wrong=is_wrong,
        is_explained=bool(explained),
    )
