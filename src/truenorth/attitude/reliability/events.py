"""What the tests decided, as sentences for the log: statistic, limit and consequence."""

from __future__ import annotations

import numpy as np

from ..solution import EpochEvent
from .adaptation import Outcome
from .protection import PROTECTION_SENTENCES, ProtectionState

__all__ = ["adaptation_events", "phase_events", "protection_events", "reliability_events"]

OUTCOME_SENTENCES = {
    Outcome.NOT_IDENTIFIED: "no antenna can be blamed alone",
    Outcome.NOT_SEPARATED: "more than one antenna could be to blame",
    Outcome.NOT_REMOVABLE: "whose fault it is cannot be told with so few antennas",
    Outcome.TOO_MANY: "more antennas are wrong than may be left out",
}

ANGLES = ("heading", "pitch", "roll")


def adaptation_events(adaptation):
    """Exclusions of antennas, and epochs that were given up.

    Parameters
    ----------
    adaptation : AttitudeAdaptation
        From `adapt_attitude`.

    Returns
    -------
    list of EpochEvent
        In time order; kind ``excluded`` or ``test``.
    """
    vectors = adaptation.vectors
    names = vectors.names or tuple(str(k) for k in range(len(vectors.positions_body_m)))
    present = vectors.is_present.copy()
    rows = np.flatnonzero(vectors.reference >= 0)
    present[rows, vectors.reference[rows]] = True
    events = []
    for k in np.flatnonzero(np.any(adaptation.antenna >= 0, axis=1) | _given_up(adaptation.outcome)):
        time_ns, resolved = int(vectors.time_ns[k]), adaptation.outcome[k] <= Outcome.ADAPTED
        for number in np.flatnonzero(adaptation.antenna[k] >= 0):
            antenna = adaptation.antenna[k, number]
            statistic, limit = adaptation.antenna_statistic[k, number], adaptation.antenna_limit[k, number]
            text = (
                f"antenna {names[antenna]} contradicts the others (test {statistic:.1f}, limit {limit:.1f}; "
                f"all vectors {adaptation.statistic[k, number]:.1f}, limit {adaptation.limit[k, number]:.1f})"
            )
            if resolved:
                text += f" and is left out; the attitude rests on {_listed(names, present[k])}"
            events.append(EpochEvent(time_ns, "excluded", "", "", float(statistic), float(limit), text))
        if not resolved:
            last = np.flatnonzero(np.isfinite(adaptation.statistic[k]))[-1]
            statistic, limit = adaptation.statistic[k, last], adaptation.limit[k, last]
            why = OUTCOME_SENTENCES[Outcome(adaptation.outcome[k])]
            text = (
                f"the vectors contradict the shape of the array (test {statistic:.1f}, limit {limit:.1f}) "
                f"and {why}; the epoch has no attitude"
            )
            events.append(EpochEvent(time_ns, "test", "", "", float(statistic), float(limit), text))
    return events


def reliability_events(reliability):
    """Epochs whose attitude was kept although a test failed, with what the failed test points to.

    Parameters
    ----------
    reliability : AttitudeReliability
        From `attitude_reliability` or `filter_reliability`.

    Returns
    -------
    list of EpochEvent
        In time order, of kind ``test``.
    """
    events = []
    for k in np.flatnonzero(reliability.is_tested & ~reliability.is_passed):
        quotient = reliability.antenna_statistic[k] / reliability.antenna_limit[k]
        worst = int(np.nanargmax(quotient))
        own, own_limit = reliability.antenna_statistic[k, worst], reliability.antenna_limit[k, worst]
        shift_mm = 1e3 * float(np.linalg.norm(reliability.antenna_shift_m[k, worst]))
        name = reliability.antennas[worst]
        statistic, limit = reliability.statistic[k], reliability.limit[k]
        if statistic > limit:
            head = f"all vectors fail their test ({statistic:.1f}, limit {limit:.1f}); "
        else:
            head, statistic, limit = "", own, own_limit
        text = (
            f"{head}antenna {name} stands out most (test {own:.1f}, limit {own_limit:.1f}), by "
            f"{shift_mm:.0f} mm; the protection levels do not hold for this epoch"
        )
        events.append(
            EpochEvent(int(reliability.time_ns[k]), "test", "", "", float(statistic), float(limit), text)
        )
    return events


