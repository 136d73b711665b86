"""Speed of reading RINEX observations: python benchmarks/rinex_read.py [--write].

Plain text in memory to `Observations`, after compilation; unpacking (gzip, Hatanaka) is timed apart.
"""

import statistics
import time

import numpy as np
from machine import conditions, parser, report, table

from truenorth import datasets
from truenorth.formats.compression import read_bytes
from truenorth.formats.rinex_obs import parse_rinex_obs

SETS = ("pair_1m_geodetic", "pair_38m_gps", "moving_simulator_rose")


def _seconds(function, *arguments):
    start = time.perf_counter()
    value = function(*arguments)
    return value, time.perf_counter() - start


def main():
    """Time every set and print the table."""
    arguments = parser(__doc__.splitlines()[0]).parse_args()
    rows = []
    for name in SETS:
        path = datasets.fetch(name).files["rover"]
        data, _ = _seconds(read_bytes, path)
        parse_rinex_obs(data)
        unpack_s, read_s = [], []
        for _ in range(3 * arguments.runs):
            unpack_s.append(_seconds(read_bytes, path)[1])
            observations, seconds = _seconds(parse_rinex_obs, data)
            read_s.append(seconds)
        columns = (
            observations.code_m,
            observations.phase_cyc,
            observations.doppler_hz,
            observations.cn0_dbhz,
        )
        fields = sum(int(np.sum(np.isfinite(column))) for column in columns)
        median_s = statistics.median(read_s)
        rows.append(
            [
                f"{name}, RINEX {observations.meta.version}",
                f"{len(data) / 1e6:.2f} MB",
                f"{statistics.median(unpack_s) * 1e3:.1f} ms",
                f"{median_s * 1e3:.2f} ms",
                f"{min(read_s) * 1e3:.2f} ms",
                f"{len(data) / median_s / 1e6:.0f} MB/s",
                f"{fields / median_s / 1e6:.0f} million/s",
            ]
        )
    lines = [
        *conditions(),
        f"- {3 * arguments.runs} runs of each, medians",
        "",
        *table(["rover file of", "text", "unpack", "read", "best", "text/s", "values/s"], rows),
    ]
    report("RINEX observations", lines, write=arguments.write)


if __name__ == "__main__":
    main()
