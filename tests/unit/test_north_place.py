"""Where a search for north takes its position from, and the files that tell none."""

import numpy as np
import pytest

from simulated_sessions import pair
from truenorth.errors import ConfigError, FormatError, TrueNorthError
from truenorth.frames import ecef_from_geodetic
from truenorth.northfinding.place import position_from_file
from truenorth.simulation import read_scenario, write_simulation

PLACE = (np.radians(40.0), np.radians(32.5), 900.0)


def header(position):
    """A RINEX header with a line of position, or none."""

    def line(text, label):
        return f"{text:<60}{label}\n"

    said = "" if position is None else line("".join(f"{x:14.4f}" for x in position), "APPROX POSITION XYZ")
    return (
        line(f"{3.04:9.2f}{'':11}{'OBSERVATION DATA':<20}M", "RINEX VERSION / TYPE")
        + said
        + line("G    2 C1C L1C", "SYS / # / OBS TYPES")
        + line("", "END OF HEADER")
    )


def rinex(path, position):
    path.write_text(header(position))
    return path


def session(path, *names):
    antennas = "".join(f'[[platform.antennas]]\nname = "{n}"\nobservations = "{n}.obs"\n' for n in names)
    path.write_text(f"[platform]\n{antennas}")
    return path


def same_place(found, place=PLACE, within_m=1e-3):
    # A header has a tenth of a millimetre.
    np.testing.assert_allclose(
        ecef_from_geodetic(*found), ecef_from_geodetic(*place), rtol=0.0, atol=within_m
    )


def test_the_header_of_a_rinex_file(tmp_path):
    same_place(position_from_file(rinex(tmp_path / "a.obs", ecef_from_geodetic(*PLACE))))


def test_a_session_or_its_folder_tells_what_its_first_knowing_receiver_does(tmp_path):
    rinex(tmp_path / "aft.obs", (0.0, 0.0, 0.0))
    rinex(tmp_path / "fore.obs", ecef_from_geodetic(*PLACE))
    file = session(tmp_path / "session.toml", "aft", "fore")
    same_place(position_from_file(file))
    same_place(position_from_file(tmp_path))
    rinex(tmp_path / "fore.obs", None)
    with pytest.raises(ConfigError, match=r"aft.obs is zero, its receiver did not know it; give another"):
        position_from_file(file)


@pytest.mark.parametrize(
    ("position", "said"),
    [
        ((0.0, 0.0, 0.0), "is zero"),
        (None, "tells no position of its receiver"),
        ((4e6, 0.0, 4e5), "lies 4020 km from the centre of the Earth"),
    ],
)
def test_headers_without_a_place_on_the_earth(tmp_path, position, said):
    with pytest.raises(ConfigError, match=said) as caught:
        position_from_file(rinex(tmp_path / "a.obs", position))
    assert "--latitude" in str(caught.value)


@pytest.mark.parametrize("kind", ["x y z", "1.0 2.0", "nan 1.0 2.0"])
def test_a_header_that_cannot_be_read_tells_none(tmp_path, kind):
    path = rinex(tmp_path / "a.obs", (1.0, 2.0, 3.0))
    lines = path.read_text().splitlines()
    lines[1] = f"{kind:<60}APPROX POSITION XYZ"
    path.write_text("\n".join(lines))
    with pytest.raises(ConfigError, match="tells no position"):
        position_from_file(path)


def test_a_simulated_session_and_its_scenario(tmp_path):
    scenario = read_scenario(pair(duration_s=2.0))
    write_simulation(scenario, tmp_path / "run")
    truth = (np.radians(47.0), np.radians(15.4), 400.0)
    # The header has the place of the body; the antenna is metres from it at most.
    same_place(position_from_file(tmp_path / "run" / "session.toml"), truth, 5.0)
    same_place(position_from_file(tmp_path / "run"), truth, 5.0)
    (tmp_path / "run" / "session.toml").unlink()
    assert position_from_file(tmp_path / "run") == pytest.approx(truth)
    np.testing.assert_allclose(position_from_file(tmp_path / "run" / "scenario.toml"), truth)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[place]\nlatitude_deg = 91.0", "`place.latitude_deg` is 91.0; give a number from -90 to 90"),
        ("[place]\nlongitude_deg = 1.0", "`place.latitude_deg` is None"),
        ("[place]\nlatitude_deg = true", "`place.latitude_deg` is True"),
        ("[place]\nlatitude_deg = 1.0\nheight_m = 'high'", "`place.height_m` is 'high'"),
        ("place = 3", "`place.latitude_deg` is None"),
        ("[motion]\nkind = 'static'", "tells no position; give a session"),
        ("extends = 'other'\n[platform]\n", "it extends 'other', which may"),
        ("[place", "not valid TOML"),
    ],
)
def test_tables_that_tell_none(tmp_path, text, said):
    path = tmp_path / "some.toml"
    path.write_text(text)
    with pytest.raises(TrueNorthError, match=said):
        position_from_file(path)


def test_a_place_without_height_is_on_the_ellipsoid(tmp_path):
    path = tmp_path / "some.toml"
    path.write_text("[place]\nlatitude_deg = -33.5")
    assert position_from_file(path) == pytest.approx((np.radians(-33.5), 0.0, 0.0))


def test_files_that_are_none(tmp_path):
    with pytest.raises(FormatError, match="no such file"):
        position_from_file(tmp_path / "none.obs")
    with pytest.raises(FormatError, match="position cannot be read"):
        position_from_file(tmp_path / "none.toml")
    (tmp_path / "words.txt").write_text("words")
    with pytest.raises(FormatError, match="not recognised"):
        position_from_file(tmp_path / "words.txt")


def test_real_headers(data_dir):
    latitude, longitude, height = position_from_file(data_dir / "pair_1m_geodetic" / "base.obs.gz")
    assert np.degrees([latitude, longitude]) == pytest.approx([35.13471, 136.97757], abs=1e-4)
    assert height == pytest.approx(104.7, abs=1.0)
    packed = position_from_file(data_dir / "rinex_samples" / "ACOR00ESP_R_20213550000_01D_30S_MO.crx")
    assert packed == position_from_file(data_dir / "rinex_samples" / "ACOR00ESP_R_20213550000_01D_30S_MO.rnx")