def protection_events(reliability):
    """Where the protection level of an angle is lost and found again.

    Parameters
    ----------
    reliability : AttitudeReliability
        From `attitude_reliability` or `filter_reliability`.

    Returns
    -------
    list of EpochEvent
        In time order, of kind ``protection``; the statistic is the probability of wrong integers, the limit
        the integrity risk.
    """
    events, risk = [], reliability.settings.integrity_risk
    for k, name in enumerate(ANGLES):
        state = reliability.protection_state[:, k].astype(int)
        for row in np.flatnonzero(np.diff(state, prepend=int(ProtectionState.OK))):
            if state[row] == ProtectionState.OK:
                degrees = np.degrees(reliability.protection_rad[row, k])
                text = f"{name} has a protection level again: {degrees:.2f} deg at a risk of {risk:g}"
            else:
                text = (
                    f"{name} has no protection level at a risk of {risk:g}: "
                    f"{PROTECTION_SENTENCES[ProtectionState(state[row])]}"
                )
            time_ns, wrong = int(reliability.time_ns[row]), float(reliability.wrong_integer_risk[row])
            events.append(EpochEvent(time_ns, "protection", "", "", wrong, risk, text))
    return sorted(events, key=lambda event: event.time_ns)


def phase_events(time_ns, reliability, epoch, *, antennas, satellites, signals):
    """Phases of an epoch whose test failed.

    Parameters
    ----------
    time_ns : int
        GPS time of the epoch.
    reliability : PhaseReliability
        With its tests.
    epoch : ArrayEpoch
        To which it belongs.
    antennas : sequence of str
        Names by antenna number.
    satellites, signals : sequence of str
        Names by the satellite number of a row, which counts satellites and signals.

    Returns
    -------
    list of EpochEvent
        Largest first, of kind ``outlier``.
    """
    rows = np.flatnonzero(reliability.is_flagged)
    events = []
    for row in rows[np.argsort(-np.abs(reliability.w[rows]), kind="stable")]:
        number = epoch.satellite[row]
        effect = np.degrees(
            np.abs(reliability.estimated_m[row] / reliability.mdb_m[row]) * reliability.external_rad[row]
        )
        limit, size_mm = reliability.settings.rejection_limit, 1e3 * reliability.estimated_m[row]
        text = (
            f"the phase {satellites[number]} {signals[number]} of antenna {antennas[epoch.antenna[row]]} is "
            f"{size_mm:+.0f} mm from what the others say (w {reliability.w[row]:.2f}, limit {limit:.2f}; "
            f"detectable from {1e3 * reliability.mdb_m[row]:.0f} mm); kept, it moves the heading by "
            f"{effect[0]:.2f} deg, the pitch by {effect[1]:.2f}, the roll by {effect[2]:.2f}"
        )
        events.append(
            EpochEvent(
                int(time_ns), "outlier", satellites[number], signals[number], abs(float(reliability.w[row])),
                reliability.settings.rejection_limit, text,
            )
        )  # fmt: skip
    return events


def _given_up(outcome):
    """Epochs that were tested and not resolved."""
    return (outcome > Outcome.ADAPTED) & (outcome != Outcome.NOT_TESTED)


def _listed(names, chosen):
    """Names in a sentence."""
    chosen = [names[k] for k in np.flatnonzero(chosen)]
    return " and ".join([", ".join(chosen[:-1]), chosen[-1]]) if len(chosen) > 1 else "".join(chosen)
