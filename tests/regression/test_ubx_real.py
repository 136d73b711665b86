"""Real u-blox logs against what other decoders made of them."""

import gzip

import numpy as np
import pytest

from truenorth.constants import BEIDOU, GALILEO, GPS, QZSS
from truenorth.errors import FormatError
from truenorth.formats.rinex_nav import read_rinex_nav
from truenorth.formats.rinex_obs import read_rinex_obs
from truenorth.formats.ubx import find_frames, parse_ubx, read_ubx
from truenorth.navigation import KEPLER_COLUMNS, MessageType
from truenorth.observations import LLI_HALF_CYCLE, LLI_SLIP, sat_name
from truenorth.timescales import NS_PER_S

# Half a digit of the RINEX file: three decimals for all quantities.
PRINTED = 0.5001e-3
LOGS = ["pair_0.33m_ublox/base", "pair_0.33m_ublox/rover", "ubx_with_rinex/f9p_spirent_15min"]


def row_keys(observations, *, by_band):
    """(time, satellite, signal or band) of every row as one array of integers."""
    signal = observations.signal // 100 if by_band else observations.signal
    time_ns = observations.time_ns[observations.epoch_of_row]
    return np.rec.fromarrays([time_ns, observations.sat, signal])


@pytest.fixture(scope="module", params=LOGS)
def pair(request, data_dir):
    """Our observations and those of the RINEX file, and the rows that both have."""
    ours, _ = read_ubx(data_dir / f"{request.param}.ubx.gz")
    theirs = read_rinex_obs(data_dir / f"{request.param}.obs.gz")
    # The converter of the F9P log called all L5 signals X; so only the band is compared there.
    by_band = "spirent" in request.param
    key, other = row_keys(ours, by_band=by_band), row_keys(theirs, by_band=by_band)
    _, mine, its = np.intersect1d(key, other, assume_unique=True, return_indices=True)
    return ours, theirs, mine, its


def test_every_row_of_the_other_decoder_is_there(pair):
    ours, theirs, mine, its = pair
    assert len(its) == theirs.n_rows
    assert np.isin(theirs.time_ns, ours.time_ns).all()
    # And within the epochs of the other decoder there is no row more.
    assert np.sum(np.isin(ours.time_ns[ours.epoch_of_row], theirs.time_ns)) == len(mine)


def test_values_agree_to_the_printed_digit(pair):
    ours, theirs, mine, its = pair
    for name in ("code_m", "phase_cyc", "doppler_hz", "cn0_dbhz"):
        a, b = getattr(ours, name)[mine], getattr(theirs, name)[its]
        both = np.isfinite(a) & np.isfinite(b)
        assert np.max(np.abs(a - b)[both]) < PRINTED, name
        # The other decoder blanks phases that the receiver calls valid when their stated deviation is
        # above 0.02 cycles; never the other way round.
        assert not np.any(np.isnan(a) & np.isfinite(b)), name
        n_blanked = int(np.sum(np.isfinite(a) & np.isnan(b)))
        assert n_blanked <= (0.003 * len(a) if name == "phase_cyc" else 0), name


def test_flags(pair):
    """Half-cycle bits are the same; so are the slips, but for three differences that are understood."""
    ours, theirs, mine, its = pair
    both = np.isfinite(ours.phase_cyc[mine]) & np.isfinite(theirs.phase_cyc[its])
    mine, its = mine[both], its[both]
    order = np.argsort(mine)
    mine, its = mine[order], its[order]
    a, b = ours.lli[mine], theirs.lli[its]
    np.testing.assert_array_equal(a & LLI_HALF_CYCLE, b & LLI_HALF_CYCLE)
    only_theirs = set(mine[(b & LLI_SLIP) > (a & LLI_SLIP)].tolist())
    common = set(mine.tolist())
    seen, flagged = set(), set()
    for row in np.flatnonzero(np.isfinite(ours.phase_cyc)).tolist():
        signal = (int(ours.sat[row]), int(ours.signal[row]))
        if row in only_theirs:
            # Either the first phase that it has of the signal, which it always flags, or it has blanked
            # or lost the phases since the last common one, and one of those is the one that we flagged.
            assert signal not in seen or signal in flagged
        if row in common:
            seen.add(signal)
            flagged.discard(signal)
        elif ours.lli[row] & LLI_SLIP:
            flagged.add(signal)
    # Ours has a few more: locks younger than the gap since the last phase, which the counter alone
    # does not show.
    assert np.sum((a & LLI_SLIP) > (b & LLI_SLIP)) == 3
    assert np.sum(a & b & LLI_SLIP) >= 14


