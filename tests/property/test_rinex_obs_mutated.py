"""Readers survive damaged bytes: an `Observations` that keeps its promises, or a `FormatError`."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from truenorth.errors import FormatError
from truenorth.formats.blocks import join_observations
from truenorth.formats.compression import unpack
from truenorth.formats.registry import sniff_bytes
from truenorth.formats.rinex_obs import RinexObservationBlocks, parse_rinex_obs

RINEX3 = """\
     3.04           OBSERVATION DATA    M                   RINEX VERSION / TYPE
marker                                                      MARKER NAME
 -3817680.7270  3562839.5216  3650159.2407                  APPROX POSITION XYZ
G    7 X1  C1C L1C D1C S1C C2W L2W                          SYS / # / OBS TYPES
R    3 C1C L1C S1C                                          SYS / # / OBS TYPES
G   10  1 L1C                                               SYS / SCALE FACTOR
G L2W  0.25000                                              SYS / PHASE SHIFT
  2 R01  1 R02 -4                                           GLONASS SLOT / FRQ #
 C1C    0.000 C2C    0.000                                  GLONASS COD/PHS/BIS
  2024     6    24     8    20    0.0000000     GPS         TIME OF FIRST OBS
                                                            END OF HEADER
> 2024 06 24 08 20  0.0000000  0  3      -0.000000123456
G01         9.000    23689218.704 7 124050392.04117       305.142 7        43.469    23689213.246 6
R02  19689218.704 7 104050392.0412         43.469
G07         1.000    21689218.704 7 114050392.04107      -305.142 7        43.469
> 2024 06 24 08 20  1.0000000  0  2
G01         9.000    23689219.704 7 124050393.04107       305.142 7        43.469
R02  19689219.704 7 104050393.0410         43.469
>                              4  2
a comment in the data                                       COMMENT
R    3 L1C C1C S1C                                          SYS / # / OBS TYPES
> 2024 06 24 08 20  2.9910000  1  1
R02 104050394.0412   19689220.704          43.469
> 2024 06 24 08 20  3.0000000  6  1
R02 104050394.0412   19689220.704          43.469
"""

RINEX2 = """\
     2.11           OBSERVATION DATA    M (MIXED)           RINEX VERSION / TYPE
     7    C1    L1    L2    P2    P1    S1    D1            # / TYPES OF OBSERV
     1     2                                                WAVELENGTH FACT L1/2
  2010     3    18     5     0    0.0000000     GPS         TIME OF FIRST OBS
                                                            END OF HEADER
 10  3 18  5  0  0.0000000  0 13G19G07G16G24G21G22G06G18G03G01G02G04 -0.000000001
                                R05
""" + 13 * """\
  22907163.076 8 -16928881.668 8 -13030091.46218  22907160.687 8  22907161.185 8
        43.000        -305.142
""" + """\
 10  3 18  5  0  1.0010000  0  1G19
  22907163.076 8 -16928881.668 8 -13030091.46218  22907160.687 8  22907161.185 8

                            4  1
a comment                                                   COMMENT
 10  3 18  5  0  2.0010000  0  1 19
  22907163.076 8
        43.000
