"""What the RINEX writer writes, the reader reads: any observations, in any blocks."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from truenorth.formats.rinex_obs import read_rinex_obs
from truenorth.formats.rinex_obs_writer import RinexObservationWriter, observation_types
from truenorth.observations import NO_CHANNEL, Observations, signal_id

SIGNALS = [signal_id(name) for name in ("1C", "1X", "2I", "2W", "5Q", "7X", "9A")]


@st.composite
def observations(draw):
    """Values on the grid of the format, anywhere in its range but zero, which RINEX does not know."""
    n_epochs = draw(st.integers(1, 6))
    sats = draw(
        st.lists(st.integers(0, 6).flatmap(lambda s: st.integers(100 * s + 1, 100 * s + 99)), max_size=8)
    )
    counts, rows = [], []
    thousandth = st.one_of(
        st.none(),
        st.integers(1, 9_999_999_999_999),
        st.integers(-999_999_999_999, -1),
        st.integers(1, 50_000),
    )
    for _ in range(n_epochs):
        keys = draw(st.sets(st.tuples(st.sampled_from(sats), st.sampled_from(SIGNALS)))) if sats else set()
        counts.append(len(keys))
        for key in sorted(keys):
            values = [draw(thousandth) for _ in range(4)]
            if values == [None] * 4:
                values[0] = 1
            rows.append((*key, *values, draw(st.integers(0, 3))))
    ticks = draw(st.lists(st.integers(1, 10**10), min_size=n_epochs, max_size=n_epochs))
    first_ns = draw(st.integers(0, 4000)) * 604_800 * 10**9
    clock_s = draw(st.lists(st.one_of(st.none(), st.integers(-(10**13) + 1, 10**14 - 1)), min_size=n_epochs,
                            max_size=n_epochs))  # fmt: skip
    values = np.array([[np.nan if v is None else v / 1000.0 for v in row[2:6]] for row in rows]).reshape(
        -1, 4
    )
    return Observations(
        time_ns=first_ns + 100 * np.cumsum(ticks).astype(np.int64),
        epoch_start=np.concatenate(([0], np.cumsum(counts))).astype(np.int64),
        sat=np.array([row[0] for row in rows], dtype=np.int16),
        signal=np.array([row[1] for row in rows], dtype=np.int16),
        code_m=values[:, 0].copy(),
        phase_cyc=values[:, 1].copy(),
        doppler_hz=values[:, 2].copy(),
        cn0_dbhz=values[:, 3].copy(),
        lli=np.array([row[6] for row in rows], dtype=np.uint8),
        clock_offset_s=np.array([np.nan if c is None else c / 1e12 for c in clock_s]),
        glonass_channel=np.full(100, NO_CHANNEL, dtype=np.int8),
    )


@given(observations(), st.integers(1, 6))
def test_round_trip_in_blocks(tmp_path_factory, wanted, size):
    path = tmp_path_factory.mktemp("round") / "a.obs"
    types = observation_types(wanted) or {"G": ("C1C",)}
    with RinexObservationWriter(path, types=types) as writer:
        for first in range(0, wanted.n_epochs, size):
            writer.write_block(wanted.select_epochs(slice(first, first + size)))
    found = read_rinex_obs(path)
    assert found.meta.warnings == ()
    columns = "time_ns epoch_start sat signal code_m phase_cyc doppler_hz cn0_dbhz lli clock_offset_s"
    for name in columns.split():
        np.testing.assert_array_equal(getattr(found, name), getattr(wanted, name), err_msg=name)


@given(st.floats(-9e8, 9e9), st.floats(-9e8, 9e9))
def test_any_value_is_written_to_half_a_unit(tmp_path_factory, code, phase):
    path = tmp_path_factory.mktemp("round") / "a.obs"
    wanted = Observations(
        time_ns=np.zeros(1, np.int64), epoch_start=np.array([0, 1]), sat=np.array([5], np.int16),
        signal=np.array([102], np.int16), code_m=np.array([code]), phase_cyc=np.array([phase]),
        doppler_hz=np.array([1.0]), cn0_dbhz=np.array([np.nan]), lli=np.zeros(1, np.uint8),
        clock_offset_s=np.array([np.nan]), glonass_channel=np.full(100, NO_CHANNEL, np.int8),
    )  # fmt: skip
    with RinexObservationWriter(path) as writer:
        writer.write_block(wanted)
    text = path.read_text().splitlines()[-1]
    # Half a unit, and the rounding of 1e10 in double precision.
    for given_value, written in ((code, text[3:17]), (phase, text[19:33])):
        assert abs(float(written) - given_value) <= 0.0005 + 2e-6
        assert written.strip() != "-0.000"
