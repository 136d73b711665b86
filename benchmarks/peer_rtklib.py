"""Whole process against RTKLIB's rnx2rtkp on the same files: python benchmarks/peer_rtklib.py [--write].

Runs alternate (A B A B ...), because a shared machine drifts; medians and their ratio are reported.
Both programs read the same uncompressed files from the same folder and write their result to a file.
Nothing is installed: without rnx2rtkp (Debian's `rtklib`) on the path only our own times are given.
"""

import gzip
import re
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from machine import conditions, parser, report, table

from truenorth import datasets

MASK_DEG = "15"
CASES = (
    # name, what, options of rnx2rtkp, options of truenorth
    (
        "pair_38m_gps",
        "1 h, 1 Hz, GPS, two frequencies",
        ["-f", "2", "-sys", "G"],
        ["--systems", "G", "--bands", "L1,L2"],
    ),
    (
        "pair_1m_geodetic",
        "5 min, 1 Hz, GPS + Galileo + BeiDou, two frequencies",
        ["-f", "2", "-sys", "G,E,C"],
        ["--systems", "GEC", "--bands", "L1,L2"],
    ),
)


def _plain(path, folder):
    """Copy of a file without its compression, so that neither program pays for it."""
    target = folder / path.name.removesuffix(".gz")
    with gzip.open(path) if path.suffix == ".gz" else path.open("rb") as source, target.open("wb") as copy:
        shutil.copyfileobj(source, copy)
    return str(target)


def _seconds(command):
    start = time.perf_counter()
    # rnx2rtkp writes its progress to stderr, epoch by epoch.
    subprocess.run(
        command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, check=True
    )
    return time.perf_counter() - start


def _spread(times):
    return f"{statistics.median(times):.2f} s ({min(times):.2f}-{max(times):.2f})"


def _version_of(peer):
    said = subprocess.run([peer, "-?"], stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False)
    found = re.search(r"\bver\.? *\S+", said.stdout + said.stderr)
    if found:
        return f"rnx2rtkp {found[0]}"
    if query := shutil.which("dpkg-query"):
        command = [query, "--show", "--showformat=${Version}", "rtklib"]
        asked = subprocess.run(command, capture_output=True, text=True, check=False)
        if asked.returncode == 0:
            return f"rnx2rtkp of Debian's rtklib {asked.stdout}"
    return "rnx2rtkp of unknown version"


def main():
    """Run the cases and print the table."""
    arguments = parser(__doc__.splitlines()[0]).parse_args()
    peer = shutil.which("rnx2rtkp")
    ours = Path(sys.executable).with_name("truenorth")
    rows = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for case, what, peer_options, our_options in CASES:
            pair = datasets.fetch(case)
            base, rover = (_plain(pair.files[role], folder) for role in ("base", "rover"))
            navigation = [_plain(path, folder) for path in pair.navigation]
            commands = {
                "truenorth": [
                    str(ours), "solve", base, rover, *navigation, *our_options,
                    "--mask", MASK_DEG, "--length", str(pair.truth["length_m"]),
                    "--length-sd", str(max(pair.truth["accuracy_m"], 0.003)),
                    "--out", str(folder / "ours.csv"), "--json",
                ],
            }  # fmt: skip
            if peer:
                commands["rnx2rtkp"] = [
                    peer, "-p", "4", *peer_options, "-m", MASK_DEG,
                    "-o", str(folder / "peer.pos"), rover, base, *navigation,
                ]  # fmt: skip
            for command in commands.values():
                _seconds(command)  # fills the caches: of files for both, of compiled kernels for ours
            times = {program: [] for program in commands}
            for _ in range(arguments.runs):
                for program, command in commands.items():
                    times[program].append(_seconds(command))
            row = [f"`{case}`: {what}", _spread(times["truenorth"])]
            if peer:
                ratio = statistics.median(times["rnx2rtkp"]) / statistics.median(times["truenorth"])
                row += [_spread(times["rnx2rtkp"]), f"{ratio:.1f}"]
            else:
                row += ["not installed", "-"]
            rows.append(row)
    header = ["data", "truenorth solve", "rnx2rtkp -p 4", "times faster"]
    lines = [
        *conditions(*([_version_of(peer)] if peer else [])),
        f"- whole processes, {arguments.runs} runs each, interleaved; median (least-most)",
        "",
        *table(header, rows),
    ]
    report("Against RTKLIB, whole process", lines, write=arguments.write)


if __name__ == "__main__":
    main()
