"""Physical constants, units of data sheets, satellite systems, bands and carrier frequencies.

Sources: GPS IS-GPS-200N, Galileo OS-SIS-ICD 2.1, BeiDou BDS-SIS-ICD (B1I 3.0, B3I 1.0, B1C 1.0,
B2a 1.0, B2b 1.0), GLONASS ICD L1/L2 5.1 and CDMA ICDs 1.0, QZSS IS-QZSS-PNT-005, IRNSS SIS ICD 1.1,
RINEX 4.01 tables 12-18 (band digits).
"""

import numpy as np

SPEED_OF_LIGHT_MPS = 299_792_458.0

STANDARD_GRAVITY_MPS2 = 9.80665
"""What a ``g`` of data sheets means (CGPM 1901); not the gravity of a place."""

DPH_RADPS = np.pi / 180.0 / 3600.0
"""A degree an hour."""

UG_MPS2 = 1e-6 * STANDARD_GRAVITY_MPS2
"""A millionth of standard gravity."""

SYSTEMS = "GRECJIS"
"""System letters in the order of the integer codes: GPS, GLONASS, Galileo, BeiDou, QZSS, NavIC, SBAS."""

SYSTEM_NAMES = {
    "G": "GPS",
    "R": "GLONASS",
    "E": "Galileo",
    "C": "BeiDou",
    "J": "QZSS",
    "I": "NavIC",
    "S": "SBAS",
}

GPS, GLONASS, GALILEO, BEIDOU, QZSS, NAVIC, SBAS = range(7)

N_BANDS = 10
"""Band digits of RINEX run from 1 to 9; index 0 stays unused."""

_MHZ = {
    "G": {1: 1575.42, 2: 1227.60, 5: 1176.45},
    # GLONASS FDMA bands 1 and 2 hold the frequency of channel 0.
    "R": {1: 1602.0, 2: 1246.0, 3: 1202.025, 4: 1600.995, 6: 1248.06},
    "E": {1: 1575.42, 5: 1176.45, 6: 1278.75, 7: 1207.140, 8: 1191.795},
    "C": {1: 1575.42, 2: 1561.098, 5: 1176.45, 6: 1268.52, 7: 1207.140, 8: 1191.795},
    "J": {1: 1575.42, 2: 1227.60, 5: 1176.45, 6: 1278.75},
    "I": {1: 1575.42, 5: 1176.45, 9: 2492.028},
    "S": {1: 1575.42, 5: 1176.45},
}

FREQUENCY_HZ = np.full((len(SYSTEMS), N_BANDS), np.nan)
"""Carrier frequency by system code and RINEX band digit; GLONASS FDMA at channel 0. Hertz."""
for _system, _bands in _MHZ.items():
    for _band, _mhz in _bands.items():
        FREQUENCY_HZ[SYSTEMS.index(_system), _band] = _mhz * 1e6
FREQUENCY_HZ.setflags(write=False)

GLONASS_CHANNEL_STEP_HZ = {1: 562_500.0, 2: 437_500.0}
"""Frequency step of one GLONASS channel by band digit, hertz."""

BAND_CLASSES = {
    "L1": {"G": (1,), "R": (1, 4), "E": (1,), "C": (2, 1), "J": (1,), "I": (1,), "S": (1,)},
    "L2": {"G": (2,), "R": (2, 6), "E": (7,), "C": (7,), "J": (2,)},
    "L5": {"G": (5,), "R": (3,), "E": (5,), "C": (5,), "J": (5,), "I": (5,), "S": (5,)},
    "L6": {"E": (6,), "C": (6,), "J": (6,)},
    "L8": {"E": (8,), "C": (8,)},
    "S": {"I": (9,)},
}
"""What the user's band names mean in RINEX band digits of each system.

``L1`` holds L1, G1, E1, B1I and B1C; ``L2`` holds L2, G2, E5b and B2I/B2b; ``L5`` holds L5, E5a,
B2a and G3; ``L6`` holds E6, B3I and LEX; ``L8`` the E5/B2 alt-BOC.
"""
