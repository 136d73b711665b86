"""How the cost of an epoch grows with the double differences: one epoch alone, and held over many.

Simulated single differences on two frequencies with the satellites of several systems, 1 m baseline of
known length, code 0.3 m and phase 3 mm; the compiled engine only (no files, no orbits), after
compilation. "Alone" searches every epoch from nothing, "carried" searches with the memory of the epochs
before, "held" re-validates held integers. The budget of the steady state is 300 us at 40 double
differences.

    python benchmarks/engine_scaling.py --write
"""

import sys
import time
from pathlib import Path

import machine
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tools"))

from engine_run import Rows, run_engine

WAVELENGTHS_M = (0.190293673, 0.244210213)
SATELLITES = (5, 9, 13, 21, 31, 41, 61)
EPOCHS = 300


def simulate(n_sats, n_epochs, n_bands=2, seed=1):
    """Epochs of 1 s with `n_sats` satellites on each band, slowly turning about the zenith."""
    rng = np.random.default_rng([seed, n_sats])
    azimuth = np.arange(n_sats) * 2.399963 + 1e-4 * np.arange(n_epochs)[:, None]
    up = np.broadcast_to(np.linspace(0.97, 0.25, n_sats), azimuth.shape)
    level = np.sqrt(1.0 - up**2)
    sky = np.stack([level * np.sin(azimuth), level * np.cos(azimuth), up], axis=-1)
    heading = 0.01 * np.arange(n_epochs)
    baseline = np.column_stack([np.sin(heading), np.cos(heading), 0.0 * heading])
    clean = -np.einsum("esr,er->es", sky, baseline)
    wavelength = np.repeat(WAVELENGTHS_M[:n_bands], n_sats)
    m = n_sats * n_bands
    phase = np.tile(clean, (1, n_bands)) + wavelength * rng.integers(-20, 20, m)
    return Rows(
        start=np.arange(n_epochs + 1) * m,
        phase_m=(phase + 0.003 * np.sqrt(2.0) * rng.standard_normal(phase.shape)).ravel(),
        code_m=(np.tile(clean, (1, n_bands)) + 0.3 * np.sqrt(2.0) * rng.standard_normal(phase.shape)).ravel(),
        design=-np.tile(sky, (1, n_bands, 1)).reshape(-1, 3),
        wavelength_m=np.tile(wavelength, n_epochs),
        phase_variance_m2=np.full(n_epochs * m, 2 * 0.003**2),
        code_variance_m2=np.full(n_epochs * m, 2 * 0.3**2),
        group=np.tile(np.repeat(np.arange(n_bands), n_sats), n_epochs),
        arc=np.tile(np.arange(m), n_epochs),
    )


def seconds(rows, n_epochs, n_runs, **options):
    """Median time of an epoch, the fixed cost of a call taken out."""
    short = Rows(**{**vars(rows), "start": rows.start[:2]})
    taken = []
    for _ in range(n_runs):
        start = time.perf_counter()
        run = run_engine(rows, length_m=1.0, length_sd_m=0.003, **options)
        middle = time.perf_counter()
        run_engine(short, length_m=1.0, length_sd_m=0.003, **options)
        taken.append((middle - start - (time.perf_counter() - middle)) / (n_epochs - 1))
    return float(np.median(taken)), run


def main():
    """Print the table."""
    options = machine.parser(__doc__.partition("\n")[0]).parse_args()
    run_engine(simulate(6, 3), length_m=1.0, carry=True, hold=True)
    body = []
    for n_sats in SATELLITES:
        rows = simulate(n_sats, EPOCHS)
        alone, single = seconds(rows, EPOCHS, options.runs)
        carried, _ = seconds(rows, EPOCHS, options.runs, carry=True)
        held, filtered = seconds(rows, EPOCHS, options.runs, carry=True, hold=True)
        accepted = f"{np.mean(single.status >= 2):.0%} / {np.mean(filtered.status >= 2):.0%}"
        cells = [f"{1e6 * x:.0f}" for x in (alone, carried, held)]
        body.append([str(2 * (n_sats - 1)), *cells, accepted, f"{np.median(single.nodes):.0f}"])
    head = [
        "double differences",
        "alone, us",
        "carried, us",
        "held, us",
        "accepted alone / held",
        "nodes alone, median",
    ]
    lines = [*machine.conditions(), "", *machine.table(head, body)]
    machine.report("The engine's cost by number of double differences", lines, write=options.write)


if __name__ == "__main__":
    main()
