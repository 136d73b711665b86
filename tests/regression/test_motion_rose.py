"""The motion of a hardware simulator, re-created from its truth file."""

import csv
import gzip

import numpy as np

from truenorth.frames import geodetic_from_ecef, rot_ned_from_ecef
from truenorth.simulation.motion import TableMotion, build_trajectory

FILE = "Rover-dynamic_PVA_Spirent.csv.gz"
COLUMNS = {
    "time_s": "Time [s]",
    "x_m": "Pos ECEF X [m]",
    "y_m": "Pos ECEF Y [m]",
    "z_m": "Pos ECEF Z [m]",
    "heading_deg": "Yaw [deg]",
    "pitch_deg": "Pitch [deg]",
    "roll_deg": "Roll [deg]",
}


def test_spirent_rose(data_dir):
    folder = data_dir / "moving_simulator_rose"
    with gzip.open(folder / FILE, "rt") as stream:
        rows = list(csv.DictReader(stream))
    time_s = np.array([float(row["Time [s]"]) for row in rows])
    position, velocity = (
        np.array([[float(row[f"{what} ECEF {axis} {unit}"]) for axis in "XYZ"] for row in rows])
        for what, unit in (("Pos", "[m]"), ("Vel", "[m/s]"))
    )
    moving = build_trajectory(
        TableMotion(file=FILE, columns=COLUMNS),
        latitude_rad=0.0,
        longitude_rad=0.0,
        height_m=0.0,
        duration_s=600.0,
        seed=0,
        folder=str(folder),
    )
    motion = moving.at(time_s)
    # At the rows the positions are those of the file; doubles of 6e6 m hold a nanometre.
    assert np.max(np.abs(motion.position_ecef_m - position)) < 1e-8
    # Positions rounded to 0.1 mm at 10 Hz give velocities to 1 mm/s, rounded to 0.1 mm/s in the file.
    inner = slice(10, -10)
    assert np.sqrt(np.mean((motion.velocity_ecef_mps - velocity)[inner] ** 2)) < 1e-3
    assert np.max(np.abs(motion.velocity_ecef_mps - velocity)[inner]) < 4e-3
    # Between the rows, too: the middle of the chord less the sag of the curve, by the velocities of the file.
    half = moving.at(time_s[inner][:-1] + 0.05)
    middle = 0.5 * (position[:-1] + position[1:])[inner]
    sag = (velocity[1:] - velocity[:-1])[inner] * 0.1 / 8.0
    assert np.max(np.abs(half.position_ecef_m - (middle - sag))) < 3e-4
    # It drives forwards: the course is the yaw of the file.
    yaw = np.radians([float(row["Yaw [deg]"]) for row in rows])
    off = np.angle(np.exp(1j * (moving.course_rad(time_s) - yaw)))
    assert np.degrees(np.max(np.abs(off[inner]))) < 0.3
    latitude, longitude, height = geodetic_from_ecef(position)
    down = np.einsum("nj,nj->n", rot_ned_from_ecef(latitude, longitude)[:, 2], motion.velocity_ecef_mps)
    assert np.max(np.abs(down[inner])) < 5e-3
    assert np.ptp(height) < 2e-3