def test_the_base_log_holds_more_than_its_rinex_file(data_dir):
    """convbin lost 38 epochs, each behind a cut frame whose length reached over it: we do the same here."""
    buffer = np.frombuffer(
        gzip.decompress((data_dir / "pair_0.33m_ublox/base.ubx.gz").read_bytes()), np.uint8
    )
    offset, _, kind, n_damaged = find_frames(buffer)
    assert int(np.sum(kind == 0x0215)) == 321
    assert n_damaged > 400
    data, at, survivors = buffer.tobytes(), 0, set()
    while (at := data.find(b"\xb5\x62", at)) >= 0:
        size = int.from_bytes(data[at + 4 : at + 6], "little") + 8
        survivors.add(at)
        at += size if size <= 8_200 else 2  # trust the length of whatever looks like a header
    ours, _ = parse_ubx(data)
    theirs = read_rinex_obs(data_dir / "pair_0.33m_ublox/base.obs.gz")
    begin = offset[kind == 0x0215]
    assert ours.n_epochs == len(begin) == 321
    np.testing.assert_array_equal(
        np.isin(ours.time_ns, theirs.time_ns), [b in survivors for b in begin.tolist()]
    )


def test_pyubx2_finds_the_same_frames_in_an_undamaged_log(data_dir):
    from io import BytesIO

    from pyubx2 import UBX_PROTOCOL, UBXReader

    data = gzip.decompress((data_dir / "pair_0.33m_ublox/rover.ubx.gz").read_bytes())
    reader = UBXReader(BytesIO(data), protfilter=UBX_PROTOCOL, quitonerror=0, parsing=0)
    theirs = [(len(raw) - 8, 256 * raw[2] + raw[3]) for raw, _ in reader]
    _, length, kind, n_damaged = find_frames(np.frombuffer(data, np.uint8))
    assert n_damaged == 1  # the log ends in the middle of a frame
    assert list(zip(length.tolist(), kind.tolist(), strict=True)) == theirs


def test_time_tags_and_extent_of_the_pair(data_dir):
    rover, navigation = read_ubx(data_dir / "pair_0.33m_ublox/rover.ubx.gz")
    assert rover.n_epochs == 1205
    # Tags are .991 s, from the clock's one jump on .992 s, exactly.
    assert sorted(set((rover.time_ns % NS_PER_S).tolist())) == [991_000_000, 992_000_000]
    assert rover.meta.interval_s == 1.0
    assert rover.meta.leap_seconds == navigation.leap_seconds == 18
    # The static antenna's own fixes: within metres of the known place.
    np.testing.assert_allclose(
        rover.meta.approx_position_ecef_m, (3774094.03, -601663.85, 5089327.69), rtol=0, atol=10.0
    )
    # Both logs hold what the pair needs to be solved alone.
    _, of_base = read_ubx(data_dir / "pair_0.33m_ublox/base.ubx.gz")
    assert len(of_base.kepler) == 13
    assert len(of_base.states) == 8


