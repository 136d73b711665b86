"""A result in words: the summary of a run, and the story of one epoch."""

import numpy as np

from ..attitude.array_solution import AttitudeSolution
from ..errors import REASON_SENTENCES, ConfigError, Reason, Status
from ..observations import sat_name, signal_name
from ..timescales import NS_PER_DAY, NS_PER_S, format_gpst, parse_gpst
from .attitude_text import attitude_text, explain_attitude

__all__ = ["explain_epoch", "find_epoch", "summary_text"]


def summary_text(summary):
    """The summary of a run for people.

    Parameters
    ----------
    summary : dict
        Result of `truenorth.export.summarize_solution`.

    Returns
    -------
    str
        Some lines, the outcome first.
    """
    if "heading_deg" in summary:
        return attitude_text(summary)
    share = 100.0 * summary["accepted_fraction"]
    by_status = ", ".join(f"{count} {name}" for name, count in summary["epochs_by_status"].items() if count)
    lines = [f"epochs      {summary['epochs']}, {share:.1f} % accepted ({by_status or 'none'})"]
    if summary["epochs"]:
        lines.append(f"time        {summary['first_gpst']} to {summary['last_gpst']} GPST")
    lines += [
        _quantity("azimuth", summary["azimuth_deg"], "deg", 3),
        _quantity("elevation", summary["elevation_deg"], "deg", 3),
        _quantity("length", summary["length_m"], "m", 4),
        f"declared    {length_sentence(summary['length_check'])}",
    ]
    sats, signals = summary["satellites"], summary["signals"]
    if sats["median"] is not None:
        lines.append(
            f"used        {sats['median']:g} satellites ({sats['min']} to {sats['max']}), "
            f"{signals['median']:g} double differences ({signals['min']} to {signals['max']})"
        )
    if summary["reasons"]:
        lines.append("no fix")
        lines += [
            f"{entry['epochs']:10d}  {name}: {entry['sentence']}"
            for name, entry in summary["reasons"].items()
        ]
    lines += [f"warning     {text}" for text in summary["warnings"]]
    if summary.get("files"):
        lines.append(f"written     {', '.join(summary['files'])}")
    lines.append(
        "seconds     " + ", ".join(f"{name} {value:.2f}" for name, value in summary["seconds"].items())
    )
    return "\n".join(lines)


def length_sentence(check):
    """The declared length against the measured one, in one sentence without its subject.

    Parameters
    ----------
    check : dict
        Result of `truenorth.attitude.length_check.compare_length`.

    Returns
    -------
    str
    """
    measured = ""
    if check["measured_m"] is not None:
        measured = (
            f"measured {'without it ' * bool(check.get('without_declared'))}{check['measured_m']:.4f} m"
        )
        if check["measured_sd_m"] is not None:
            measured += f" (sd {1e3 * check['measured_sd_m']:.1f} mm)"
    if check["declared_m"] is None:
        return f"no length; {measured}" if measured else "no length"
    declared = f"{check['declared_m']:.4f} m (sd {1e3 * check['declared_sd_m']:.1f} mm)"
    if not measured:
        return f"{declared}; not measured"
    difference = f"difference {1e3 * check['difference_m']:+.1f} mm, limit {1e3 * check['limit_m']:.1f} mm"
    if check["verdict"] == "agrees":
        return f"{declared}, {measured}: they agree ({difference})"
    return f"{declared}, {measured}: THEY DISAGREE ({difference}); suspect the declared length"


