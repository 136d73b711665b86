"""Readers of navigation files survive any damage: they read what they can or raise `FormatError`."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rinex_nav_text import glonass_record, header, record, record_2
from truenorth.errors import FormatError
from truenorth.formats.rinex_nav import parse_rinex_nav
from truenorth.formats.sp3 import parse_sp3
from truenorth.navigation import Navigation, PreciseOrbits
from truenorth.orbits import compute_satellite_states

_ION = "> ION G19 LNAV\n    2024 06 24 10 00 00" + f"{1e-8:19.12e}" * 3 + "\n"
_ION += "    " + f"{1e-8:19.12e}" * 4 + "\n    " + f"{1e-8:19.12e}" + "\n"
_SP3 = """#cP2024  6 24  0  0  0.00000000       2 ORBIT ITRF2 BHN MADE
+    2   G01E11  0
++         5  5  0
%c M  cc GPS ccc cccc cccc cccc cccc ccccc ccccc ccccc ccccc
*  2024  6 24  0  0  0.00000000
PG01   2925.049664  14841.662132 -22014.457083    565.049354
PE11 -10522.205346  22813.348769  -8563.961182    133.894350
*  2024  6 24  0 15  0.00000000
PG01   3925.049664  14841.662132 -22014.457083    565.049354
PE11 -11522.205346  22813.348769  -8563.961182 999999.999999
EOF
"""

FILES = {
    "rinex 2": header("2.11", "N: GPS NAV DATA", "") + record_2() + record_2(7),
    "rinex 3": header("3.05") + record() + record("C03") + record("E11") + glonass_record(),
    "rinex 4": header("4.00")
    + "> EPH G05 LNAV\n"
    + record()
    + _ION
    + "> STO G01 LNAV\n    x\n> EPH R03 FDMA\n"
    + glonass_record(),
    "sp3": _SP3,
}


def read(kind, data):
    return parse_sp3(data) if kind == "sp3" else parse_rinex_nav(data)


@pytest.mark.parametrize("kind", FILES)
def test_the_undamaged_file_is_read(kind):
    assert isinstance(read(kind, FILES[kind].encode()), Navigation | PreciseOrbits)


@pytest.mark.parametrize("kind", FILES)
@given(
    changes=st.lists(
        st.tuples(st.floats(0.0, 1.0, exclude_max=True), st.integers(0, 3), st.binary(max_size=30)),
        min_size=1,
        max_size=6,
    )
)
def test_damaged_bytes(kind, changes):
    """Overwritten, inserted, deleted and repeated bytes."""
    data = FILES[kind].encode()
    for place, action, piece in changes:
        at = int(place * len(data))
        if action == 0:
            data = data[:at] + piece + data[at + len(piece) :]
        elif action == 1:
            data = data[:at] + piece + data[at:]
        elif action == 2:
            data = data[:at] + data[at + 4 * len(piece) :]
        else:
            data = data[: at + 200] + data[at:]
    _survive(kind, data)


@pytest.mark.parametrize("kind", FILES)
@given(st.floats(0.0, 1.0), st.text("0123456789.eED+- \n", min_size=1, max_size=19))
def test_damaged_numbers(kind, place, piece):
    """Number-like damage gets further into the reader than random bytes."""
    data = FILES[kind]
    at = int(place * len(data))
    _survive(kind, (data[:at] + piece + data[at + len(piece) :]).encode())


@pytest.mark.parametrize("kind", FILES)
@given(st.floats(0.0, 1.0))
def test_cut_files(kind, share):
    data = FILES[kind].encode()
    _survive(kind, data[: int(share * len(data))])


def _survive(kind, data):
    try:
        result = read(kind, data)
    except FormatError:
        return
    if isinstance(result, Navigation):
        # Whatever was read must also go through the orbit computation.
        sat = [*result.kepler.sat, *result.states.sat]
        index = list(range(len(sat)))
        states = compute_satellite_states(result, sat, 1_403_258_400 * 10**9, ephemeris=index)
        assert len(states) == len(sat)