@pytest.mark.parametrize(
    ("name", "n_kepler", "n_states"),
    [("pair_0.33m_ublox/rover", 14, 8), ("ubx_with_rinex/f9p_spirent_15min", 47, 0)],
)
def test_ephemerides_against_the_rinex_file(data_dir, name, n_kepler, n_states):
    _, ours = read_ubx(data_dir / f"{name}.ubx.gz")
    theirs = read_rinex_nav(data_dir / f"{name}.nav.gz")

    def keys(eph):
        return list(
            zip(eph.sat.tolist(), eph.message.tolist(), eph.toe_ns.tolist(), eph.iode.tolist(), strict=True)
        )

    place = {key: k for k, key in enumerate(keys(ours.kepler))}
    assert len(theirs.kepler) == n_kepler
    mine = [place[key] for key in keys(theirs.kepler)]
    for name in ("toc_ns", "iodc", "health"):
        np.testing.assert_array_equal(getattr(ours.kepler, name)[mine], getattr(theirs.kepler, name))
    for column in KEPLER_COLUMNS:
        if column == "fit_interval_s":
            continue
        # Twelve digits are printed.
        np.testing.assert_allclose(
            ours.kepler.column(column)[mine], theirs.kepler.column(column), rtol=1e-11, atol=0, err_msg=column
        )
    # The same data is sent every 30 s; we keep the first transmission that was complete, it keeps another.
    later_ns = theirs.kepler.transmission_ns - ours.kepler.transmission_ns[mine]
    assert np.all(later_ns % (30 * NS_PER_S) == 0)
    # What we have more is the same orbits from the other Galileo message, F/NAV.
    extra = np.setdiff1d(np.arange(len(ours.kepler)), mine)
    assert set(ours.kepler.message[extra].tolist()) <= {MessageType.FNAV}

    assert len(ours.states) == len(theirs.states) == n_states
    for column in ("sat", "toe_ns", "transmission_ns", "channel", "health"):
        np.testing.assert_array_equal(getattr(ours.states, column), getattr(theirs.states, column))
    if n_states:
        difference = np.abs(ours.states.states - theirs.states.states)
        # Kilometres with twelve digits: 0.05 mm; the group delay has no place in RINEX 3.04.
        assert np.max(difference[:, :3]) < 1e-4
        assert np.max(difference[:, 3:6]) < 1e-8
        assert np.max(difference[:, 6:9]) < 1e-16
        assert np.max(difference[:, 9]) < 1e-15
        assert np.max(difference[:, 10]) < 1e-22


def test_five_systems_in_a_short_log(data_dir):
    """40 s of an F9P: too short for the ionosphere page of GPS, long enough for one ephemeris of each."""
    observations, navigation = read_ubx(data_dir / "receiver_logs/20230919-114418.ubx")
    assert observations.n_epochs == 36
    assert set("GRECJS") == {sat_name(s)[0] for s in np.unique(observations.sat).tolist()}
    eph = navigation.kepler
    found = {(s // 100, m) for s, m in zip(eph.sat.tolist(), eph.message.tolist(), strict=True)}
    assert found == {
        (GPS, MessageType.LNAV),
        (QZSS, MessageType.LNAV),
        (GALILEO, MessageType.INAV),
        (BEIDOU, MessageType.D1),
    }
    assert len(navigation.states) == 9
    assert set(navigation.klobuchar) == {"C", "J"}
    assert navigation.nequick is not None
    # Every ephemeris is fresh: within its half fit interval of the log.
    age_s = np.abs(eph.toe_ns - observations.time_ns[0]) / NS_PER_S
    assert np.all(age_s <= eph.column("fit_interval_s") / 2)
    np.testing.assert_array_equal(
        navigation.glonass_channels()[navigation.states.sat % 100],
        observations.glonass_channel[navigation.states.sat % 100],
    )


def test_a_log_of_solutions_only_is_refused_with_advice(data_dir):
    with pytest.raises(FormatError, match=r"NAV-PVT.*NAV-RELPOSNED.*enable UBX-RXM-RAWX and UBX-RXM-SFRBX"):
        read_ubx(data_dir / "receiver_logs/ublox-neo-m8p.log")
