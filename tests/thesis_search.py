"""The search cases of Oguz 2006 without an emulator: given directions, phases by the plane-wave model."""

import numpy as np

from truenorth.ambiguity.exhaustive import search_single_differences
from truenorth.constants import SPEED_OF_LIGHT_MPS

HEADING_RAD = np.radians(11.0)
WAVELENGTH_M = SPEED_OF_LIGHT_MPS / 1575.42e6
THESIS_WAVELENGTH_M = 0.20

# Directions (north, east, down) of three satellites for which the thesis's digit sets are true integers.
SKY_NED = np.array(
    [
        (np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), -np.sin(e))
        for a, e in np.radians([(20.0, 40.0), (160.0, 55.0), (80.0, 30.0)])
    ]
)

# Length, largest integer, phase noise of a single difference in cycles, set, place, azimuth in
# degrees, as printed in the thesis (exhaustive search).
SEARCH_CASES = (
    (0.20, 1, 0.0, (1, 0, 0), 23, 10.9877),
    (0.50, 2, 0.0, (2, -1, 1), 109, 10.9928),
    (0.76, 4, 0.0, (3, -2, 1), 591, 10.9928),
)


def search_case(length_m, bound, sd_cyc, integers, rng=None, start="least_squares"):
    """One search with the thesis's wavelength and candidate sets."""
    along = np.array([np.cos(HEADING_RAD), np.sin(HEADING_RAD), 0.0])
    fraction = SKY_NED @ along * length_m / THESIS_WAVELENGTH_M - integers
    if rng is not None:
        fraction = fraction + sd_cyc * rng.standard_normal(3)
    return search_single_differences(
        fraction,
        SKY_NED,
        [length_m, 0.0, 0.0],
        THESIS_WAVELENGTH_M,
        bound=bound,
        # The thesis does not give its limit; noise-free cases get one that only rounding errors pass.
        cost_limit_cyc2=1e-12 if sd_cyc == 0.0 else None,
        single_difference_sd_cyc=max(sd_cyc, 1e-6),
        start=start,
    )


def azimuth_deg(sets, k=0):
    """Azimuth of candidate k's baseline, degrees."""
    north, east, _ = sets.direction_local[k, 0, 0]
    return float(np.degrees(np.arctan2(east, north)))
