"""What a run demands of its tests, with the limits that follow from it."""

from __future__ import annotations

from ...config import ReliabilitySection
from .significance import b_method_limit, detectable_shift, local_limit

__all__ = ["ReliabilitySettings"]


class ReliabilitySettings(ReliabilitySection, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The ``[reliability]`` table of a session, and the limits of the tests."""

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
