"""Small scenarios that the tests of the emulator share."""

import copy

_PLACE = {"latitude_deg": 47.0, "longitude_deg": 15.4, "height_m": 400.0}

NOISELESS = {
    "noise": {"kind": "constant", "code_sd_m": 0.0, "phase_sd_m": 0.0, "doppler_sd_hz": 0.0},
    "bias": {"code_sd_m": 0.0, "phase_sd_cyc": 0.0},
    "cn0_sd_db": 0.0,
}
"""A receiver without noise and line biases; its clock still runs."""


def pair(*, duration_s=30.0, length_m=1.0, heading_deg=30.0, receiver=None, **sections):
    """Two antennas in a row, at rest by default."""
    return {
        "name": "pair",
        "duration_s": duration_s,
        "place": dict(_PLACE),
        "platform": {
            "antennas": [
                {"name": "aft", "position_body_m": [0.0, 0.0, 0.0]},
                {"name": "fore", "position_body_m": [length_m, 0.0, 0.0]},
            ]
        },
        "motion": {"kind": "static", "heading_deg": heading_deg},
        "receiver": copy.deepcopy(receiver or {}),
        **sections,
    }
