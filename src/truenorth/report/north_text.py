"""North found without satellites, in words, as plain values, and as a table."""

import math
import textwrap

import numpy as np

__all__ = [
    "budget_dict",
    "budget_text",
    "north_columns",
    "north_dict",
    "north_text",
    "quantity_words",
    "sigma_word",
    "verdict_text",
]

_ANGLES = ("heading", "pitch", "roll")

_MEANING = {"heading": "clockwise from true north", "pitch": "nose up", "roll": "right side down"}

_UNITS = {
    "mps_per_sqrt_h": "m/s/sqrt(h)",
    "deg_per_sqrt_h": "deg/sqrt(h)",
    "dph_per_sqrt_h": "deg/h/sqrt(h)",
    "ug_per_sqrt_h": "ug/sqrt(h)",
    "dph_per_g": "deg/h/g",
    "arcmin": "arcmin",
    "arcsec": "arcsec",
    "mps2": "m/s^2",
    "radps": "rad/s",
    "mrad": "mrad",
    "mps": "m/s",
    "dph": "deg/h",
    "dps": "deg/s",
    "deg": "deg",
    "rad": "rad",
    "ppm": "ppm",
    "rpm": "rev/min",
    "ug": "ug",
    "hz": "Hz",
    "s": "s",
    "m": "m",
    "g": "g",
}
"""Unit by the end of a name; longer ends come first."""

_WIDTH = 96


def north_text(solution):
    """A search for north in words.

    Parameters
    ----------
    solution : truenorth.northfinding.solution.NorthSolution
        The result.

    Returns
    -------
    str
        Some lines: the angles with sigma, the error budget by source, the verdict, and what a user should
        know.
    """
    angles, sd = np.degrees(solution.angles_rad), np.degrees(solution.angle_sd_rad)
    decimals = _decimals(sd)
    lines = [
        f"method      {solution.method}, {solution.duration_s:g} s of data",
        f"place       {_place(solution.site)}",
    ]
    for name, angle, sigma in zip(_ANGLES, angles, sd, strict=True):
        value = _wrapped(angle, decimals) if name == "heading" else angle
        lines.append(
            f"{name:<11} {value:10.{decimals}f} deg   sigma {sigma_word(sigma):>8} deg   {_MEANING[name]}"
        )
    lines.append(f"            at {solution.time_s:g} s of the record")
    if solution.budget is not None:
        lines.append(budget_text(solution.budget))
    if solution.verdict is not None:
        lines.append(verdict_text(solution.verdict))
    first = "measured"
    for name, value in solution.measured.items():
        label, words = quantity_words(name, value)
        lines.append(f"{first:<11} {label:<34} {words}")
        first = ""
    first = "observed"
    for state in _states(solution):
        lines += _wrap(first, state.sentence)
        first = ""
    for note in solution.notes:
        lines += _wrap("note", note)
    return "\n".join(lines)


def north_dict(solution):
    """A search for north as plain values for JSON.

    Parameters
    ----------
    solution : truenorth.northfinding.solution.NorthSolution
        The result.

    Returns
    -------
    dict
        Strings, numbers, lists and dictionaries; None for what is not known or not finite.
    """
    site = solution.site
    budget, verdict = solution.budget, solution.verdict
    return {
        "method": solution.method,
        "site": {
            "latitude_deg": _number(np.degrees(site.latitude_rad)),
            "longitude_deg": _number(np.degrees(site.longitude_rad)),
            "height_m": _number(site.height_m),
            "latitude_sd_deg": _number(np.degrees(site.latitude_sd_rad)),
        },
        "time_s": _number(solution.time_s),
        "duration_s": _number(solution.duration_s),
        **_angle_values(solution.angles_rad, "_deg"),
        **_angle_values(solution.angle_sd_rad, "_sd_deg"),
        "covariance_ned_deg2": [
            [_number(value) for value in row] for row in np.degrees(np.degrees(solution.cov_ned_rad2))
        ],
        "rot_ned_from_body": [[_number(value) for value in row] for row in solution.rot_ned_from_body],
        "budget": None if budget is None else budget_dict(budget),
        "verdict": None
        if verdict is None
        else {
            "able": None if verdict.able is None else bool(verdict.able),
            "sentence": verdict.sentence,
            "achievable_heading_sd_deg": _number(np.degrees(verdict.achievable_heading_sd_rad)),
            "required_heading_sd_deg": _number(np.degrees(verdict.required_heading_sd_rad)),
        },
        "measured": {name: _number(value) for name, value in solution.measured.items()},
        "observability": [
            {
                "state": state.name,
                "unit": state.unit,
                "sd_before": _number(state.before),
                "sd_after": _number(state.after),
                "goes_with": state.partner,
                "correlation": _number(state.correlation),
            }
            for state in _states(solution)
        ],
        "notes": list(solution.notes),
    }


def _states(solution):
    """States of a filter and what the record told of each; none of other methods."""
    observability = getattr(solution, "observability", None)
    return () if observability is None else observability.states


