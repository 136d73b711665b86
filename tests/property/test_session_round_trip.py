"""Whatever a session holds, its TOML reads back to the same session."""

from hypothesis import given
from hypothesis import strategies as st

from truenorth.config import METHODS, GnssSettings, Session, StochasticSettings

names = st.text(st.characters(exclude_categories=("Cs",), exclude_characters="\x00"), min_size=1, max_size=20)
settings = st.builds(
    GnssSettings,
    method=st.sampled_from(METHODS),
    single_epoch=st.booleans(),
    systems=st.sampled_from(["G", "GEC", "GREC"]),
    bands=st.lists(st.sampled_from(["L1", "L2", "L5"]), min_size=1, max_size=3).map(tuple),
    elevation_mask_deg=st.floats(0.0, 60.0),
    length_m=st.none() | st.floats(0.01, 10_000.0),
    length_sd_m=st.floats(0.0, 100.0),
    stochastic=st.builds(StochasticSettings, phase_sd_m=st.floats(1e-9, 1.0)),
)


@given(base=names, rover=names, navigation=st.lists(names, max_size=2), settings=settings)
def test_toml_round_trip(base, rover, navigation, settings):
    session = Session.for_pair(base, rover, tuple(navigation), settings)
    assert Session.from_toml(session.to_toml()) == session
    assert Session.from_toml(session.to_toml()).settings == settings
