"""An attitude in words: the summary of a run over an array, and the story of one epoch."""

import numpy as np

from ..errors import REASON_SENTENCES, Reason, Status
from ..timescales import format_gpst

__all__ = ["attitude_text", "explain_attitude"]

_ANGLES = ("heading", "pitch", "roll")


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
    lines.append(f"antennas    {summary['reference']} is the reference")
    for name, entry in summary["antennas"].items():
        left_out = f", left out in {entry['excluded_epochs']}" if entry["excluded_epochs"] else ""
        lines.append(
            f"  {name:<9} {entry['length_m']:.3f} m, {100.0 * entry['accepted_fraction']:.1f} % of epochs "
            f"accepted, used in {entry['used_epochs']}{left_out}"
        )
    baselines, satellites = summary["baselines"], summary["satellites"]
    if baselines["median"] is not None:
        lines.append(
            f"used        {baselines['median']:g} baselines ({baselines['min']} to {baselines['max']}), "
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
    for b, (name, baseline) in enumerate(zip(solution.antennas[1:], solution.baselines, strict=True)):
        part = "used" if solution.is_used[k, b] else "left out" if solution.is_excluded[k, b] else "not used"
        lines.append(f"\n{solution.antennas[0]} to {name}: {part}")
        if baseline.n_epochs == 0:
            continue
        row = int(np.argmin(np.abs(baseline.time_ns - solution.time_ns[k])))
        if abs(int(baseline.time_ns[row] - solution.time_ns[k])) > 0.5e9:
            lines.append("  no epoch")
            continue
        lines += [f"  {line}" for line in explain_baseline(baseline, row).split("\n")]
    return "\n".join(lines)


def _angle(name, entry):
    if entry["mean"] is None:
        return f"{name:<11} none"
    stated = "" if entry["stated_sd"] is None else f", stated {entry['stated_sd']:.3f} of one epoch"
    return f"{name:<11} {entry['mean']:.3f} deg, scatter {entry['sd']:.3f}{stated}"
