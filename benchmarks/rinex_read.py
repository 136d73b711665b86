"""How fast RINEX observation text is read: python benchmarks/rinex_read.py FILE... [--runs N]

For every file: unpacking, and reading of the plain text after compilation (best and median of N runs), in
MB/s of plain text and million fields a second. The first read of the process is shown apart: it loads or
compiles the kernel. With --first, an empty cache of compiled code is used, so that the compile time shows.
"""

import argparse
import os
import statistics
import tempfile
import time


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("files", nargs="+", help="RINEX observation files, packed or not")
    parser.add_argument("--runs", type=int, default=15, help="timed runs of every file")
    parser.add_argument("--first", action="store_true", help="compile everything anew")
    options = parser.parse_args()
    if options.first:
        os.environ["NUMBA_CACHE_DIR"] = tempfile.mkdtemp(prefix="truenorth-benchmark-")

    import numpy as np

    from truenorth.formats.compression import read_bytes
    from truenorth.formats.rinex_obs import parse_rinex_obs

    print(
        f"{'file':<44}{'MB':>7}{'unpack ms':>11}{'first ms':>10}{'best ms':>9}{'median':>8}{'MB/s':>7}{'Mfield/s':>10}"
    )
    for path in options.files:
        start = time.perf_counter()
        data = read_bytes(path)
        unpack_s = time.perf_counter() - start
        start = time.perf_counter()
        observations = parse_rinex_obs(data, path=path)
        first_s = time.perf_counter() - start
        times_s = []
        for _ in range(options.runs):
            start = time.perf_counter()
            parse_rinex_obs(data, path=path)
            times_s.append(time.perf_counter() - start)
        best_s = min(times_s)
        fields = sum(
            int(np.sum(np.isfinite(column)))
            for column in (
                observations.code_m,
                observations.phase_cyc,
                observations.doppler_hz,
                observations.cn0_dbhz,
            )
        )
        print(
            f"{os.path.basename(path)[-43:]:<44}{len(data) / 1e6:>7.2f}{unpack_s * 1e3:>11.1f}{first_s * 1e3:>10.1f}"
            f"{best_s * 1e3:>9.2f}{statistics.median(times_s) * 1e3:>8.2f}{len(data) / best_s / 1e6:>7.0f}"
            f"{fields / best_s / 1e6:>10.1f}"
        )


if __name__ == "__main__":
    main()
