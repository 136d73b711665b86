"""How often the joint search finds the integers of an array: drawn, for no formula knows rotations.

Phases and codes of all antennas are made up with their noise and searched like measured ones. Right are
those whose integers are the true ones; the interval is that of Wilson (1927) at 95 %.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..ambiguity.joint import resolve_joint
from ..errors import ConfigError, Status
from ..timescales import format_gpst
from .plan import Plan

__all__ = ["JointSuccess", "draw_joint_success"]

Z95 = 1.959964


@dataclass(frozen=True, slots=True, eq=False)
class JointSuccess:
    """Draws at some epochs of a plan, m of them.

    Parameters
    ----------
    time_ns : ndarray of int64, shape (m,)
        GPS time of the epochs.
    draws : int
        At each epoch.
    right : ndarray of int, shape (m,)
        Draws whose best integers are the true ones.
    accepted, wrong : ndarray of int, shape (m,)
        Accepted by the tests, and wrong among these.
    lower : ndarray, shape (m,)
        Lower bound that one baseline by itself has, see `Plan.success`.
    """

    time_ns: np.ndarray
    draws: int
    right: np.ndarray
    accepted: np.ndarray
    wrong: np.ndarray
    lower: np.ndarray

    @property
    def interval(self) -> np.ndarray:
        """Ndarray, shape (m, 2): 95 % interval of the success rate."""
        n, share = self.draws, self.right / self.draws
        middle = (share + Z95**2 / (2 * n)) / (1 + Z95**2 / n)
        half = Z95 / (1 + Z95**2 / n) * np.sqrt(share * (1 - share) / n + Z95**2 / (4 * n**2))
        return np.stack([np.clip(middle - half, 0.0, 1.0), np.clip(middle + half, 0.0, 1.0)], axis=-1)

    def to_dict(self) -> dict[str, Any]:
        """Values that JSON can hold."""
        return {
            "draws": self.draws,
            "epochs": [
                {
                    "time_gpst": format_gpst(self.time_ns[k]),
                    "joint_success": float(self.right[k] / self.draws),
                    "interval_95": self.interval[k].tolist(),
                    "accepted": float(self.accepted[k] / self.draws),
                    "wrong": int(self.wrong[k]),
                    "baseline_success": float(self.lower[k]),
                }
                for k in range(len(self.time_ns))
            ],
        }

    def __str__(self) -> str:
        """One line for the whole, one for the worst epoch."""
        share = self.right / self.draws
        worst = int(np.argmin(share))
        low, high = self.interval[worst]
        return (
            f"joint       all antennas at once, {len(share)} epochs of {self.draws} draws: "
            f"{100 * share.mean():.1f} % right, {100 * self.accepted.mean() / self.draws:.1f} % accepted, "
            f"{int(self.wrong.sum())} wrong of these\n"
            f"            worst at {format_gpst(self.time_ns[worst], decimals=0)}: "
            f"{100 * share[worst]:.1f} % ({100 * low:.1f} to {100 * high:.1f}), one baseline at least "
            f"{100 * self.lower[worst]:.1f} %"
        )


def draw_joint_success(
    plan: Plan, *, epochs: Any = None, draws: int = 100, seed: int = 1, success_probability: float = 0.999
) -> JointSuccess:
    """Draw single epochs of a plan and resolve them with the joint search.

    Parameters
    ----------
    plan : Plan
        The array, its place and its day.
    epochs : sequence of int, optional
        Which epochs; by default eight over the day.
    draws : int
        At each epoch.
    seed : int
        Of the draws.
    success_probability : float
        Demanded for acceptance.

    Returns
    -------
    JointSuccess
    """
    if draws < 1:
        raise ConfigError(f"`draws` is {draws!r}; give 1 or more", key="draws", value=draws)
    if epochs is None:
        epochs = np.unique(np.linspace(0, plan.n_epochs - 1, min(8, plan.n_epochs)).astype(int))
    epochs = np.atleast_1d(np.asarray(epochs, dtype=np.int64))
    right, accepted, wrong = (np.zeros(len(epochs), dtype=np.int64) for _ in range(3))
    rng = np.random.default_rng(seed)
    for place, epoch in enumerate(epochs.tolist()):
        clean = plan.array_epoch(epoch)
        n = len(clean.antenna)
        if n == 0:
            continue
        for _ in range(draws):
            phase_m = clean.phase_m + np.sqrt(clean.phase_variance_m2) * rng.standard_normal(n)
            code_m = clean.code_m + np.sqrt(clean.code_variance_m2) * rng.standard_normal(n)
            found = resolve_joint(
                replace(clean, phase_m=phase_m, code_m=code_m), success_probability=success_probability
            )
            is_right = found.status != Status.NONE and not np.any(found.integers_cyc)
            is_accepted = found.status == Status.FIXED
            right[place] += is_right
            accepted[place] += is_accepted
            wrong[place] += is_accepted and not is_right
    return JointSuccess(plan.time_ns[epochs], draws, right, accepted, wrong, plan.success[epochs])
