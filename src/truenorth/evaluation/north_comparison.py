"""Ways to find north, side by side under one common truth: table 9 of Oguz (2006), made from runs.

A level platform at rest, one place, one heading. The thesis compares four techniques by one number each, of a
single draw or of a bound; here each of them, and the modern methods beside them, gets the same truth many
times with errors drawn anew, and is judged by the distribution of its answers: root mean square, 95 %, worst,
the sigma that it states itself, how often it is wrong or silent, how much data and processor time it takes,
and what becomes of it at other latitudes.

References
----------
P. Oguz, Implementation of Northfinding Techniques, M.Sc. thesis, Middle East Technical University (2006),
ch. 7, table 9.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..errors import ConfigError
from .north_answers import Answers, Scene
from .north_gnss import SkyOfADay
from .north_inertial import UnitAtRest

__all__ = ["LATITUDES_DEG", "TECHNIQUES", "NorthComparison", "Technique", "TechniqueResult", "compare_north"]

LATITUDES_DEG = (0.0, 20.0, 40.0, 60.0, 75.0, 85.0)
"""Where every technique is tried again."""

FEW = 6
"""Techniques that take long get this part of the runs there."""

FEWEST = 4


class Place:
    """All that is simulated at a place; techniques share it.

    Parameters
    ----------
    scene : Scene
        Place, heading, seed and number of runs.
    """

    def __init__(self, scene: Scene) -> None:
        self.sky = SkyOfADay(scene)
        self.unit = UnitAtRest(scene)


@dataclass(frozen=True, slots=True)
class Technique:
    """A way to find north.

    Parameters
    ----------
    title : str
        For tables and figures.
    answer : callable
        Takes a `Place` and returns its `Answers`.
    is_external : bool
        Whether it depends on satellites.
    limit : str
        What limits its accuracy here.
    needs : str
        Hardware.
    published_deg : float
        Accuracy in table 9 of the thesis; NaN for what is not in it.
    published_draw : str
        What that number comes from.
    published_cost, published_usage, published_complexity : str
        The thesis's own words for hardware, practical usage and computation; empty for what is not in it.
    is_slow : bool
        Whether it gets fewer runs at other latitudes.
    """

    title: str
    answer: Callable[[Place], Answers]
    is_external: bool
    limit: str
    needs: str
    published_deg: float = np.nan
    published_draw: str = ""
    published_cost: str = ""
    published_usage: str = ""
    published_complexity: str = ""
    is_slow: bool = False

    @property
    def is_published(self) -> bool:
        """bool: Whether it is one of the thesis's four."""
        return bool(np.isfinite(self.published_deg))

    @property
    def dependence(self) -> str:
        """str: The thesis's words for what it depends on."""
        return "external" if self.is_external else "internal"

    @property
    def coverage(self) -> str:
        """str: The thesis's words for where it works."""
        return "signal reception" if self.is_external else "degraded at high latitude"


