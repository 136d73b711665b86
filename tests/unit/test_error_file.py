"""The errors of an inertial unit, by grade and from a file."""

import pytest

from truenorth.errors import ConfigError, FormatError
from truenorth.sensors.error_file import errors_toml, read_errors, write_errors
from truenorth.sensors.imu import GRADES, ImuDescription


@pytest.mark.parametrize("grade", GRADES)
def test_a_grade_is_read_by_its_name(grade):
    assert read_errors(grade) == ImuDescription(grade=grade)


def test_what_is_written_is_read_again(tmp_path):
    stated = ImuDescription(grade="navigation", rate_hz=200.0, gyro_bias_sd_dph=0.0123, name="mine")
    path = write_errors(stated, tmp_path / "errors.toml", ["from a data sheet", ""])
    assert path.read_text().startswith("# from a data sheet\n#\n")
    assert read_errors(path) == stated
    # Only what differs from the grade stands in the file.
    assert errors_toml(stated).splitlines() == [
        "[errors]",
        'grade = "navigation"',
        "rate_hz = 200.0",
        'name = "mine"',
        "gyro_bias_sd_dph = 0.0123",
    ]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "holds nothing"),
        ("[imu]\ngrade = 'tactical'", "holds `imu`"),
        ("errors = 3", "one table"),
        ("[errors]\ngyro_bias_sd_dph = 1.0", "`errors.grade` is missing"),
        ("[errors]\ngrade = 'toy'", "`errors.grade` is 'toy'"),
        ("[errors]\ngrade = 'tactical'\ngyro_bias_dph = 1.0", "did you mean `gyro_bias_sd_dph`"),
        ("[errors]\ngrade = 'tactical'\ngyro_bias_sd_dph = -1.0", "`errors.gyro_bias_sd_dph` is -1.0"),
        ("[errors]\ngrade = 'tactical'\ngyro_bias_sd_dph = 'big'", "`errors.gyro_bias_sd_dph` is 'big'"),
    ],
)
def test_a_wrong_file_is_told_in_a_sentence(tmp_path, text, message):
    path = tmp_path / "errors.toml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=message.replace("[", r"\[")):
        read_errors(path)


def test_neither_a_grade_nor_a_file(tmp_path):
    with pytest.raises(ConfigError, match="no grade of sensor is called 'tactica'; give consumer"):
        read_errors("tactica")
    with pytest.raises(ConfigError, match="No such file"):
        read_errors(tmp_path / "missing.toml")
    with pytest.raises(ConfigError, match="Is a directory"):
        read_errors(tmp_path)
    broken = tmp_path / "broken.toml"
    broken.write_text("[errors\n")
    with pytest.raises(FormatError, match=r"broken\.toml: could not read"):
        read_errors(broken)
    broken.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(FormatError, match="not text"):
        read_errors(broken)
    with pytest.raises(ConfigError, match="give another place"):
        write_errors(ImuDescription(), tmp_path)
