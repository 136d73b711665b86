"""The session file: read strictly, refused with the key in dotted form, printed back in full."""

import pytest

from truenorth.config import GnssSettings, Session, convert_settings
from truenorth.errors import ConfigError, FormatError

SESSION = """
[platform]
name = "survey launch"
[[platform.antennas]]
name = "aft"
position_body_m = [0.0, 0.0, 0.0]
observations = "aft.obs.gz"
[[platform.antennas]]
name = "fore"
position_body_m = [2.669, 0.0, 0.0]
observations = "fore.obs.gz"
[gnss]
navigation = ["brdc.nav"]
elevation_mask_deg = 10
method = "filter"
[gnss.stochastic]
phase_sd_m = 0.002
"""


@pytest.fixture
def folder(tmp_path):
    for name in ("aft.obs.gz", "fore.obs.gz", "brdc.nav"):
        (tmp_path / name).write_text("")
    (tmp_path / "session.toml").write_text(SESSION)
    return tmp_path


def test_reads_the_session_of_the_design(folder):
    session = Session.read(folder / "session.toml")
    assert session.observation_paths == (str(folder / "aft.obs.gz"), str(folder / "fore.obs.gz"))
    assert session.gnss.navigation == (str(folder / "brdc.nav"),)
    assert session.settings.method == "filter"
    assert session.settings.elevation_mask_deg == 10.0
    assert session.settings.stochastic.phase_sd_m == 0.002


def test_the_length_follows_from_body_coordinates_unless_it_is_given():
    assert Session.from_toml(SESSION).settings.length_m == pytest.approx(2.669)
    given = Session.from_toml(SESSION.replace("[gnss]", "[gnss]\nlength_m = 2.67"))
    assert given.settings.length_m == 2.67


def test_one_known_length_replaces_body_coordinates():
    text = SESSION.replace("position_body_m", "# ").replace("[platform]", "[platform]\nlength_m = 2.5")
    assert Session.from_toml(text).settings.length_m == 2.5
    without = Session.from_toml(SESSION.replace("position_body_m", "# "))
    assert without.settings.length_m is None


def test_prints_every_default_back():
    text = Session.from_toml(SESSION).to_toml()
    assert Session.from_toml(text) == Session.from_toml(SESSION)
    for name in GnssSettings.__struct_fields__:
        assert name in text


def test_settings_are_plain_solver_settings():
    settings = Session.from_toml(SESSION).settings
    assert type(settings) is GnssSettings


@pytest.mark.parametrize(
    ("old", "new", "key", "words"),
    [
        (
            "elevation_mask_deg",
            "elevation_maks_deg",
            "gnss.elevation_maks_deg",
            "did you mean `elevation_mask_deg`",
        ),
        ("phase_sd_m", "phase_sd", "gnss.stochastic.phase_sd", "did you mean `phase_sd_m`"),
        ('name = "fore"', 'nam = "fore"', "platform.antennas[1].nam", "did you mean `name`"),
        ("[platform]", "[output]\n[platform]", "output", "known are platform, gnss"),
        ('"filter"', '"filtre"', "gnss.method", "give one of constrained, lambda"),
        ("= 10", "= 95", "gnss.elevation_mask_deg", "95"),
        ("= 10", '= "ten"', "gnss.elevation_mask_deg", "expected `float`"),
        ("[gnss]", "[gnss]\nlength_m = -3.0", "gnss.length_m", "-3.0"),
        ("[gnss]", "[gnss]\nlength_m = nan", "gnss.length_m", "nan"),
        ("[gnss]", '[gnss]\nsystems = "GX"', "gnss.systems", "GX"),
        ("[gnss]", '[gnss]\nbands = ["L9"]', "gnss.bands", "L9"),
        ("[gnss]", "[gnss]\nbands = []", "gnss.bands", "at least one"),
        ('name = "fore"\n', "", "platform.antennas[1].name", "is missing"),
        ('name = "fore"', 'name = "aft"', "platform.antennas[1].name", "twice"),
        ("[0.0, 0.0, 0.0]", "[0.0, 0.0]", "platform.antennas[0].position_body_m", "length 3"),
        ("[2.669, 0.0, 0.0]", "[0.0, 0.0, 0.0]", "platform.antennas", "length of 0 m"),
        ("[gnss]", "[gnss]\nlength_m = 3.0", "platform.antennas", "give one of them"),
    ],
)
def test_refuses_and_names_the_key(old, new, key, words):
    assert old in SESSION
    with pytest.raises(ConfigError) as caught:
        Session.from_toml(SESSION.replace(old, new, 1))
    assert caught.value.key == key
    assert f"`{key}`" in str(caught.value)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


