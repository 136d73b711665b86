"""What a run demands of its tests, and the risks that its protection levels share out."""

from __future__ import annotations

from typing import Literal

import msgspec

from ...errors import ConfigError
from .significance import b_method_limit, detectable_shift, local_limit

__all__ = ["ReliabilitySettings"]


class ReliabilitySettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Tests for blunders, minimal detectable blunders and protection levels."""

    false_alarm: float = 0.001
    """Significance of the test of one observation; those of all others follow by the B-method."""
    missed_detection: float = 0.2
    """One less the power at the minimal detectable blunder."""
    mdb_screen: Literal["none", "estimated", "innovation"] = "none"
    """Further condition of a rejection. ``estimated``: the estimated blunder exceeds the minimal detectable
    one, which raises the limit from 3.29 to 4.13 and leaves a power of one half at the minimal detectable
    blunder; ``innovation``: the residual itself exceeds it, as printed by Wang and Lachapelle (2002)."""
    max_rejections: int = 2
    """Most vectors (or observations) of an epoch that are left out, one pass each; an epoch that needs more
    is not used."""
    separation: float = 13.8
    """An exclusion must explain the data better than any other by this much in chi-square, a likelihood
    ratio of a thousand; otherwise the epoch is not used."""
    integrity_risk: float = 1e-5
    """Probability, in an epoch and for each angle, that its error exceeds the protection level unnoticed."""
    fault_prior: float = 1e-4
    """Probability that an antenna is at fault in an epoch by any amount; antennas independently."""
    satellite_prior: float = 0.0
    """Probability that the phases of a satellite are at fault in an epoch, for levels from phases."""
    wrong_integer_risk: float = 0.0
    """Probability that the integers of an epoch are wrong, where the run does not state its own; taken off
    the integrity risk. With 0 the levels are those of right integers."""

    def __post_init__(self) -> None:
        for key in ("false_alarm", "missed_detection", "integrity_risk"):
            value = getattr(self, key)
            if not 0.0 < value < 1.0:
                raise ConfigError(
                    f"`{key}` is {value!r}; give a probability between 0 and 1", key=key, value=value
                )
        for key in ("fault_prior", "satellite_prior", "wrong_integer_risk"):
            value = getattr(self, key)
            if not 0.0 <= value < 1.0:
                raise ConfigError(
                    f"`{key}` is {value!r}; give a probability, 0 or more", key=key, value=value
                )
        if self.max_rejections < 0:
            raise ConfigError(
                f"`max_rejections` is {self.max_rejections!r}; give 0 or more",
                key="max_rejections",
                value=self.max_rejections,
            )
        if not self.separation >= 0.0:
            raise ConfigError(
                f"`separation` is {self.separation!r}; give 0 or more",
                key="separation",
                value=self.separation,
            )

    @property
    def local_limit(self) -> float:
        """float: Limit of |w|."""
        return local_limit(self.false_alarm)

    @property
    def delta0(self) -> float:
        """float: Shift of w that its test finds with the demanded power."""
        return detectable_shift(self.false_alarm, self.missed_detection)

    @property
    def rejection_limit(self) -> float:
        """float: Limit of |w| with the screen by the estimated blunder, where it is on."""
        return max(self.local_limit, self.delta0) if self.mdb_screen == "estimated" else self.local_limit

    @property
    def screened_delta0(self) -> float:
        """float: Shift of w that is rejected with the demanded power, the screen included."""
        return self.delta0 - self.local_limit + self.rejection_limit

    def limit(self, dof: int) -> float:
        """Limit of a chi-square test that finds what the local test finds.

        Parameters
        ----------
        dof : int
            Degrees of freedom.

        Returns
        -------
        float
        """
        return b_method_limit(int(dof), self.false_alarm, self.missed_detection)