def north_columns(solution):
    """The estimate as it grew, as columns of a table.

    Parameters
    ----------
    solution : truenorth.northfinding.solution.NorthSolution
        The result; without a run the table has the result as its only row.

    Returns
    -------
    dict of str to ndarray, shape (k,)
        ``time_s``, ``heading_deg``, ``pitch_deg``, ``roll_deg`` and ``heading_sd_deg``, ... .
    """
    run = solution.run
    if run is None:
        time_s = np.array([solution.time_s])
        angles, sd = solution.angles_rad[None], solution.angle_sd_rad[None]
    else:
        time_s, angles, sd = run.time_s, run.angles_rad, run.sd_rad
    columns = {"time_s": np.asarray(time_s, dtype=float)}
    for k, name in enumerate(_ANGLES):
        value = np.degrees(angles[:, k])
        columns[f"{name}_deg"] = value % 360.0 if name == "heading" else value
    for k, name in enumerate(_ANGLES):
        columns[f"{name}_sd_deg"] = np.degrees(sd[:, k])
    return columns


def sigma_word(value):
    """A standard deviation with two digits that count, without an exponent where it can be read.

    Parameters
    ----------
    value : float
        Not negative.

    Returns
    -------
    str
    """
    if not math.isfinite(value):
        return "unknown" if math.isnan(value) else "infinite"
    if value == 0.0:
        return "0"
    if value < 1e-6:
        return f"{value:.1e}"
    # Rounded first: 0.0999 is 0.10, not 0.100.
    exponent = int(f"{value:.1e}".partition("e")[2])
    return f"{value:.{max(0, 1 - exponent)}f}"


def quantity_words(name, value):
    """A quantity whose name ends in its unit: label without unit, and value with it.

    Parameters
    ----------
    name : str
        E.g. ``gyro_bias_x_dph``.
    value : float
        In that unit.

    Returns
    -------
    label, words : str
        E.g. ``gyro bias x`` and ``0.013 deg/h``.
    """
    for end, unit in _UNITS.items():
        if name.endswith(f"_{end}"):
            return name.removesuffix(f"_{end}").replace("_", " "), f"{value:.6g} {unit}"
    return name.replace("_", " "), f"{value:.6g}"


def budget_text(budget):
    """Error budget as a table of sources, and their sum.

    Parameters
    ----------
    budget : truenorth.northfinding.ErrorBudget
        The budget.

    Returns
    -------
    str
        A line for each source.
    """
    total = np.degrees(budget.angle_sd_rad())
    rows = [(line, np.degrees(budget.angle_sd_rad(line))) for line in budget.lines]
    names = [f"{line.source}, {line.stated}" if line.stated else line.source for line, _ in rows]
    width = max([len(name) for name in names] + [24]) + 1

    def row(label, words):
        return f"{label:<{width + 2}}" + "".join(f"{word:>10}" for word in words)

    return "\n".join(
        [
            row("error budget, sigma in deg", _ANGLES),
            *(row(f"  {name}", map(_budget_word, sd)) for name, (_, sd) in zip(names, rows, strict=True)),
            row("  total", map(_budget_word, total)),
        ]
    )


def budget_dict(budget):
    """Error budget as plain values for JSON.

    Parameters
    ----------
    budget : truenorth.northfinding.ErrorBudget
        The budget.

    Returns
    -------
    dict
        ``sources``, a list, and ``total``.
    """
    return {
        "sources": [
            {
                "source": line.source,
                "stated": line.stated,
                **_angle_values(budget.angle_sd_rad(line), "_sd_deg"),
            }
            for line in budget.lines
        ],
        "total": _angle_values(budget.angle_sd_rad(), "_sd_deg"),
    }


def verdict_text(verdict):
    """Verdict in words.

    Parameters
    ----------
    verdict : truenorth.northfinding.Verdict
        The verdict.

    Returns
    -------
    str
        Some lines.
    """
    word = {True: "YES", False: "NO", None: "open"}[verdict.able]
    return "\n".join(_wrap("verdict", f"{word}: {verdict.sentence}"))


def _budget_word(value):
    return "< 0.00001" if 0.0 < value < 1e-5 else sigma_word(value)


def _place(site):
    """Where, and how much of the Earth's turn points north there."""
    north, east = np.degrees(site.latitude_rad), np.degrees(site.longitude_rad)
    words = f"{abs(north):.4f} {'N' if north >= 0.0 else 'S'}"
    if site.longitude_rad != 0.0:
        words += f" {abs(east):.4f} {'E' if east >= 0.0 else 'W'}"
    words += f", {site.height_m:.0f} m"
    if site.latitude_sd_rad > 0.0:
        words += f", latitude sigma {sigma_word(np.degrees(site.latitude_sd_rad))} deg"
    rate_dph = np.degrees(site.horizontal_rate_radps) * 3600.0
    return f"{words}; the Earth turns {rate_dph:.2f} deg/h about north"


def _wrap(label, text):
    """A sentence over several lines beside its label."""
    lines = textwrap.wrap(text, _WIDTH - 12) or [""]
    return [f"{label if k == 0 else '':<11} {line}" for k, line in enumerate(lines)]


def _decimals(sd_deg):
    """Decimals that show the second digit of the smallest sigma."""
    known = sd_deg[np.isfinite(sd_deg) & (sd_deg > 0.0)]
    if not len(known):
        return 3
    return int(np.clip(1 - math.floor(math.log10(known.min())), 2, 6))


def _wrapped(angle_deg, decimals):
    """A heading that is not rounded up to a full turn."""
    return round(angle_deg, decimals) % 360.0


def _number(value):
    value = float(value)
    return value if math.isfinite(value) else None


def _angle_values(values_rad, end):
    return {
        f"{name}{end}": _number(np.degrees(value)) for name, value in zip(_ANGLES, values_rad, strict=True)
    }