"""  # fmt: skip

HEADER = RINEX3.partition("> ")[0].encode()
SAMPLES = [RINEX3.encode(), RINEX2.encode(), RINEX3.replace("\n", "\r\n").encode()]


def expect_one_sentence(error):
    assert len(str(error)) > 30
    assert "\n" not in str(error)


def check(data):
    """Parse; whatever comes back must be a well-formed container or a single sentence."""
    try:
        obs = parse_rinex_obs(data, path="x")
    except FormatError as error:
        expect_one_sentence(error)
        return None
    return well_formed(obs)


def well_formed(obs):
    """The observations, after a look at all that the container promises."""
    n = obs.n_rows
    assert obs.epoch_start[0] == 0
    assert obs.epoch_start[-1] == n
    assert len(obs.epoch_start) == obs.n_epochs + 1 == len(obs.clock_offset_s) + 1
    assert np.all(np.diff(obs.epoch_start) >= 0)
    assert np.all(np.diff(obs.time_ns) > 0)
    for column in (obs.signal, obs.code_m, obs.phase_cyc, obs.doppler_hz, obs.cn0_dbhz, obs.lli):
        assert len(column) == n
    if n:
        assert obs.sat.min() > 0
        assert obs.sat.max() < 700
        assert obs.lli.max() <= 3
        key = (obs.epoch_of_row * 1000 + obs.sat) * 1000 + obs.signal
        assert np.all(np.diff(key) > 0)
        columns = np.stack((obs.code_m, obs.phase_cyc, obs.doppler_hz, obs.cn0_dbhz))
        assert np.all(np.any(np.isfinite(columns), axis=0))
        assert not np.any(np.isinf(columns))
        assert not np.any(columns == 0.0)
    return obs


def test_the_samples_are_sound():
    for data, n_epochs, n_rows in zip(SAMPLES, (3, 3, 3), (7, 12 * 3 + 3 + 3 + 1, 7), strict=True):
        obs = check(data)
        assert obs.n_epochs == n_epochs
        assert obs.n_rows == n_rows
        assert obs.meta.warnings == ()


@st.composite
def mutated(draw):
    """A sample with some bytes replaced, inserted, removed or repeated, and perhaps cut off."""
    data = bytearray(draw(st.sampled_from(SAMPLES)))
    interesting = st.one_of(
        st.binary(min_size=1, max_size=4),
        st.sampled_from(
            [b"\n", b"\r\n", b" ", b">", b"-", b"9", b"999", b".", b"\x00", b"\xff", b"G", b"COMMENT"]
        ),
    )
    for _ in range(draw(st.integers(1, 6))):
        at = draw(st.integers(0, max(len(data) - 1, 0)))
        kind = draw(st.sampled_from("replace insert remove repeat".split()))
        if kind == "replace":
            piece = draw(interesting)
            data[at : at + len(piece)] = piece
        elif kind == "insert":
            data[at:at] = draw(interesting)
        elif kind == "remove":
            del data[at : at + draw(st.integers(1, 100))]
        else:
            data[at:at] = data[at : at + draw(st.integers(1, 300))]
    if draw(st.booleans()):
        del data[draw(st.integers(0, len(data))) :]
    return bytes(data)


@given(mutated())
@settings(max_examples=600)
@example(b"")
@example(RINEX3.encode()[:80])
@example(RINEX3.encode()[:81])
def test_damaged_text(data):
    check(data)


@given(mutated())
@settings(max_examples=100)
def test_damaged_text_byte_by_byte_is_the_same(data):
    """The slow path, which big-endian machines use, agrees with the fast one on damaged text too."""
    import sys

    fast = check(data)
    order = sys.byteorder
    sys.byteorder = "big"
    try:
        slow = check(data)
    finally:
        sys.byteorder = order
    assert (fast is None) == (slow is None)
    if fast is not None:
        assert fast.meta.warnings == slow.meta.warnings
        for name in ("time_ns", "sat", "signal", "code_m", "phase_cyc", "doppler_hz", "cn0_dbhz", "lli"):
            np.testing.assert_array_equal(getattr(fast, name), getattr(slow, name))


def check_blocks(data, piece_bytes, block_epochs):
    """Blocks read from pieces of the text are well formed, and together the whole where nothing is damaged.

    Where lines are missing, the end of a piece of text may end an epoch that would otherwise have taken the
    lines of the next one.
    """
    try:
        opened = RinexObservationBlocks(
            lambda: (data[k : k + piece_bytes] for k in range(0, len(data), piece_bytes)), path="x"
        )
        first = range(0, opened.n_epochs, block_epochs)
        blocks = list(opened.ranges((k, min(k + block_epochs, opened.n_epochs)) for k in first))
    except FormatError as error:
        expect_one_sentence(error)
        return None
    joined = join_observations([well_formed(block) for block in blocks] or [parse_rinex_obs(HEADER)])
    assert joined.time_ns.tolist() == opened.time_ns.tolist()
    assert set(joined.sat.tolist()) <= set(opened.sat.tolist())
    whole = check(data)
    if whole is not None and not whole.meta.warnings:
        assert opened.meta == whole.meta
        assert joined.epoch_start.tolist() == whole.epoch_start.tolist()
        for name in ("time_ns", "sat", "signal", "code_m", "phase_cyc", "doppler_hz", "cn0_dbhz", "lli"):
            np.testing.assert_array_equal(getattr(joined, name), getattr(whole, name))
        np.testing.assert_array_equal(joined.clock_offset_s, whole.clock_offset_s)
        assert joined.events == whole.events
    return joined


@pytest.mark.parametrize("data", SAMPLES)
@pytest.mark.parametrize("block_epochs", [1, 2, 5])
@pytest.mark.parametrize("piece_bytes", [1, 7, 100, 10_000])
def test_blocks_of_a_sound_text(data, piece_bytes, block_epochs):
    assert check_blocks(data, piece_bytes, block_epochs) is not None


@given(mutated(), st.integers(1, 3000), st.integers(1, 4))
@settings(max_examples=300)
def test_blocks_of_a_damaged_text(data, piece_bytes, block_epochs):
    check_blocks(data, piece_bytes, block_epochs)


@pytest.mark.parametrize("data", SAMPLES)
@settings(max_examples=60)
@given(at=st.floats(0.0, 1.0))
def test_every_prefix_keeps_the_whole_satellites(data, at):
    """Cutting a file off only loses its end: what is kept equals the beginning of the whole."""
    whole = parse_rinex_obs(data)
    head_end = data.index(b"END OF HEADER") + 13
    cut = int(head_end + at * (len(data) - head_end))
    part = check(data[:cut])
    if part is None:  # cut within the lines that begin the first epoch
        assert cut < head_end + 130
        return
    n = part.n_epochs
    assert part.time_ns.tolist() == whole.time_ns[:n].tolist()
    if n > 1:
        same = part.epoch_start[n - 1]
        np.testing.assert_array_equal(part.phase_cyc[:same], whole.phase_cyc[:same])
        np.testing.assert_array_equal(part.code_m[:same], whole.code_m[:same])


@given(st.binary(max_size=400))
@settings(max_examples=200)
def test_any_bytes(data):
    check(data)
    sniff_bytes(data)
    try:
        assert unpack(data)
    except FormatError as error:
        expect_one_sentence(error)


@given(st.sampled_from([b"\x1f\x8b", b"\x1f\x9d", b"BZh91AY&SY", b"PK\x03\x04"]), st.binary(max_size=300))
@settings(max_examples=200)
def test_any_bytes_behind_the_mark_of_an_archive(mark, data):
    try:
        assert unpack(mark + data)
    except FormatError as error:
        expect_one_sentence(error)
