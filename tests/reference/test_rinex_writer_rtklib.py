"""RTKLIB makes the same of a file that was read and written again as of the original."""

import gzip
import shutil
import subprocess

import pytest

from truenorth.formats import read_observations, write_rinex_observations

RNX2RTKP = shutil.which("rnx2rtkp")


def solve(*arguments):
    done = subprocess.run([RNX2RTKP, *arguments], capture_output=True, text=True, check=True)
    return [line for line in done.stdout.splitlines() if line and line[0] != "%"]


@pytest.mark.skipif(RNX2RTKP is None, reason="RTKLIB's rnx2rtkp is not installed")
def test_rtklib_solves_the_rewritten_files_alike(data_dir, tmp_path):
    folder = data_dir / "pair_1m_geodetic"
    navigation = tmp_path / "base.nav"
    navigation.write_bytes(gzip.decompress((folder / "base.nav.gz").read_bytes()))
    for role in ("base", "rover"):
        (tmp_path / f"{role}.obs").write_bytes(gzip.decompress((folder / f"{role}.obs.gz").read_bytes()))
        observations = read_observations(folder / f"{role}.obs.gz").select_epochs(slice(0, 60))
        write_rinex_observations(tmp_path / f"{role}_again.obs", observations)
    # GPS alone: of the other satellites RTKLIB takes the channel numbers X1 of the original for pseudoranges.
    how = ["-p", "3", "-f", "2", "-sys", "G", "-e", "-r", "-3817680.7270", "3562839.5216", "3650159.2407"]
    paths = {
        again: [str(tmp_path / f"{role}{again}.obs") for role in ("rover", "base")]
        for again in ("", "_again")
    }
    expected = solve(*how, *paths[""], str(navigation))[:60]
    found = solve(*how, *paths["_again"], str(navigation))
    assert len(found) == 60
    assert found == expected
