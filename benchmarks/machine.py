"""What a benchmark's table must say of the machine and the programs, and how it is kept."""

import argparse
import datetime
import importlib.metadata
import os
import platform
import sys
from pathlib import Path

RESULTS = Path(__file__).with_name("results")


def cpu():
    """Model name of the processor and how many threads of it this process may use."""
    model = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.is_file():
        for line in info.read_text().splitlines():
            if line.startswith("model name"):
                model = line.partition(":")[2].strip()
                break
    usable = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return f"{model}, {usable} threads"


def conditions(*programs):
    """Lines that head a table: command, date, processor, versions."""
    versions = [f"Python {platform.python_version()}"]
    versions += [f"{name} {importlib.metadata.version(name)}" for name in ("truenorth", "numpy", "numba")]
    command = " ".join(["python", f"benchmarks/{Path(sys.argv[0]).name}", *sys.argv[1:]])
    return [
        f"- made by `{command}` on {datetime.datetime.now(datetime.UTC):%Y-%m-%d}",
        f"- {cpu()}",
        f"- {', '.join([*versions, *programs])}",
    ]


def table(header, rows):
    """Rows of text as a markdown table."""
    lines = [" | ".join(header), " | ".join("---" for _ in header), *(" | ".join(row) for row in rows)]
    return [f"| {line} |" for line in lines]


def parser(description):
    """Options that all benchmarks share."""
    options = argparse.ArgumentParser(description=description)
    options.add_argument("--runs", type=int, default=5, help="runs of each program (default 5)")
    options.add_argument("--write", action="store_true", help="keep the table in benchmarks/results/")
    return options


def report(title, lines, *, write):
    """Print a page and, on request, keep it under the name of the benchmark."""
    page = "\n".join([f"# {title}", "", *lines, ""])
    print(page)
    if write:
        RESULTS.mkdir(exist_ok=True)
        (RESULTS / Path(sys.argv[0]).with_suffix(".md").name).write_text(page, encoding="utf-8")
