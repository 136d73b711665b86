"""Compiled state of simulated tracking channels: lock, ambiguity, slips, half cycles, multipath memory."""

import math

import numpy as np

from .jit import kernel

SLIP = 1
HALF_CYCLE = 2

# Columns of a channel's state.
(
    LAST_S, ACQUIRED_S, IS_LOCKED, INTEGER, HALF, HALF_UNTIL_S, SLIPPED, CODE_GM, PHASE_GM, GM_S,
) = range(10)  # fmt: skip
N_STATE = 10


@kernel
def track_channels(
    channel, time_s, longest_step_s, cn0, cn0_acquire, cn0_lose, code_wait_s, phase_wait_s,
    slip_rate_hz, slip_cycles, slip_flag_share, half_cycle_s, half_cycle_share, is_dead, forced_slip,
    normal, uniform, code_gm_sd, phase_gm_sd, gm_tau_s, start_s,
    state, has_code, has_phase, integer, half, slipped, lli, code_gm, phase_gm,
):  # fmt: skip
    """Step every channel through its rows, epoch after epoch; ``state`` (n_channels, N_STATE) is carried.

    A channel that was in view at the very start is locked already. Random numbers come as columns:
    ``normal`` (code, phase memory), ``uniform`` (slip, its size, its flag, first integer, half cycle).
    """
    for r in range(channel.shape[0]):
        s = state[channel[r]]
        t = time_s[r]
        # Multipath of the channel goes on whether it is tracked or not.
        if math.isnan(s[GM_S]):
            s[CODE_GM] = code_gm_sd[r] * normal[r, 0]
            s[PHASE_GM] = phase_gm_sd[r] * normal[r, 1]
        else:
            a = math.exp(-(t - s[GM_S]) / gm_tau_s[r])
            b = math.sqrt(1.0 - a * a)
            s[CODE_GM] = a * s[CODE_GM] + b * code_gm_sd[r] * normal[r, 0]
            s[PHASE_GM] = a * s[PHASE_GM] + b * phase_gm_sd[r] * normal[r, 1]
        s[GM_S] = t
        code_gm[r] = s[CODE_GM]
        phase_gm[r] = s[PHASE_GM]
        has_code[r] = 0
        has_phase[r] = 0
        lli[r] = 0
        integer[r] = 0.0
        half[r] = 0.0
        slipped[r] = 0.0
        is_missed = t - s[LAST_S] > longest_step_s
        s_last = s[LAST_S]
        s[LAST_S] = t
        if is_dead[r] != 0:
            s[IS_LOCKED] = 0.0
            s[ACQUIRED_S] = np.nan
            continue
        if is_missed or (s[IS_LOCKED] != 0.0 and cn0[r] < cn0_lose):
            s[IS_LOCKED] = 0.0
            s[ACQUIRED_S] = np.nan
        if math.isnan(s[ACQUIRED_S]):
            if cn0[r] < cn0_acquire:
                continue
            # What is in view at the start has been tracked before.
            is_first = math.isnan(s_last) and t - start_s < 0.5 * longest_step_s
            s[ACQUIRED_S] = t - (1e9 if is_first else 0.0)
        elif cn0[r] < cn0_lose:
            s[ACQUIRED_S] = np.nan
            continue
        waited = t - s[ACQUIRED_S]
        if waited < code_wait_s:
            continue
        has_code[r] = 1
        if waited < phase_wait_s:
            continue
        is_new = s[IS_LOCKED] == 0.0
        if is_new:
            s[IS_LOCKED] = 1.0
            s[INTEGER] = math.floor(uniform[r, 3] * 2_000_001.0) - 1_000_000.0
            s[SLIPPED] = 0.0
            is_half = half_cycle_s > 0.0 and waited < 1e8
            s[HALF] = 0.5 if is_half and uniform[r, 4] < half_cycle_share else 0.0
            s[HALF_UNTIL_S] = t + half_cycle_s if is_half else t - 1.0
            lli[r] = SLIP if waited < 1e8 else 0
        elif uniform[r, 0] < slip_rate_hz * (t - s_last):
            size = 1.0 + math.floor(abs(2.0 * uniform[r, 1] - 1.0) * slip_cycles)
            s[SLIPPED] += min(size, slip_cycles) * (1.0 if uniform[r, 1] < 0.5 else -1.0)
            if uniform[r, 2] < slip_flag_share:
                lli[r] |= SLIP
        if not is_new and forced_slip[r] != 0.0:
            s[SLIPPED] += forced_slip[r]
        if t < s[HALF_UNTIL_S]:
            lli[r] |= HALF_CYCLE
        elif s[HALF] != 0.0:
            # The receiver has found its half cycle and takes it off: a slip, and it says so.
            s[HALF] = 0.0
            lli[r] |= SLIP
        has_phase[r] = 1
        integer[r] = s[INTEGER]
        half[r] = s[HALF]
        slipped[r] = s[SLIPPED]
