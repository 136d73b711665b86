"""Time to load the package and to print its help: python benchmarks/import_time.py [--write]."""

import statistics
import subprocess
import sys
import time
from pathlib import Path

from machine import conditions, parser, report, table


def _seconds(command):
    start = time.perf_counter()
    subprocess.run(command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, check=True)
    return time.perf_counter() - start


def main():
    """Time fresh processes, interleaved, and print the table."""
    arguments = parser(__doc__.splitlines()[0]).parse_args()
    commands = {
        "python -c pass": [sys.executable, "-c", "pass"],
        "import numpy": [sys.executable, "-c", "import numpy"],
        "import truenorth": [sys.executable, "-c", "import truenorth"],
        "its containers and settings": [
            sys.executable,
            "-c",
            "import truenorth as tn; tn.Observations, tn.Navigation, tn.GnssSettings",
        ],
        "truenorth --help": [str(Path(sys.executable).with_name("truenorth")), "--help"],
    }
    times = {name: [] for name in commands}
    for command in commands.values():
        _seconds(command)
    for _ in range(arguments.runs):
        for name, command in commands.items():
            times[name].append(_seconds(command))
    medians = {name: statistics.median(values) for name, values in times.items()}
    rows = [[name, f"{seconds:.3f} s"] for name, seconds in medians.items()]
    rows.append(
        [
            "containers above NumPy",
            f"{medians['its containers and settings'] - medians['import numpy']:.3f} s",
        ]
    )
    lines = [
        *conditions(),
        f"- fresh processes, median of {arguments.runs}",
        "",
        *table(["what", "time"], rows),
    ]
    report("Start-up", lines, write=arguments.write)


if __name__ == "__main__":
    main()
