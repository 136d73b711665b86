"""What a run carries from one block of epochs to the next: a state, and nothing else of the past.

Arcs are numbered anew in every block (`truenorth.ambiguity.slips`), so the number of arcs, and with it
the state, is bounded by the block.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .slips import NO_ARCS, ArcEnds, Arcs

__all__ = ["EngineState", "ResolutionState"]


@dataclass(frozen=True, slots=True, eq=False)
class EngineState:
    """State of the compiled engine; its arrays are those of `truenorth._kernels.engine.run_engine`.

    Parameters
    ----------
    origin_ns : int
        GPS time from which the engine counts seconds.
    offset_cyc : ndarray, shape (n_arcs,)
        Whole cycles of each arc that stay outside the engine; NaN before its first phase.
    memory, vector, slot_arc, arc_number, arc_value, carried : ndarray
        Changed by the engine.
    """

    origin_ns: int
    offset_cyc: np.ndarray
    memory: np.ndarray
    vector: np.ndarray
    slot_arc: np.ndarray
    arc_number: np.ndarray
    arc_value: np.ndarray
    carried: np.ndarray

    @classmethod
    def begin(cls, origin_ns: int, n_arcs: int, widest: int) -> EngineState:
        """State before the first epoch of a run, for epochs of up to `widest` rows."""
        from .._kernels import engine

        size = 2 * widest + 1
        arc_number = np.zeros((3, n_arcs), np.int64)
        arc_number[engine.SLOT] = -1
        carried = np.zeros(engine.N_CARRIED)
        carried[engine.ACCEPTED_VARIANCE] = np.nan
        return cls(
            origin_ns,
            np.full(n_arcs, np.nan),
            np.zeros((size, size)),
            np.zeros(size),
            np.full(size, -1, np.int64),
            arc_number,
            np.full((3, n_arcs), np.nan),
            carried,
        )

    def go_on(self, was: np.ndarray, now: np.ndarray, n_arcs: int, widest: int) -> EngineState:
        """State before the next block, in which the arcs `was` have the numbers `now`."""
        from .._kernels import engine

        n = int(self.carried[engine.N_SLOTS])
        new = self.begin(self.origin_ns, n_arcs, max(widest, n))
        new_number = np.full(self.arc_value.shape[1], -1)
        new_number[was] = now
        new.offset_cyc[now] = self.offset_cyc[was]
        new.memory[:n, :n] = self.memory[:n, :n]
        new.vector[:n] = self.vector[:n]
        new.slot_arc[:n] = new_number[self.slot_arc[:n]]
        new.arc_number[:, now] = self.arc_number[:, was]
        new.arc_value[:, now] = self.arc_value[:, was]
        new.carried[:] = self.carried
        return new


@dataclass(slots=True, eq=False)
class ResolutionState:
    """State of the integer resolution; a new one is the start of a run.

    Parameters
    ----------
    ends : ArcEnds
        Where the arcs of the last block ended.
    engine : EngineState, optional
        Of the methods of the compiled engine.
    classical : dict
        Of the classical methods.
    """

    ends: ArcEnds = NO_ARCS
    engine: EngineState | None = None
    classical: dict[str, Any] = field(default_factory=dict)

    def enter_block(self, arcs: Arcs, origin_ns: int, n_arcs: int, widest: int) -> EngineState:
        """Take the engine's state over the border between two blocks; `origin_ns` counts in the first."""
        was, self.ends = self.ends.arc, arcs.ends
        if self.engine is None:
            self.engine = EngineState.begin(origin_ns, n_arcs, widest)
        else:
            self.engine = self.engine.go_on(was, arcs.resumed, n_arcs, widest)
        return self.engine