TECHNIQUES: dict[str, Technique] = {
    "search-20": Technique(
        "GPS search, 0.20 m",
        lambda place: place.sky.search(0.20),
        True,
        "several integer sets fit three satellites, and no test tells; then multipath over the length",
        "2 antennas",
        published_deg=0.5,
        published_draw="0.4285 deg, single draw",
        published_cost="inexpensive",
        published_usage="yes",
        published_complexity="high",
    ),
    "search-76": Technique(
        "GPS search, 0.76 m",
        lambda place: place.sky.search(0.76),
        True,
        "ever more integer sets fit the longer the baseline, and no test tells",
        "2 antennas",
        published_deg=0.5,
        published_draw="0.1149 deg, single draw",
        published_cost="inexpensive",
        published_usage="yes",
        published_complexity="high",
    ),
    "kalman": Technique(
        "GPS Kalman, 1 m, 1000 s",
        lambda place: place.sky.kalman(),
        True,
        "satellites must move before their integers are known; rounded untested",
        "2 antennas",
        published_deg=0.08,
        published_draw="0.0369 to 0.0832 deg, three single draws",
        published_cost="inexpensive",
        published_usage="yes",
        published_complexity="low",
        is_slow=True,
    ),
    "accelerometer": Technique(
        "rotating accelerometer, square wave",
        lambda place: place.unit.square_wave(),
        False,
        "noise of the accelerometer; a tilt of 0.2 deg, absent here, would add up to 0.17 deg",
        "1 accelerometer, platform",
        published_deg=0.2,
        published_draw="scatter within single runs, 0.08 to 0.16 deg",
        published_cost="expensive",
        published_usage="not yet",
        published_complexity="low",
    ),
    "imu": Technique(
        "IMU 1 deg/h, averaged",
        lambda place: place.unit.align("published"),
        False,
        "gyro bias over the horizontal part of the Earth rate",
        "3 gyros, 3 accelerometers",
        published_deg=5.0,
        published_draw="bound 4.96 deg; eight real attitudes, rms 2.72, worst 4.92",
        published_cost="expensive",
        published_usage="yes",
        published_complexity="low",
    ),
    "constrained-20": Technique(
        "all satellites, 0.20 m",
        lambda place: place.sky.constrained(0.20),
        True,
        "multipath over the length",
        "2 antennas, several systems",
    ),
    "constrained-76": Technique(
        "all satellites, 0.76 m",
        lambda place: place.sky.constrained(0.76),
        True,
        "multipath over the length",
        "2 antennas, several systems",
    ),
    "array": Technique(
        "four antennas, 0.76 m square",
        lambda place: place.sky.array(),
        True,
        "multipath over the size of the square",
        "4 antennas, several systems",
    ),
    "accelerometer-ml": Technique(
        "rotating accelerometer, likelihood",
        lambda place: place.unit.turntable(),
        False,
        "noise of the accelerometer, at its bound; tilt as before",
        "1 accelerometer, platform",
    ),
    "inertial": Technique(
        "IMU 1 deg/h, inertial frame",
        lambda place: place.unit.align("velocity-fit"),
        False,
        "gyro bias as before; survives sway, which is absent here",
        "3 gyros, 3 accelerometers",
    ),
    "fine": Technique(
        "IMU 1 deg/h, filter with biases",
        lambda place: place.unit.align("fine"),
        False,
        "the east gyro's bias cannot be told from north at rest",
        "3 gyros, 3 accelerometers",
        is_slow=True,
    ),
    "two-position": Technique(
        "IMU 1 deg/h, two positions",
        lambda place: place.unit.align("positions", motion="half turn"),
        False,
        "angle random walk of the gyros; the bias cancels",
        "the same, turntable",
        is_slow=True,
    ),
    "carousel": Technique(
        "IMU 1 deg/h, carousel",
        lambda place: place.unit.align("carousel", motion="carousel"),
        False,
        "angle random walk of the gyros; the bias cancels",
        "the same, turntable",
        is_slow=True,
    ),
    "navigation": Technique(
        "IMU 0.0035 deg/h, inertial frame",
        lambda place: place.unit.align("velocity-fit", unit="navigation"),
        False,
        "angle random walk; drift of the accelerometers, which is like gravity turning",
        "navigation-grade IMU",
    ),
}
"""Techniques by name: the thesis's four (its search at two lengths), then the modern ones."""


@dataclass(frozen=True, slots=True, eq=False)
class TechniqueResult:
    """A technique at the place, and at other latitudes.

    Parameters
    ----------
    name : str
        In `TECHNIQUES`.
    answers : Answers
        At the place.
    elsewhere : tuple of Answers
        At `LATITUDES_DEG`.
    """

    name: str
    answers: Answers
    elsewhere: tuple[Answers, ...]

    @property
    def technique(self) -> Technique:
        """Technique: What was tried."""
        return TECHNIQUES[self.name]

    def numbers(self) -> dict[str, float]:
        """The result in numbers, by name with unit; NaN for what is not known."""
        own = self.answers
        size = np.abs(own.error_deg[own.is_given])
        found = {
            "published_deg": self.technique.published_deg,
            "rms_deg": own.rms_deg(),
            "right_rms_deg": own.rms_deg(right_only=True),
            "p95_deg": float(np.quantile(size, 0.95)) if len(size) else np.nan,
            "worst_deg": float(size.max()) if len(size) else np.nan,
            "stated_sd_deg": _mean(own.sd_deg),
            "nees": own.nees(right_only=self.technique.is_external),
            "wrong_share": own.wrong,
            "available_share": own.available,
            "data_s": own.data_s,
            "cpu_ms": own.cpu_ms,
        }
        for latitude, there in zip(LATITUDES_DEG, self.elsewhere, strict=True):
            found[f"rms_deg_at_{latitude:.0f}"] = there.rms_deg(right_only=self.technique.is_external)
            found[f"stated_sd_deg_at_{latitude:.0f}"] = _mean(there.sd_deg)
            found[f"usable_share_at_{latitude:.0f}"] = float(np.mean(there.is_given & ~there.is_wrong))
        return found


