"""One pass of the attitude filter: blocks of epochs, starts, recoveries, and the events in words."""

from __future__ import annotations

import math

import numpy as np

from ..rotations import heading_pitch_roll
from .filter_start import fit_rows, spans_directions
from .filter_state import FilteredAttitude, FilterState, FilterStatus
from .solution import EpochEvent
from .vectors import angle_covariance
from .white_rows import WhiteRows, white_rows

__all__ = ["FilterRun"]

BLOCK_NUMBERS = 4_000_000
"""White rows that are held at once: 32 MB."""

PENDING_EPOCHS = 20
"""Epochs without a full attitude of their own that are kept for a start from several."""

WIDE_RAD = 1.0
"""Standard deviation of the guess from which a start from several epochs is filtered."""


class FilterRun:
    """One pass of the filter over a run: the epochs of the vectors and the times asked for, merged."""

    def __init__(self, measured, settings, is_used, times_ns, state):
        from .._kernels import attitude_filter as kernels

        self.kernels = kernels
        self.measured, self.settings, self.is_given = measured, settings, is_used
        m = len(measured.positions_body_m)
        epochs = np.array(measured.time_ns, dtype=np.int64)
        if times_ns is None:
            self.time_ns, self.output = epochs, None
        else:
            times_ns = np.asarray(times_ns, dtype=np.int64)
            self.time_ns = np.union1d(epochs, times_ns)
            self.output = np.searchsorted(self.time_ns, times_ns)
        n = len(self.time_ns)
        self.of_epoch = np.searchsorted(self.time_ns, epochs)
        self.epochs = np.zeros((n, 3), dtype=np.int64)
        self.epochs[:, kernels.TIME] = self.time_ns
        self.epochs[self.of_epoch, kernels.IS_EPOCH] = 1
        self.body = np.ascontiguousarray(measured.positions_body_m, dtype=float).copy()
        self.consider = np.ascontiguousarray(measured.body_cov_m2, dtype=float).copy()
        self.n_consider = 3 * m if np.any(self.consider) else 0
        self._set_limits(3 * max(m - 1, 1))
        if state is None:
            state = FilterState(
                np.eye(4, 3), np.eye(6), np.zeros((6, self.n_consider)),
                np.zeros(kernels.N_CARRIED, dtype=np.int64),
            )  # fmt: skip
            state.carried[kernels.SEGMENT] = -1
        self.state = state.copy()
        # Rotation and, in the fourth row, rate.
        self.pose = np.full((n, 4, 3), np.nan)
        self.cov = np.full((n, 6, 6), np.nan)
        # The smoother needs what is noise and what is not apart; else a block of it is enough.
        self.is_smoother = settings.direction == "smoother"
        self.sensitivity = np.zeros((n if self.is_smoother else 0, 6, self.n_consider))
        kept = n if settings.keep_predictions else 0
        self.before_pose = np.full((kept, 4, 3), np.nan)
        self.before_cov = np.full((kept, 6, 6), np.nan)
        self.marks = np.zeros((n, 2), dtype=np.int64)
        self.marks[:, kernels.STRETCH] = -1
        self.status, self.segment = self.marks[:, kernels.STATUS], self.marks[:, kernels.STRETCH]
        self.statistics = np.full((n, kernels.N_STATISTICS), np.nan)
        self.parts = np.zeros((n, m), dtype=np.int8)
        self.is_lock_out = np.zeros(n, dtype=bool)
        self.is_start = np.zeros(n, dtype=bool)
        self.events: list[EpochEvent] = []
        self.has_refused = False
        self.can_start = spans_directions(self.body)
        if not self.can_start and measured.n_epochs:
            self._say(
                0, "start", "", math.nan, math.nan,
                "The attitude filter cannot start: the antennas stand on one line, about which no turn is "
                "seen.",
            )  # fmt: skip

    def _set_limits(self, r_max):
        from scipy.stats import chi2, ncx2, norm

        settings, kernels = self.settings, self.kernels
        alpha = settings.significance
        degrees = np.arange(1, max(r_max, 3) + 1)
        local = norm.isf(0.5 * alpha)
        strict = chi2.isf(alpha, degrees)
        equal_power = strict
        if settings.global_test == "b_method":
            shift = (local + norm.ppf(settings.power)) ** 2
            equal_power = ncx2.ppf(1.0 - settings.power, degrees, shift)
        # Of each number of degrees of freedom, from none on.
        self.limits = np.zeros((3, len(degrees) + 1))
        self.limits[kernels.GLOBAL, 1:] = equal_power
        self.limits[kernels.STRICT, 1:] = strict
        self.limits[kernels.OF_VECTOR, 1:] = strict
        if settings.process == "wang":
            noise = np.radians(settings.rate_step_dps) ** 2
        else:
            noise = np.radians(1.0) ** 2 * np.asarray(settings.rate_noise_dps2_per_s, dtype=float)
        self.numbers = np.array([*noise, 1e9 * settings.max_prediction_s, local])
        self.switches = np.zeros(5, dtype=np.int64)
        self.switches[kernels.IS_GATED] = settings.gate
        self.switches[kernels.MAX_PASSES] = settings.max_passes
        self.switches[kernels.LOCK_OUT_EPOCHS] = settings.lock_out_epochs
        self.switches[kernels.HAS_RECOVERY] = settings.recovery != "none"
        self.switches[kernels.IS_PRINTED] = settings.process == "wang"

    def filter(self):
        """Run the filter over all epochs, in blocks of bounded memory."""
        m = len(self.body)
        size = max(1, BLOCK_NUMBERS // (9 * m * max(m - 1, 1)))
        for first in range(0, len(self.time_ns), size):
            block = slice(first, min(first + size, len(self.time_ns)))
            self._filter_block(block, self._rows(block))

    def _rows(self, block):
        """White rows of a range of the merged epochs."""
        inside = np.searchsorted(self.of_epoch, [block.start, block.stop])
        found = white_rows(self.measured, slice(*inside), self.is_given)
        if self.output is None:
            return found
        n, at = block.stop - block.start, self.of_epoch[slice(*inside)] - block.start
        spread = WhiteRows(*(np.zeros((n, *part.shape[1:]), dtype=part.dtype) for part in found))
        for whole, part in zip(spread, found, strict=True):
            whole[at] = part
        return spread

    def _filter_block(self, block, white):
        kernels, state, carried = self.kernels, self.state, self.state.carried
        self.parts[block] = np.where(white.is_seen, kernels.USED, kernels.ABSENT)
        self.epochs[block, kernels.N_ROWS] = white.n_rows
        n = block.stop - block.start
        events = np.zeros((n * (len(self.body) + 2), 5))
        sensitivity = self.sensitivity[block] if self.is_smoother else np.zeros((n, 6, self.n_consider))
        kept = block if self.settings.keep_predictions else slice(0, 0)
        outputs = (
            self.pose[block], self.cov[block], sensitivity, self.before_pose[kept], self.before_cov[kept],
            self.marks[block], self.statistics[block], self.parts[block], events,
        )  # fmt: skip
        carried[kernels.N_EVENTS] = 0
        k = 0
        while True:
            k, why = self._kernel(k, self.epochs[block], white, outputs)
            if why == kernels.DONE:
                break
            if why == kernels.NEEDS_START:
                at = self._start(block.start, k, white)
            else:
                at = self._recover(block.start, k, white, events)
            if at >= 0:
                epoch = block.start + at
                self.status[epoch] = FilterStatus.UPDATED
                self.is_start[epoch] = True
                self.segment[epoch] = carried[kernels.SEGMENT]
                self.statistics[epoch] = np.nan
                self.pose[epoch] = state.pose
                self.cov[epoch] = state.cov
                sensitivity[at] = state.sensitivity
                if self.settings.keep_predictions:
                    self.before_pose[epoch] = self.before_cov[epoch] = np.nan
                k = at + 1
            elif why == kernels.NEEDS_START:
                k += 1
        n_events = carried[kernels.N_EVENTS]
        self._tell(block.start, events[:n_events])
        if self.n_consider and not self.is_smoother:
            self.cov[block] += sensitivity @ self.consider @ np.swapaxes(sensitivity, 1, 2)

    def _kernel(self, k, epochs, white, outputs):
        """Run the compiled loop from epoch k of a block on."""
        state = self.state
        return self.kernels.filter_epochs(
            k, epochs, white.rows, white.y, self.body, self.consider, self.n_consider, self.numbers,
            self.switches, self.limits, state.carried, state.pose, state.cov, state.sensitivity, *outputs,
        )  # fmt: skip

    def _fit(self, epoch, rows, y):
        """Least-squares attitude of one epoch that passes its test, or None; and whether it is determined."""
        from scipy.stats import chi2

        limit = chi2.isf(self.settings.significance, np.arange(1, len(y) + 2))
        fit = fit_rows(rows, y, self.body, self.consider)
        if fit is None:
            return None, False, None
        if not self.settings.gate or fit.dof == 0 or fit.chi2 <= limit[fit.dof - 1]:
            return fit, True, None
        seen = np.flatnonzero(self.parts[epoch] != self.kernels.ABSENT)
        best, without = None, None
        if len(seen) > 3:
            for antenna in seen:
                left, short = rows.copy(), y.copy()
                at = np.int64(3 * antenna)
                count = self.kernels.eliminate(left, short, len(y), rows.shape[1], at, self.kernels.BLOCK)
                trial = fit_rows(left[:count], short[:count], self.body, self.consider)
                if trial is None or trial.dof == 0 or trial.chi2 > limit[trial.dof - 1]:
                    continue
                if best is None or trial.chi2 < best.chi2:
                    best, without = trial, int(antenna)
        if best is None:
            if not self.has_refused:
                self._say(
                    epoch, "start", "", fit.chi2, limit[fit.dof - 1],
                    "The attitude filter did not start at this epoch: the vectors contradict the body "
                    f"coordinates (chi-square {fit.chi2:.1f}, limit {limit[fit.dof - 1]:.1f}).",
                )  # fmt: skip
            self.has_refused = True
        else:
            self._say(
                epoch, "excluded", self._name(without), fit.chi2, limit[fit.dof - 1],
                f"Antenna {self._name(without)} was left out of the least-squares attitude from which the "
                f"filter starts: with it chi-square is {fit.chi2:.1f}, above {limit[fit.dof - 1]:.1f}.",
            )  # fmt: skip
        return best, True, without

    def _set(self, epoch, fit, without):
        """Take a least-squares attitude as the state, the rate unknown."""
        kernels, state = self.kernels, self.state
        state.pose[:3], state.pose[3] = fit.rot_ned_from_body, 0.0
        state.cov[:] = 0.0
        state.cov[:3, :3] = fit.cov_body_rad2
        state.cov[3:, 3:] = np.eye(3) * math.radians(self.settings.initial_rate_sd_dps) ** 2
        state.sensitivity[:] = 0.0
        if self.n_consider:
            state.sensitivity[:3] = fit.sensitivity
        self._begin(epoch)
        self.parts[epoch, self.parts[epoch] == kernels.REJECTED] = kernels.USED
        if without is not None:
            self.parts[epoch, without] = kernels.REJECTED
        state.carried[kernels.UPDATE_TIME] = self.time_ns[epoch]

    def _begin(self, epoch):
        """Count a new segment that begins at an epoch."""
        kernels, carried = self.kernels, self.state.carried
        carried[kernels.HAS_STATE] = 1
        carried[kernels.N_REJECTED] = 0
        carried[kernels.IS_PREDICTED] = 0
        carried[kernels.NO_RECOVERY] = 0
        carried[kernels.STATE_TIME] = self.time_ns[epoch]
        carried[kernels.SEGMENT] += 1
        self.state.pending = ()
        self.has_refused = False

    def _start(self, start, k, white):
        """Start the filter at an epoch, by its own vectors or with those before; -1 if it could not."""
        state, settings = self.state, self.settings
        if not self.can_start:
            return -1
        epoch = start + k
        rows, y = white.rows[k, : white.n_rows[k]], white.y[k, : white.n_rows[k]]
        fit, is_determined, without = self._fit(epoch, rows, y)
        if fit is not None:
            self._set(epoch, fit, without)
            self._say(
                epoch, "start", "", fit.chi2, math.nan,
                "The attitude filter started by least squares from "
                f"{np.count_nonzero(self.parts[epoch] == self.kernels.USED)} antennas.",
            )  # fmt: skip
            return k
        if is_determined:
            return -1
        since = self.time_ns[epoch] - int(1e9 * settings.max_prediction_s)
        pending = [part for part in state.pending if part[0] >= since]
        pending = [*pending[1 - PENDING_EPOCHS :], (int(self.time_ns[epoch]), rows.copy(), y.copy())]
        state.pending = tuple(pending)
        return k if self._start_from_several(epoch) else -1

    def _start_from_several(self, epoch):
        """Start by filtering epochs that have no full attitude each, from the one they have together."""
        kernels, state, pending = self.kernels, self.state, self.state.pending
        m = len(self.body)
        legs = []
        for _, rows, _ in pending:
            seen = np.abs(rows).reshape(len(rows), m, 3).max((0, 2)) > 0.0
            legs.append(self.body[seen] - self.body[seen][0])
        legs = np.concatenate(legs)
        size = np.linalg.svd(legs, compute_uv=False)
        if not (len(size) > 1 and size[1] > 1e-6 * size[0]):
            return False
        guess = fit_rows(
            np.concatenate([part[1] for part in pending]), np.concatenate([part[2] for part in pending]),
            self.body, self.consider,
        )  # fmt: skip
        if guess is None:
            return False
        earlier = state.copy()
        rate_variance = math.radians(self.settings.initial_rate_sd_dps) ** 2
        state.pose[:3], state.pose[3] = guess.rot_ned_from_body, 0.0
        state.cov[:] = np.diag([WIDE_RAD**2] * 3 + [rate_variance] * 3)
        state.sensitivity[:] = 0.0
        carried = state.carried
        carried[kernels.HAS_STATE], carried[kernels.IS_PREDICTED] = 1, 0
        carried[kernels.NO_RECOVERY], carried[kernels.N_REJECTED] = 0, 0
        carried[kernels.STATE_TIME] = carried[kernels.UPDATE_TIME] = pending[0][0]
        n, r_max = len(pending), max(3 * (m - 1), 1)
        white = WhiteRows(
            np.array([len(part[2]) for part in pending], dtype=np.int64),
            np.zeros((n, r_max, 3 * m)), np.zeros((n, r_max)), np.ones((n, m), dtype=bool),
        )  # fmt: skip
        for j, (_, rows, y) in enumerate(pending):
            white.rows[j, : len(y)], white.y[j, : len(y)] = rows, y
        epochs = np.ones((n, 3), dtype=np.int64)
        epochs[:, kernels.TIME] = [part[0] for part in pending]
        epochs[:, kernels.N_ROWS] = white.n_rows
        parts = np.full((n, m), kernels.USED, dtype=np.int8)
        outputs = (
            np.zeros((n, 4, 3)), np.zeros((n, 6, 6)), np.zeros((n, 6, self.n_consider)),
            np.zeros((0, 4, 3)), np.zeros((0, 6, 6)), np.zeros((n, 2), dtype=np.int64),
            np.zeros((n, kernels.N_STATISTICS)), parts, np.zeros((0, 5)),
        )  # fmt: skip
        self._kernel(0, epochs, white, outputs)
        spread = math.sqrt(np.trace(state.cov[:3, :3]))
        if np.any(parts == kernels.REJECTED) or spread > math.radians(self.settings.max_sd_deg):
            for name in ("pose", "cov", "sensitivity", "carried"):
                getattr(state, name)[:] = getattr(earlier, name)
            return False
        self._begin(epoch)
        state.carried[kernels.UPDATE_TIME] = self.time_ns[epoch]
        self._say(
            epoch, "start", "", math.nan, math.nan,
            f"The attitude filter started from the vectors of {n} epochs, none of which has a full attitude.",
        )  # fmt: skip
        return True

    def _recover(self, start, k, white, events):
        """Get a locked-out filter going again; the epoch at which it was started anew, -1 where it was not.

        The smoother, which may use what comes later, goes back to the first of the rejected epochs.
        """
        kernels, settings, state = self.kernels, self.settings, self.state
        carried, epoch = state.carried, start + k
        n_rejected = int(carried[kernels.N_REJECTED]) + 1
        run = np.flatnonzero(white.n_rows[: k + 1])[-n_rejected:]
        self.is_lock_out[start + run] = True
        if n_rejected == settings.lock_out_epochs:
            self._say(
                epoch, "lock-out", "", n_rejected, settings.lock_out_epochs,
                f"The attitude filter is locked out: its prediction rejected the vectors of {n_rejected} "
                "epochs in a row.",
            )  # fmt: skip
        is_determined = False
        if settings.recovery == "restart":
            for at in run.tolist() if self.is_smoother else [k]:
                rows, y = white.rows[at, : white.n_rows[at]], white.y[at, : white.n_rows[at]]
                fit, is_determined, without = self._fit(start + at, rows, y)
                if fit is None:
                    continue
                again = slice(start + at, epoch + 1)
                self.parts[again] = np.where(white.is_seen[at : k + 1], kernels.USED, kernels.ABSENT)
                self.is_lock_out[again] = self.is_lock_out[again] & (not self.is_smoother)
                carried[kernels.N_EVENTS] = np.count_nonzero(events[: carried[kernels.N_EVENTS], 0] < at)
                self._set(start + at, fit, without)
                self._say(
                    start + at, "restart", "", fit.chi2, math.nan,
                    "The attitude filter was started anew by least squares after its lock-out.",
                )  # fmt: skip
                return at
        if not is_determined:
            # As if the rate had wandered that far since the last epoch that was taken.
            since = 1e-9 * (self.time_ns[epoch] - carried[kernels.UPDATE_TIME])
            variance = math.radians(settings.initial_rate_sd_dps) ** 2
            step = np.array([[since * since / 3.0, since / 2.0], [since / 2.0, 1.0]]) * variance
            state.cov += np.kron(step, np.eye(3))
            self._begin(epoch)
            self.is_start[epoch] = True
            self._say(
                epoch, "widened", "", n_rejected, settings.lock_out_epochs,
                "The covariance of the attitude filter was widened after its lock-out, as if the rate had "
                f"changed by {settings.initial_rate_sd_dps:g} deg/s in {since:.1f} s.",
            )  # fmt: skip
        carried[kernels.IS_PREDICTED] = 1
        carried[kernels.NO_RECOVERY] = 1
        return -1

    def _tell(self, start, events):
        """Spell out the events of the compiled loop."""
        kernels = self.kernels
        for k, kind, antenna, statistic, limit in events.tolist():
            epoch = start + int(k)
            if kind == kernels.E_REJECTED:
                name = self._name(int(antenna))
                self._say(
                    epoch, "outlier", name, statistic, limit,
                    f"Antenna {name} was left out of the attitude filter at this epoch: the test of its "
                    f"vector against the prediction gives {statistic:.1f}, the largest of all "
                    f"(limit {limit:.1f}).",
                )  # fmt: skip
            elif kind == kernels.E_EPOCH_REJECTED:
                self._say(
                    epoch, "rejected", "", statistic, limit,
                    "The whole epoch was left out of the attitude filter: its vectors contradict the "
                    f"prediction (chi-square {statistic:.1f}, limit {limit:.1f}).",
                )  # fmt: skip
            else:
                self._say(
                    epoch, "gap", "", statistic, limit,
                    f"The attitude filter had no update for {statistic:.1f} s, longer than it may predict "
                    f"({limit:.1f} s); it starts anew at the next full attitude.",
                )  # fmt: skip

    def _say(self, epoch, kind, antenna, statistic, limit, text):
        time = int(self.time_ns[epoch])
        self.events.append(EpochEvent(time, kind, "", antenna, float(statistic), float(limit), text))

    def _name(self, antenna):
        names = self.measured.names
        return names[antenna] if antenna < len(names) else f"number {antenna + 1}"

    def smooth(self):
        """Smooth the filtered states in place, and predict backward from the start of every segment."""
        self.kernels.smooth_epochs(
            self.epochs, self.numbers, self.switches[self.kernels.IS_PRINTED], self.n_consider, self.marks,
            self.pose, self.cov, self.sensitivity,
        )  # fmt: skip
        if self.n_consider:
            self.cov += self.sensitivity @ self.consider @ np.swapaxes(self.sensitivity, 1, 2)

        self._predict_backward()

    def _predict_backward(self):
        """Attitudes before the filter started, where those after it say more than those before."""
        starts = np.flatnonzero((self.segment >= 0) & (np.diff(self.segment, prepend=-1) != 0))
        sign = np.array([1.0, 1.0, 1.0, -1.0, -1.0, -1.0])
        work = [np.empty((6, 6)) for _ in range(4)]
        is_printed = self.switches[self.kernels.IS_PRINTED]
        nothing = np.empty((6, 0))
        longest = self.numbers[self.kernels.MAX_PREDICTION_NS]
        for start in starts.tolist():
            # In reversed time the rates have the other sign, and so has their covariance with the rotation.
            pose = self.pose[start].copy()
            pose[3] *= -1.0
            cov = self.cov[start] * np.outer(sign, sign)
            for k in range(start - 1, -1, -1):
                if self.time_ns[start] - self.time_ns[k] > longest or self.status[k] == FilterStatus.UPDATED:
                    break
                self.kernels.predict(
                    1e-9 * (self.time_ns[k + 1] - self.time_ns[k]), self.numbers, is_printed,
                    bool(is_printed == 0 or self.epochs[k + 1, self.kernels.IS_EPOCH] == 1),
                    pose, cov, nothing, 0, *work,
                )  # fmt: skip
                spread = np.trace(self.cov[k, :3, :3])
                if self.status[k] == FilterStatus.NONE or np.trace(cov[:3, :3]) < spread:
                    self.status[k], self.segment[k] = FilterStatus.PREDICTED, self.segment[start]
                    self.pose[k], self.cov[k] = pose, cov * np.outer(sign, sign)
                    self.pose[k, 3] *= -1.0

    def result(self):
        """What was asked for, with angles."""
        kernels = self.kernels
        pick = slice(None) if self.output is None else self.output
        rot, rate, cov = self.pose[pick, :3], self.pose[pick, 3], self.cov[pick]
        status = self.status[pick].astype(np.uint8)
        with np.errstate(invalid="ignore"):
            is_vague = ~(np.einsum("nii->n", cov[:, :3, :3]) <= math.radians(self.settings.max_sd_deg) ** 2)
        is_vague |= status == FilterStatus.NONE
        status[is_vague] = FilterStatus.NONE
        rot[is_vague], rate[is_vague], cov[is_vague] = np.nan, np.nan, np.nan
        heading, pitch, roll = heading_pitch_roll(rot)
        cov_angles = np.full((len(rot), 3, 3), np.nan)
        good = np.flatnonzero(~is_vague)
        cov_ned = rot[good] @ cov[good, :3, :3] @ np.swapaxes(rot[good], 1, 2)
        cov_angles[good] = angle_covariance(rot[good], cov_ned)
        statistics = self.statistics[pick]
        keeps = self.settings.keep_predictions
        dof = statistics[:, kernels.DOF]
        return FilteredAttitude(
            self.time_ns[pick], status, rot, rate, cov, heading, pitch, roll, cov_angles,
            statistics[:, kernels.CHI2], statistics[:, kernels.CHI2_LIMIT],
            np.where(np.isnan(dof), 0, dof).astype(np.int64),
            statistics[:, kernels.LOCAL], statistics[:, kernels.VECTOR],
            self.parts[pick] == kernels.USED, self.parts[pick] == kernels.REJECTED,
            self.is_lock_out[pick], self.is_start[pick],
            np.where(is_vague, -1, self.segment[pick]),
            tuple(sorted(self.events, key=lambda event: event.time_ns)),
            self.settings,
            self.before_pose[pick, :3] if keeps else None,
            self.before_pose[pick, 3] if keeps else None,
            self.before_cov[pick] if keeps else None,
            self.state if self.settings.direction == "forward" else None,
        )  # fmt: skip