def find_epoch(solution, text):
    """Index of the epoch at a time.

    Parameters
    ----------
    solution : BaselineSolution or AttitudeSolution
        Result of `truenorth.solve_baseline`.
    text : str
        GPS time in ISO 8601, or a time of day of the first day that has it.

    Returns
    -------
    int
        The nearest epoch.

    Raises
    ------
    ConfigError
        If the text is not a time, or further from every epoch than their spacing.
    """
    if solution.n_epochs == 0:
        raise ConfigError("there are no epochs to explain", key="explain", value=text)
    first_ns, last_ns = int(solution.time_ns[0]), int(solution.time_ns[-1])
    try:
        if "-" in text:
            wanted_ns = parse_gpst(text)
        else:
            wanted_ns = parse_gpst(f"1980-01-06T{text}") + first_ns // NS_PER_DAY * NS_PER_DAY
            wanted_ns += NS_PER_DAY * (wanted_ns < first_ns - NS_PER_S)
    except ValueError as error:
        raise ConfigError(
            f"`--explain {text}` is not a time; write it like {format_gpst(first_ns)} or its time of day",
            key="explain",
            value=text,
        ) from error
    k = int(np.argmin(np.abs(solution.time_ns - wanted_ns)))
    spacing_ns = int(np.median(np.diff(solution.time_ns))) if solution.n_epochs > 1 else NS_PER_S
    if abs(int(solution.time_ns[k]) - wanted_ns) > spacing_ns:
        raise ConfigError(
            f"no epoch at {text}: the solution runs from {format_gpst(first_ns)} to {format_gpst(last_ns)} "
            f"GPST, and its nearest epoch is {format_gpst(solution.time_ns[k])}",
            key="explain",
            value=text,
        )
    return k


def explain_epoch(solution, k):
    """One epoch's story: what was used, which tests were made, which numbers met which limits.

    Parameters
    ----------
    solution : BaselineSolution or AttitudeSolution
        Result of `truenorth.solve_baseline`.
    k : int
        Index of the epoch.

    Returns
    -------
    str
        Some lines.
    """
    if isinstance(solution, AttitudeSolution):
        return explain_attitude(solution, k, explain_epoch)
    status, reason = Status(int(solution.status[k])), Reason(int(solution.reason[k]))
    lines = [
        f"epoch       {format_gpst(solution.time_ns[k])} GPST, number {k + 1} of {solution.n_epochs}",
        f"status      {status.label}: {REASON_SENTENCES[reason]}",
        f"quality     class {int(solution.quality[k])} of 1 (integer) to 6 (single point)",
        f"used        {int(solution.n_sats[k])} satellites, {int(solution.n_signals[k])} double differences",
    ]
    if np.isfinite(solution.azimuth_rad[k]):
        angles = ("azimuth", "elevation")
        angle_deg = [np.degrees(getattr(solution, f"{name}_rad")[k]) for name in angles]
        sd_deg = [np.degrees(getattr(solution, f"{name}_sd_rad")[k]) for name in angles]
        lines += [
            f"azimuth     {angle_deg[0]:.4f} deg, sd {sd_deg[0]:.4f}",
            f"elevation   {angle_deg[1]:.4f} deg, sd {sd_deg[1]:.4f}",
            "baseline    east {:.4f}, north {:.4f}, up {:.4f} m".format(*solution.baseline_enu_m[k]),
        ]
    lines += ["tests", *(f"  {line}" for line in _tests(solution, k))]
    lines.append(
        f"dilution    position {solution.pdop[k]:.2f}, azimuth {solution.azimuth_dop[k]:.2f}, "
        f"elevation {solution.elevation_dop[k]:.2f}"
    )
    lines += _signals(solution, k)
    events = [event for event in solution.events if event.time_ns == solution.time_ns[k]]
    if events:
        lines.append("events")
        lines += [f"  {_event_line(event)}" for event in events]
    return "\n".join(lines)


def _quantity(name, entry, unit, digits):
    if entry["mean"] is None:
        return f"{name:11s} none"
    stated = "" if entry["stated_sd"] is None else f", stated {entry['stated_sd']:.{digits}f}"
    return f"{name:11s} {entry['mean']:.{digits}f} {unit}, sd {entry['sd']:.{digits}f} of one epoch{stated}"