@dataclass(frozen=True, slots=True, eq=False)
class NorthComparison:
    """Techniques side by side.

    Parameters
    ----------
    scene : Scene
        The common truth.
    runs_elsewhere : int
        Runs at each of `LATITUDES_DEG` of techniques that take long; the others have all.
    results : tuple of TechniqueResult
        In the order of `TECHNIQUES`.
    """

    scene: Scene
    runs_elsewhere: int
    results: tuple[TechniqueResult, ...]

    def columns(self) -> dict[str, np.ndarray]:
        """One row a technique: name of the column and its values."""
        numbers = [result.numbers() for result in self.results]
        cpu_ms = np.array([entry["cpu_ms"] for entry in numbers])
        techniques = [result.technique for result in self.results]
        columns = {
            "technique": np.array([result.name for result in self.results]),
            "title": np.array([one.title for one in techniques]),
            **{name: np.array([entry[name] for entry in numbers]) for name in numbers[0]},
            "cpu_of_fastest": cpu_ms / cpu_ms.min(),
            "cpu_of_slowest": cpu_ms / cpu_ms.max(),
        }
        for name in _WORDS:
            columns[name] = np.array([getattr(one, name) for one in techniques])
        return columns

    def to_dict(self) -> dict[str, Any]:
        """Compute all numbers in values that JSON can hold."""
        columns = self.columns()
        scene = self.scene
        return {
            "latitude_deg": scene.latitude_deg,
            "longitude_deg": scene.longitude_deg,
            "height_m": scene.height_m,
            "heading_deg": scene.heading_deg,
            "runs": scene.runs,
            "seed": scene.seed,
            "runs_elsewhere": self.runs_elsewhere,
            "latitudes_deg": list(LATITUDES_DEG),
            "techniques": [
                {name: _plain(values[k]) for name, values in columns.items()}
                for k in range(len(self.results))
            ],
        }

    def __str__(self) -> str:
        """One table, the thesis's techniques first; what limits each; what the columns mean."""
        scene, columns = self.scene, self.columns()
        head = [
            "", "his", "rms", "right", "95 %", "worst", "sigma", "nees", "wrong", "given", "data",
            "cpu ms", "times", *(f"{latitude:.0f}" for latitude in LATITUDES_DEG),
        ]  # fmt: skip
        wide = max(len(title) for title in columns["title"])
        lines = [
            f"truth       level at {scene.latitude_deg:.4f}, {scene.longitude_deg:.4f}, heading "
            f"{scene.heading_deg:g} deg; {scene.runs} runs, seed {scene.seed}",
            f"{'':<{wide}}" + f"{'error of the answers, deg':^49}" + f"{'share, %':^14}"
            f"{'cost of an answer':^21}" + f"{'rms at latitude, deg':^42}",
            f"{head[0]:<{wide}}" + "".join(f"{word:>7}" for word in head[1:]),
        ]
        for k, title in enumerate(columns["title"]):
            if k and self.results[k - 1].technique.is_published != self.results[k].technique.is_published:
                lines.append("-" * len(lines[-1]))
            words = [short(columns[name][k]) for name in _ERRORS]
            words += [f"{100.0 * columns[name][k]:.0f}" for name in ("wrong_share", "available_share")]
            words += [data_word(columns["data_s"][k])]
            words += [short(columns[name][k]) for name in ("cpu_ms", "cpu_of_fastest")]
            words += [short(columns[f"rms_deg_at_{latitude:.0f}"][k]) for latitude in LATITUDES_DEG]
            lines.append(f"{title:<{wide}}" + "".join(f"{word:>7}" for word in words))
        lines.append("limited by")
        lines += [
            f"  {result.technique.title:<{wide + 2}}{result.technique.limit}" for result in self.results
        ]
        lines += [f"  {sentence}" for sentence in self.notes()]
        return "\n".join(lines)

    def notes(self) -> list[str]:
        """Whole sentences that say what the columns mean."""
        return [
            "his: table 9 of Oguz (2006), single draws or bounds; all else: distributions of our runs.",
            "right: rms of the answers that are not wrong. wrong: false integers, or an error beyond five "
            "sigma; share of the answers. sigma: the mean of what is stated with the answers; nees: the mean "
            "square of errors over it, 1 where it is honest (of satellites, of the right answers).",
            f"at latitude: from as many runs, {self.runs_elsewhere} where an answer takes long (Kalman, "
            "filter, two positions, carousel); of satellites the answers that are right.",
            "cpu ms, times: processor time of an answer on this machine, and in units of the fastest.",
        ]