MAST = """[[platform.antennas]]
name = "mast"
observations = "mast.obs"
position_body_m = [1.0, 1.5, -0.5]
[gnss]"""


def test_an_array_has_no_single_length():
    session = Session.from_toml(SESSION.replace("[gnss]", MAST))
    assert session.is_array
    assert session.observation_paths == ("aft.obs.gz", "fore.obs.gz", "mast.obs")
    assert session.settings.length_m is None
    assert Session.from_toml(session.to_toml()) == session


@pytest.mark.parametrize(
    ("old", "new", "key", "words"),
    [
        (
            "position_body_m = [1.0, 1.5, -0.5]\n",
            "",
            "platform.antennas[2].position_body_m",
            "3 antennas need",
        ),
        ("[1.0, 1.5, -0.5]", "[2.669, 0.0, 0.0]", "platform.antennas[2].position_body_m", "length of 0 m"),
        ('"mast"', '"aft"', "platform.antennas[2].name", "twice"),
        ("[gnss]", "[gnss]\nlength_m = 2.669", "gnss.length_m", "is for two antennas"),
    ],
)
def test_refuses_an_array_and_names_the_key(old, new, key, words):
    text = SESSION.replace("[gnss]", MAST)
    assert old in text
    with pytest.raises(ConfigError) as caught:
        Session.from_toml(text.replace(old, new))
    assert caught.value.key == key
    assert words in str(caught.value)


def test_one_antenna_is_refused():
    fore = SESSION.index('[[platform.antennas]]\nname = "fore"')
    with pytest.raises(ConfigError, match="holds 1 antennas; give two or more"):
        Session.from_toml(SESSION[:fore])


def test_names_the_file_and_what_is_wrong_with_it(folder):
    path = folder / "session.toml"
    path.write_text(SESSION.replace("brdc.nav", "absent.nav"))
    with pytest.raises(ConfigError, match=r"gnss\.navigation\[0\].*absent\.nav"):
        Session.read(path)
    path.write_text("[platform\n")
    with pytest.raises(ConfigError, match=r"session\.toml.*not valid TOML"):
        Session.read(path)
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(FormatError, match="not UTF-8"):
        Session.read(path)
    with pytest.raises(FormatError, match=r"absent\.toml"):
        Session.read(folder / "absent.toml")


def test_a_session_of_two_files_is_written_relative_to_its_folder(folder):
    session = Session.for_pair(
        str(folder / "aft.obs.gz"), str(folder / "fore.obs.gz"), (str(folder / "brdc.nav"),)
    )
    text = session.to_toml(folder=folder)
    assert 'observations = "aft.obs.gz"' in text
    assert Session.from_toml(text, folder=folder) == session
    elsewhere = session.to_toml(folder=folder / "results")
    assert f'observations = "{folder / "aft.obs.gz"}"' in elsewhere


def test_convert_settings_of_plain_keys():
    settings = convert_settings({"length_m": 1, "bands": ["L1"]}, GnssSettings)
    assert settings.length_m == 1.0
    assert settings.bands == ("L1",)
    with pytest.raises(
        ConfigError, match=r"`gnss\.lenght_m` is not a setting; did you mean `length_m`"
    ) as caught:
        convert_settings({"lenght_m": 1}, GnssSettings, prefix="gnss.")
    assert caught.value.key == "gnss.lenght_m"