def _tests(solution, k):
    """Every test of an epoch as number against limit."""
    settings = solution.settings
    lines = []

    def add(name, value, relation, limit, passed, unit=""):
        verdict = "passed" if passed else "FAILED"
        lines.append(f"{name:20s} {value}{unit} {relation} {limit}{unit}: {verdict}")

    chi2, chi2_limit = solution.chi2[k], solution.chi2_limit[k]
    if np.isfinite(chi2) and np.isfinite(chi2_limit):
        add("residuals (chi2)", f"{chi2:.2f}", "against at most", f"{chi2_limit:.2f}", chi2 <= chi2_limit)
    length_m, sd_m = _candidate_length(solution, k)
    declared_m = settings.get("length_m")
    if declared_m is not None and np.isfinite(length_m) and settings.get("length_use") != "off":
        limit_m = settings.get("length_tolerance_sd", 4.0) * np.hypot(settings.get("length_sd_m", 0.0), sd_m)
        passed = abs(length_m - declared_m) <= limit_m
        add(
            "length",
            f"{1e3 * (length_m - declared_m):+.1f}",
            f"({length_m:.4f} measured, {declared_m:.4f} declared) against at most",
            f"{1e3 * limit_m:.1f}",
            passed,
            " mm",
        )
    probability = solution.success_probability[k]
    if np.isfinite(probability) and "success_probability" in settings:
        limit = settings["success_probability"]
        add(
            "success probability",
            f"{probability:.6f}",
            "against at least",
            f"{limit:g}",
            probability >= limit,
        )
    ratio = solution.ratio[k]
    if np.isfinite(ratio):
        if settings.get("ratio_test") == "fixed":
            limit = settings.get("ratio_threshold", 3.0)
            add("ratio", f"{ratio:.2f}", "against at least", f"{limit:g}", ratio >= limit)
        else:
            lines.append(f"{'ratio':20s} {ratio:.2f} (ratio test: {settings.get('ratio_test', 'none')})")
    return lines or ["no integer candidate was left to be tested"]


def _candidate_length(solution, k):
    """Length and deviation that the length test saw: of the best candidate, else of the solution."""
    if solution.candidate_length_m is not None:
        return solution.candidate_length_m[k], solution.candidate_length_sd_m[k]
    if not solution.is_accepted[k]:
        return np.nan, np.nan
    return solution.length_m[k], solution.length_sd_m[k]


def _signals(solution, k):
    """The satellites of an epoch with their residuals, highest first."""
    rows = np.flatnonzero(solution.residual_epoch == k)
    if len(rows) == 0:
        return ["satellites  none took part"]
    rows = rows[np.lexsort((solution.residual_signal[rows], -solution.residual_elevation_rad[rows]))]
    lines = ["satellites  signal  elevation  azimuth  residual     integer"]
    for row in rows:
        integer = solution.residual_integer_cyc[row]
        if solution.residual_is_reference[row]:
            word = "reference"
        else:
            word = f"{integer:.0f}" if np.isfinite(integer) else "float"
        sat = sat_name(int(solution.residual_sat[row]))
        signal = signal_name(int(solution.residual_signal[row]))
        residual_m = solution.residual_m[row]
        residual = f"{1e3 * residual_m:+8.1f} mm" if np.isfinite(residual_m) else f"{'none':>11s}"
        lines.append(
            f"  {sat:9s} {signal:6s} "
            f"{np.degrees(solution.residual_elevation_rad[row]):8.1f} "
            f"{np.degrees(solution.residual_azimuth_rad[row]) % 360.0:9.1f} "
            f"{residual} {word:>9s}"
        )
    return lines


def _event_line(event):
    where = " ".join(word for word in (event.satellite, event.signal) if word)
    numbers = ""
    if np.isfinite(event.statistic):
        numbers = f" ({event.statistic:.4g}"
        numbers += f" against {event.limit:.4g})" if np.isfinite(event.limit) else ")"
    return f"{event.kind}{' ' + where if where else ''}: {event.text}{numbers}"
