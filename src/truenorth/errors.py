"""The exceptions of the package, and the per-epoch status and reason codes with their sentences.

Unusable input raises a `TrueNorthError`: one sentence that says what was being done, what was found
and what to do. What can happen to a single epoch is data: a `Status` and a `Reason`.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from enum import IntEnum

__all__ = [
    "ConfigError",
    "FormatError",
    "ModelError",
    "NoSolutionError",
    "Reason",
    "REASON_SENTENCES",
    "Status",
    "TrueNorthError",
    "TrueNorthWarning",
    "writing",
]


class TrueNorthError(Exception):
    """Root of all exceptions that the package raises on purpose."""


class TrueNorthWarning(UserWarning):
    """Category of all warnings of the package; issued once per run and cause."""


class FormatError(TrueNorthError, ValueError):
    """A file is not what it says, or cannot be read.

    Parameters
    ----------
    message : str
        The sentence, without place.
    path : str, optional
        The file.
    line_number : int, optional
        One-based line, for text formats.
    byte_offset : int, optional
        Zero-based offset, for binary formats.
    """

    def __init__(
        self,
        message: str,
        *,
        path: object = None,
        line_number: int | None = None,
        byte_offset: int | None = None,
    ) -> None:
        self.path = None if path is None else str(path)
        self.line_number = line_number
        self.byte_offset = byte_offset
        place = self.path or ""
        if line_number is not None:
            place += f", line {line_number}"
        elif byte_offset is not None:
            place += f", byte {byte_offset}"
        super().__init__(f"{place}: {message}" if place else message)


class ConfigError(TrueNorthError, ValueError):
    """A setting is unknown, impossible or contradicts another.

    Parameters
    ----------
    message : str
        The sentence.
    key : str, optional
        The setting at fault, in dotted form (``gnss.elevation_mask_deg``).
    value : object, optional
        What was given.
    """

    def __init__(self, message: str, *, key: str | None = None, value: object = None) -> None:
        self.key = key
        self.value = value
        super().__init__(message)


@contextmanager
def writing(path: object, *, key: str = "out") -> Iterator[None]:
    """Let an error of the file system say which file could not be written, and what to do.

    Parameters
    ----------
    path : path-like
        The file.
    key : str
        The setting that named it.

    Raises
    ------
    ConfigError
        In place of an `OSError` of what is done inside.
    """
    try:
        yield
    except OSError as error:
        raise ConfigError(
            f"could not write {path}: {error.strerror or error}; give another place",
            key=key,
            value=str(path),
        ) from error


class ModelError(TrueNorthError, ArithmeticError):
    """A computation cannot be carried out with the arrays given."""


class NoSolutionError(TrueNorthError):
    """The input can be read but holds nothing that could be solved (no common epochs, no signals)."""


class Status(IntEnum):
    """What one epoch's baseline is."""

    NONE = 0
    FLOAT = 1
    HELD = 2
    FIXED = 3

    @property
    def label(self) -> str:
        """str: The word used in files: ``none``, ``float``, ``held`` or ``fixed``."""
        return self.name.lower()


class Reason(IntEnum):
    """Why one epoch has the status that it has. The numbers are stable; new ones are appended."""

    OK = 0
    NO_POSITION = 1
    TOO_FEW_SATELLITES = 2
    SEARCH_VOLUME_TOO_LARGE = 3
    NO_CANDIDATE = 4
    LENGTH_TEST = 5
    RESIDUAL_TEST = 6
    RATIO_TEST = 7
    PROBABILITY_TEST = 8
    SINGLE_CANDIDATE = 9
    NOT_PERSISTENT = 10
    SEARCH_LIMIT = 11
    WEAK_GEOMETRY = 12
    NO_CODE = 13
    HOLD_RELEASED = 14
    NO_NAVIGATION = 15
    DIRECTIONS_DISAGREE = 16
    ROLL_UNOBSERVABLE = 17
    DIRECTION_ONLY = 18
    GEOMETRY_TEST = 19
    NO_VECTORS = 20
    MIRROR_AMBIGUOUS = 21
    PREDICTED = 22


REASON_SENTENCES = {
    Reason.OK: "accepted by all tests",
    Reason.NO_POSITION: "no single-point position of the base antenna",
    Reason.TOO_FEW_SATELLITES: "fewer common satellites than the unknowns need",
    Reason.SEARCH_VOLUME_TOO_LARGE: "too many integer candidates; give the length or more signals",
    Reason.NO_CANDIDATE: "no integer candidate passes the length and residual limits",
    Reason.LENGTH_TEST: "the measured length disagrees with the declared one",
    Reason.RESIDUAL_TEST: "the phase residuals of the best candidate are too large",
    Reason.RATIO_TEST: "the second-best candidate is too close to the best",
    Reason.PROBABILITY_TEST: "the success probability is below the demanded level",
    Reason.SINGLE_CANDIDATE: "a single candidate survived, so the ratio test says nothing",
    Reason.NOT_PERSISTENT: "the candidate has not yet won for the demanded time",
    Reason.SEARCH_LIMIT: "the search reached its limit of nodes before it was complete",
    Reason.WEAK_GEOMETRY: "the satellites do not span the three directions",
    Reason.NO_CODE: "no pseudoranges, and the method needs them",
    Reason.HOLD_RELEASED: "held integers failed their re-validation and were released",
    Reason.DIRECTIONS_DISAGREE: "forward and backward solutions have different integers",
    Reason.NO_NAVIGATION: "no valid broadcast ephemeris for enough satellites",
    Reason.ROLL_UNOBSERVABLE: "the antennas that were fixed stand on one line ahead: no roll",
    Reason.DIRECTION_ONLY: "the antennas that were fixed stand on one line across the body: no angle",
    Reason.GEOMETRY_TEST: "the baselines contradict the body coordinates; which one is wrong is unclear",
    Reason.NO_VECTORS: "no vector between antennas has accepted integers",
    Reason.MIRROR_AMBIGUOUS: "the vectors fit two attitudes, mirror images of each other",
    Reason.PREDICTED: "predicted by the attitude filter from its attitude and rate",
}
"""One sentence for each `Reason`."""
