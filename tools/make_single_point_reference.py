"""Generate the table of RTKLIB's single-point positions that the tests compare with.

Runs ``rnx2rtkp -p 0`` (Debian package ``rtklib``) on public data sets and writes every n-th epoch to
``tests/reference/data/single_point_rtklib.csv``, with the program's version and settings in its head.

    python tools/make_single_point_reference.py DATA_FOLDER
"""

import gzip
import subprocess
import sys
import tempfile
from pathlib import Path

SETTINGS = {
    "pos1-posmode": "single",
    "pos1-frequency": "l1",
    "pos1-elmask": "10",
    "pos1-ionoopt": "brdc",
    "pos1-tropopt": "saas",
    "pos1-sateph": "brdc",
    "out-solformat": "xyz",
    "out-timeform": "tow",
    "out-timesys": "gpst",
    "out-outvel": "on",
}
# Name, folder, observations, navigation files, RTKLIB's sum of systems (GPS 1, GLONASS 4, Galileo 8).
RUNS = [
    ("pair_1m_gps", "pair_1m_geodetic", "base.obs.gz", ["base.nav.gz"], 1, 20),
    ("pair_1m_gps_galileo", "pair_1m_geodetic", "rover.obs.gz", ["base.nav.gz"], 9, 20),
    ("pair_38m_upc1", "pair_38m_gps", "UPC10770.11o.gz", ["brdc0770.11n"], 1, 120),
    ("pair_38m_upc2", "pair_38m_gps", "UPC20770.11o.gz", ["brdc0770.11n"], 1, 120),
    ("pair_0.33m_rover", "pair_0.33m_ublox", "rover.obs.gz", ["rover.nav.gz"], 1, 60),
    (
        "rose_base",
        "moving_simulator_rose",
        "Base-static_MO_Spirent.obs.gz",
        ["RINEX_GN_Spirent.23N.gz", "RINEX_EN_Spirent.23L.gz"],
        1,
        60,
    ),
]
OUTPUT = Path(__file__).resolve().parent.parent / "tests" / "reference" / "data" / "single_point_rtklib.csv"


def plain(path, folder):
    """Copy a file to `folder`, uncompressed, under a name that RTKLIB takes."""
    data = path.read_bytes()
    target = folder / path.name.removesuffix(".gz")
    target.write_bytes(gzip.decompress(data) if path.suffix == ".gz" else data)
    return str(target)


def run(data, folder, observations, navigation, systems):
    """Solve one set; returns the program line of the output and its data lines."""
    with tempfile.TemporaryDirectory() as work:
        work = Path(work)
        config = work / "options.conf"
        lines = [f"{key}={value}" for key, value in SETTINGS.items()] + [f"pos1-navsys={systems}"]
        config.write_text("\n".join(lines) + "\n")
        files = [plain(data / folder / name, work) for name in (observations, *navigation)]
        command = ["rnx2rtkp", "-k", str(config), "-o", str(work / "out.pos"), *files]
        subprocess.run(command, check=True, stderr=subprocess.DEVNULL)
        text = (work / "out.pos").read_text().splitlines()
    program = next(line for line in text if "program" in line)
    return program.split(":", 1)[1].strip(), [line.split() for line in text if not line.startswith("%")]


def main(data):
    """Write the table."""
    rows = []
    for name, folder, observations, navigation, systems, step in RUNS:
        program, lines = run(data, folder, observations, navigation, systems)
        for fields in lines[::step]:
            week, tow, x, y, z, _, n_sats = fields[:7]
            rows.append(",".join([name, week, tow, x, y, z, n_sats]))
    head = [
        f"# {program}, by tools/make_single_point_reference.py",
        "# " + ", ".join(f"{key}={value}" for key, value in SETTINGS.items()),
        "set,week,tow_s,x_m,y_m,z_m,n_sats",
    ]
    OUTPUT.write_text("\n".join(head + rows) + "\n")
    print(f"{len(rows)} rows to {OUTPUT.name}")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
