"""Lists of numbers in one option."""

from __future__ import annotations

from ..errors import ConfigError

__all__ = ["parse_numbers", "require_positive"]


def parse_numbers(option: str, text: str) -> list[float]:
    """Numbers with commas between.

    Parameters
    ----------
    option : str
        The option as typed, for the message.
    text : str
        What it was given.

    Returns
    -------
    list of float

    Raises
    ------
    ConfigError
        If these are not numbers.
    """
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise ConfigError(
            f"`{option} {text}` are not numbers; give one, or several with commas between, e.g. 1,10,20",
            key=option.lstrip("-"),
            value=text,
        ) from None


def require_positive(option: str, value: float) -> None:
    """Refuse what is not positive.

    Parameters
    ----------
    option : str
        The option as typed, for the message.
    value : float
        What it was given.

    Raises
    ------
    ConfigError
        If it is zero, negative or no number.
    """
    if not value > 0.0:
        raise ConfigError(
            f"`{option} {value:g}` cannot be reached; give a positive number",
            key=option.lstrip("-"),
            value=value,
        )
