"""An attitude in words: the summary of a run over an array, and the story of one epoch."""

import numpy as np

from ..errors import REASON_SENTENCES, Reason, Status
from ..observations import sat_name, signal_name
from ..timescales import format_gpst

__all__ = ["attitude_text", "explain_attitude"]

_ANGLES = ("heading", "pitch", "roll")

_LEVELS = {
    "joint": "resolved jointly, with all body coordinates",
    "length": "resolved one by one against the first, with their distances from it",
    "free": "resolved one by one against the first, without any geometry",
}


def attitude_text(summary):
    """The summary of a run over an array for people.

    Parameters
    ----------
    summary : dict
        Result of `truenorth.export.summarize_solution` for an `AttitudeSolution`.

    Returns
    -------
    str
        Some lines, the outcome first.
    """
    share = 100.0 * summary["accepted_fraction"]
    by_status = ", ".join(f"{count} {name}" for name, count in summary["epochs_by_status"].items() if count)
    lines = [f"epochs      {summary['epochs']}, {share:.1f} % accepted ({by_status or 'none'})"]
    if summary["epochs"]:
        lines.append(f"time        {summary['first_gpst']} to {summary['last_gpst']} GPST")
    lines += [_angle(name, summary[f"{name}_deg"]) for name in _ANGLES]
    lines.append(f"antennas    {_LEVELS[summary['level']]}")
    for name, entry in summary["antennas"].items():
        left_out = f", left out in {entry['excluded_epochs']}" if entry["excluded_epochs"] else ""
        lines.append(
            f"  {name:<9} {entry['length_m']:.3f} m from the first, used in {entry['used_epochs']} epochs "
            f"({100.0 * entry['used_fraction']:.1f} %){left_out}"
        )
    antennas, satellites = summary["antennas_used"], summary["satellites"]
    if antennas["median"] is not None:
        lines.append(
            f"used        {antennas['median']:g} antennas ({antennas['min']} to {antennas['max']}), "
            f"{satellites['median']:g} satellites ({satellites['min']} to {satellites['max']})"
        )
    if summary["reasons"]:
        lines.append("not whole")
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


def explain_attitude(solution, k, explain_baseline):
    """One epoch's story: the angles, the test of the geometry, and the story of every baseline.

    Parameters
    ----------
    solution : AttitudeSolution
        Result of `truenorth.attitude.solve_array`; with ``keep_residuals`` satellites are told as well.
    k : int
        Index of the epoch.
    explain_baseline : callable
        Tells (baseline, epoch), see `truenorth.report.explain_epoch`.

    Returns
    -------
    str
        Some lines.
    """
    status, reason = Status(int(solution.status[k])), Reason(int(solution.reason[k]))
    lines = [
        f"epoch       {format_gpst(solution.time_ns[k])} GPST, number {k + 1} of {solution.n_epochs}",
        f"status      {status.label}: {REASON_SENTENCES[reason]}",
    ]
    for column, name in enumerate(_ANGLES):
        angle_deg = np.degrees(getattr(solution, f"{name}_rad")[k])
        if np.isfinite(angle_deg):
            sd_deg = np.degrees(solution.angle_sd_rad(column)[k])
            lines.append(f"{name:<11} {angle_deg:.4f} deg, sd {sd_deg:.4f}")
    chi2, limit = solution.chi2[k], solution.chi2_limit[k]
    if np.isfinite(chi2):
        verdict = "passed" if chi2 <= limit else "FAILED"
        lines.append(f"geometry    chi2 {chi2:.2f} against at most {limit:.2f}: {verdict}")
    events = [event.text for event in solution.events if event.time_ns == solution.time_ns[k]]
    lines += [f"event       {text}" for text in events]
    if np.isfinite(solution.success_probability[k]):
        lines.append(f"integers    accepted with probability {solution.success_probability[k]:.6f}")
    parts = [
        "used" if used else "left out" if excluded else "not used"
        for used, excluded in zip(solution.is_used[k], solution.is_excluded[k], strict=True)
    ]
    if not solution.baselines:
        lines += [f"  {name:<9} {part}" for name, part in zip(solution.antennas, parts, strict=True)]
        lines += _residual_lines(solution, k)
        return "\n".join(lines)
    for name, part, baseline in zip(solution.antennas[1:], parts[1:], solution.baselines, strict=True):
        lines.append(f"\n{solution.antennas[0]} to {name}: {part}")
        if baseline.n_epochs == 0:
            continue
        row = int(np.argmin(np.abs(baseline.time_ns - solution.time_ns[k])))
        if abs(int(baseline.time_ns[row] - solution.time_ns[k])) > 0.5e9:
            lines.append("  no epoch")
            continue
        lines += [f"  {line}" for line in explain_baseline(baseline, row).split("\n")]
    return "\n".join(lines)


def _residual_lines(solution, k):
    """The largest phase residuals of a jointly adjusted epoch, where residuals were kept."""
    if solution.residuals is None:
        return
    r = solution.residuals
    here = np.flatnonzero(r.epoch == k)
    if len(here) == 0:
        return
    rms_mm = 1e3 * float(np.sqrt(np.mean(r.residual_m[here] ** 2)))
    yield f"phases      {len(here)} took part, rms residual {rms_mm:.1f} mm; the largest:"
    for i in here[np.argsort(-np.abs(r.residual_m[here]))][:8]:
        name = f"{sat_name(int(r.sat[i]))} {signal_name(int(r.signal[i]))}"
        yield (
            f"  {name} at {solution.antennas[r.antenna[i]]:<9} "
            f"{1e3 * r.residual_m[i]:+7.1f} mm, elevation {np.degrees(r.elevation_rad[i]):.0f} deg"
        )


def _angle(name, entry):
    if entry["mean"] is None:
        return f"{name:<11} none"
    stated = "" if entry["stated_sd"] is None else f", stated {entry['stated_sd']:.3f} of one epoch"
    return f"{name:<11} {entry['mean']:.3f} deg, scatter {entry['sd']:.3f}{stated}"
