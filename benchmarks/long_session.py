"""Long sessions of four antennas, time and memory: python benchmarks/long_session.py [--write].

Simulates the demo's drive with other durations and rates into a temporary folder, solves the session of
four antennas, and for comparison one of its baselines by us and by RTKLIB's rnx2rtkp. Memory is the peak
of the process.
"""

import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from machine import conditions, parser, report, table

CASES = (("10 min, 1 Hz", 600, 1.0), ("1 h, 1 Hz", 3600, 1.0), ("1 h, 10 Hz", 3600, 0.1))


def _run(command):
    """Wall time and peak memory (MB) of a command."""
    measured = (
        "import resource, subprocess, sys; done = subprocess.run(sys.argv[1:], stdin=subprocess.DEVNULL,"
        " stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL);"
        " print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss); sys.exit(done.returncode)"
    )
    start = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-c", measured, *command],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=True,
    )
    return time.perf_counter() - start, int(done.stdout) / 1024


def _cell(measured):
    return f"{measured[0]:.1f} s, {measured[1]:.0f} MB"


def main():
    """Run the cases and print the table."""
    options = parser(__doc__.splitlines()[0])
    options.set_defaults(runs=1)
    arguments = options.parse_args()
    ours, peer = str(Path(sys.executable).with_name("truenorth")), shutil.which("rnx2rtkp")
    rows = []
    with tempfile.TemporaryDirectory() as name:
        warm = Path(name, "warm")
        _run([ours, "simulate", "demo", "--out", str(warm), "--set", "duration_s=20"])
        _run([ours, "solve", str(warm / "session.toml")])
        for what, duration_s, interval_s in CASES:
            folder = Path(name, "session")
            changes = (f"duration_s={duration_s}", f"interval_s={interval_s}", "output.signal_truth=false")
            made = _run(
                [
                    ours,
                    "simulate",
                    "demo",
                    "--out",
                    str(folder),
                    *(part for c in changes for part in ("--set", c)),
                ]
            )
            solved = _run(
                [ours, "solve", str(folder / "session.toml"), "--out", str(folder / "attitude.csv")]
            )
            pair = [str(folder / file) for file in ("rear_left.obs", "front_left.obs", "navigation.rnx")]
            one = _run(
                [ours, "solve", *pair, "--length", "1.6", "--mask", "10", "--out", str(folder / "one.csv")]
            )
            row = [what, _cell(made), _cell(solved), _cell(one)]
            if peer:
                settings = [
                    "-p",
                    "4",
                    "-f",
                    "2",
                    "-sys",
                    "G,R,E,C",
                    "-m",
                    "10",
                    "-o",
                    str(folder / "peer.pos"),
                ]
                theirs = _run([peer, *settings, pair[1], pair[0], pair[2]])
                row += [_cell(theirs), f"{theirs[0] / one[0]:.1f}"]
            else:
                row += ["not installed", "-"]
            rows.append(row)
            shutil.rmtree(folder)
    header = [
        "session",
        "simulate",
        "solve, four antennas",
        "solve, one baseline",
        "rnx2rtkp -p 4",
        "times faster",
    ]
    lines = [
        *conditions(),
        "- whole processes, one run each; four systems, two frequencies",
        "",
        *table(header, rows),
    ]
    report("Long sessions", lines, write=arguments.write)


if __name__ == "__main__":
    main()