_ERRORS = ("published_deg", "rms_deg", "right_rms_deg", "p95_deg", "worst_deg", "stated_sd_deg", "nees")
_WORDS = (
    "dependence",
    "coverage",
    "needs",
    "limit",
    "published_draw",
    "published_cost",
    "published_usage",
    "published_complexity",
)


def compare_north(
    *,
    runs: int = 40,
    seed: int = 2006,
    latitude_deg: float = 39.0 + 55.0 / 60.0,
    heading_deg: float = 11.0,
    methods: Sequence[str] | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> NorthComparison:
    """Let every technique find north many times under one common truth.

    Parameters
    ----------
    runs : int
        Independent draws of all errors; a sixth at each other latitude where an answer takes
        long.
    seed : int
        Of the first draw. Everything but the processor times follows from it.
    latitude_deg : float
        Of the platform, which stands in Ankara by default, like the thesis.
    heading_deg : float
        Where it points.
    methods : sequence of str, optional
        Names of `TECHNIQUES`; all by default.
    progress : callable, optional
        Called with (techniques done, techniques in all), each place counting.

    Returns
    -------
    NorthComparison

    Raises
    ------
    ConfigError
        If a technique is unknown, there are fewer than two runs, or the place is none.

    Examples
    --------
    >>> from truenorth.evaluation import compare_north
    >>> print(compare_north(methods=["accelerometer", "imu"]))  # doctest: +SKIP
    """
    names = list(TECHNIQUES) if methods is None else list(methods)
    for name in names:
        if name not in TECHNIQUES:
            raise ConfigError(
                f"there is no technique {name!r}; choose among {', '.join(TECHNIQUES)}",
                key="methods",
                value=name,
            )
    if not names:
        raise ConfigError("no technique is named; leave `methods` out for all", key="methods")
    if runs < 2:
        raise ConfigError(f"`runs` is {runs}; give two or more", key="runs", value=runs)
    if seed < 0:
        raise ConfigError(f"`seed` is {seed}; give 0 or more", key="seed", value=seed)
    names = [name for name in TECHNIQUES if name in names]
    scene = Scene(latitude_deg, 32.8, 900.0, heading_deg, runs, seed)
    few = max(FEWEST, runs // FEW)
    # The first answer of each compiles what it needs, which is no time of an answer.
    scenes = [replace(scene, runs=1), scene]
    scenes += [replace(scene, latitude_deg=latitude) for latitude in LATITUDES_DEG]
    answers: list[list[Answers]] = []
    for number, one in enumerate(scenes):
        place = Place(one)
        fewer = Place(replace(one, runs=few)) if number > 1 else place
        found = []
        for k, name in enumerate(names):
            technique = TECHNIQUES[name]
            found.append(technique.answer(fewer if technique.is_slow else place))
            if progress is not None:
                progress(number * len(names) + k + 1, len(scenes) * len(names))
        answers.append(found)
    _, here, *elsewhere = answers
    results = tuple(
        TechniqueResult(name, here[k], tuple(there[k] for there in elsewhere)) for k, name in enumerate(names)
    )
    return NorthComparison(scene, few, results)


def short(value: float) -> str:
    """Three digits; a dash for what is not known."""
    if not np.isfinite(value):
        return "-"
    if value >= 99.5:
        return f"{value:.0f}"
    return f"{value:#.2g}".rstrip(".") if value < 10.0 else f"{value:.0f}"


def data_word(data_s: float) -> str:
    """How much data an answer takes."""
    return "epoch" if data_s == 0.0 else f"{data_s:.0f} s"


def _mean(values: np.ndarray) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else np.nan


def _plain(value: Any) -> float | str | None:
    """Make a value that JSON can hold."""
    if isinstance(value, str):
        return str(value)
    return float(value) if np.isfinite(value) else None
