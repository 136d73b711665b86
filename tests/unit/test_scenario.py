"""Scenario files: strict, layered, and changed from the command line by dotted keys."""

import numpy as np
import pytest

import truenorth as tn
from simulated_sessions import pair
from truenorth.errors import ConfigError, FormatError
from truenorth.simulation import read_scenario, scenario_names, write_simulation

NAMES = scenario_names()


@pytest.mark.parametrize("name", NAMES)
def test_every_scenario_of_the_package_says_what_it_is(name):
    scenario = read_scenario(name)
    assert scenario.name == name
    assert scenario.title
    assert len(scenario.title) <= 90
    assert scenario.source


def test_every_default_is_written_and_read_back(tmp_path):
    scenario = read_scenario(pair())
    file = tmp_path / "scenario.toml"
    file.write_text(scenario.to_toml(), encoding="utf-8")
    again = read_scenario(file)
    assert again.to_toml() == scenario.to_toml()


def test_overrides_take_dotted_keys():
    scenario = read_scenario(
        pair(),
        [
            "duration_s=7",
            "platform.antennas.1.position_body_m=[2.0, 0.0, 0.0]",
            "receiver.clock.oscillator=common",
        ],
    )
    assert scenario.duration_s == 7.0
    assert scenario.platform.antennas[1].position_body_m == (2.0, 0.0, 0.0)
    assert scenario.platform.antennas[0].receiver.clock.oscillator == "common"
    assert read_scenario(scenario, {"seed": 9}).seed == 9


def test_a_platform_without_antennas_has_sensors_or_is_refused(tmp_path):
    table = pair(duration_s=2.0)
    table["platform"] = {"name": "underground"}
    with pytest.raises(ConfigError, match="neither antennas nor sensors"):
        read_scenario(table)
    table["sensors"] = {"imu": [{"grade": "tactical"}]}
    written = write_simulation(table, tmp_path)
    assert (written.session, written.observations, written.navigation) == (None, {}, ())
    assert written.sensors["imu"][0].is_file()


def test_numbers_of_numpy_are_numbers():
    table = pair(duration_s=np.float64(3.0), heading_deg=np.int64(12))
    table["platform"]["antennas"][1]["position_body_m"] = np.array([2.0, 0.0, 0.0])
    scenario = read_scenario(table, {"seed": np.int64(4)})
    assert (scenario.duration_s, scenario.motion.heading_deg, scenario.seed) == (3.0, 12.0, 4)
    assert scenario.platform.antennas[1].position_body_m == (2.0, 0.0, 0.0)


def test_an_antenna_lays_its_receiver_over_the_common_one():
    table = pair(receiver={"zenith_cn0_dbhz": 47.0, "tracking": {"slips_per_hour": 3.0}})
    table["platform"]["antennas"][1]["receiver"] = {"tracking": {"half_cycle_s": 2.0}}
    aft, fore = read_scenario(table).platform.antennas
    assert aft.receiver.tracking.half_cycle_s == 0.0
    assert (fore.receiver.tracking.half_cycle_s, fore.receiver.tracking.slips_per_hour) == (2.0, 3.0)
    assert fore.receiver.zenith_cn0_dbhz == 47.0


def test_another_kind_replaces_a_table():
    table = pair(receiver={"noise": {"kind": "thermal", "pll_bandwidth_hz": 10.0}})
    table["platform"]["antennas"][1]["receiver"] = {"noise": {"kind": "constant", "phase_sd_m": 0.001}}
    assert read_scenario(table).platform.antennas[1].receiver.noise.phase_sd_m == 0.001


def test_a_file_extends_another(tmp_path):
    base = read_scenario(pair())
    (tmp_path / "base.toml").write_text(base.to_toml(), encoding="utf-8")
    (tmp_path / "top.toml").write_text('extends = "base.toml"\nname = "top"\n[motion]\nheading_deg = 77.0\n')
    top = read_scenario(tmp_path / "top.toml")
    assert (top.name, top.motion.heading_deg, top.duration_s) == ("top", 77.0, base.duration_s)
    (tmp_path / "ring.toml").write_text('extends = "ring.toml"\nname = "ring"\n')
    with pytest.raises(ConfigError, match="circle"):
        read_scenario(tmp_path / "ring.toml")


@pytest.mark.parametrize(
    ("overrides", "said"),
    [
        (["duration=7"], "`duration` is not a setting; did you mean `duration_s`?"),
        (["duration_s=-1"], "`duration_s` is -1"),
        (["motion.kind=flying"], "`motion.kind` is 'flying'; give one of"),
        (["motion.heading=3"], "`motion.heading` is not a setting"),
        (["receiver.signals.G=['9Z']"], "RINEX signals"),
        (["receiver.signals.X=['1C']"], "system letters"),
        (["receiver.noise.kind=pink"], "give one of"),
        (["place.latitude_deg=100"], "give -90 to 90"),
        (["start=yesterday"], "give a time"),
        (["platform.antennas.7.name=aft"], "no entry '7'"),
        (["platform.antennas.1.name=aft"], "twice"),
        (["platform.antennas.1.name=a/b"], "letters, digits"),
        (["seed"], "give key=value"),
        (["solve.method=magic"], "give one of"),
        (['faults=[{kind="slip", antenna="top", time_s=1, satellite="G05"}]'], "give one of aft, fore"),
        (['faults=[{kind="slip", antenna="aft", time_s=1, satellite="5"}]'], "a name such as G05"),
        (['faults=[{kind="lost", antenna="aft", start_s=3, end_s=2}]'], "a time after `start_s`"),
    ],
)
def test_what_cannot_be_is_refused_by_name(overrides, said):
    with pytest.raises(ConfigError) as caught:
        read_scenario(pair(), overrides)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_unknown_scenarios_are_named_with_the_nearest():
    with pytest.raises(ConfigError, match="there is no scenario 'nowhere'"):
        read_scenario("nowhere")


def test_unreadable_files_are_refused(tmp_path):
    with pytest.raises(FormatError):
        read_scenario(tmp_path / "missing.toml")
    (tmp_path / "broken.toml").write_text("name = ")
    with pytest.raises(tn.TrueNorthError, match="not valid TOML"):
        read_scenario(tmp_path / "broken.toml")
