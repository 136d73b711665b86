"""The Earth's field against the test values published with another model of it."""

import numpy as np
import pytest

from truenorth.sensors.compass import declination_rad, earth_field_ned_nt
from truenorth.timescales import gpst_from_calendar

# The US/UK World Magnetic Model for 2020-2025: Technical Report (NOAA, 2020), table 1d, 2020.0 at height 0:
# latitude, longitude; north, east, down in nT; declination in degrees.
WMM2020 = [
    (80.0, 0.0, (6570.4, -146.3, 54606.0), -1.28),
    (0.0, 120.0, (39624.3, 109.9, -10932.5), 0.16),
    (-80.0, 240.0, (5940.6, 15772.1, -52480.8), 69.36),
]


@pytest.mark.parametrize(("latitude_deg", "longitude_deg", "field_nt", "declination_deg"), WMM2020)
def test_field_agrees_with_the_world_magnetic_model(latitude_deg, longitude_deg, field_nt, declination_deg):
    place = (np.radians(latitude_deg), np.radians(longitude_deg), 0.0, gpst_from_calendar(2020, 1, 1))
    # Both models claim some tens of nanotesla for the core field at their epoch.
    np.testing.assert_allclose(earth_field_ned_nt(*place), field_nt, atol=40.0)
    assert np.degrees(declination_rad(*place)) == pytest.approx(declination_deg, abs=0.1)
