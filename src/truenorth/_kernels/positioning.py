"""Compiled single-point position and velocity: one call over all epochs.

The equations are in `positioning.single_point`. Rows are satellites, grouped by ``epoch_start``;
every array is C-contiguous. Clocks are in metres. Gauss-Newton on the normal equations, solved by
Cholesky; after convergence a chi-square test, then removal of the largest normalised residual.
"""

import numpy as np

from .atmosphere import klobuchar_delay, saastamoinen_zenith, troposphere_mapping
from .jit import kernel

SPEED_OF_LIGHT_MPS = 299_792_458.0
EARTH_RATE_RADPS = 7.2921151467e-5
WGS84_A_M = 6_378_137.0
WGS84_E2 = 6.694379990141317e-3

# Clock groups; the first one present in an epoch is its reference.
N_GROUPS = 5
N_UNKNOWNS = 3 + N_GROUPS

# Codes of positioning.single_point.PointStatus; a test holds them equal.
OK = 0
NO_CODE = 1
NO_NAVIGATION = 2
TOO_FEW = 3
WEAK_GEOMETRY = 4
NOT_CONVERGED = 5
INCONSISTENT = 6
NO_DOPPLER = 7

# Columns of `given`: position and velocity of the satellite at transmission, ECEF of that time (NaN
# without ephemeris); code plus satellite clock and group delay; (f1/f)^2 or 0; noise factor; variance
# of the signal in space; ratio of received to sent frequency (NaN without Doppler).
SAT_POSITION, SAT_VELOCITY, RANGE, IONO_SCALE, NOISE_SCALE, SIGNAL_VAR, RATE = 0, 3, 6, 7, 8, 9, 10
N_GIVEN = 11

# Columns of `flag`, and what STATE holds.
STATE, USED, RATE_USED = range(3)
N_FLAGS = 3
UNUSABLE, CANDIDATE, REJECTED = range(3)

# Columns of `row`.
LOS, AZIMUTH, ELEVATION, RESIDUAL, VARIANCE, DELAY, DISTANCE, RATE_RESIDUAL = 0, 3, 4, 5, 6, 7, 8, 9
N_ROW = 10

# Entries of `settings`.
MASK, CODE_VAR, CODE_VAR_EL, IONO_SHARE, TROPO_SD = range(5)
RATE_VAR, RATE_VAR_EL, HUMIDITY, MAX_PDOP, MAX_REJECTED, IONO_APPLIED = range(5, 11)
N_SETTINGS = 11

# Columns of `epoch`: position; clock of the reference group, of all groups; DOPs (G, P, H, V, T);
# velocity and drift; the two square sums; the two 4 x 4 covariances.
POSITION, CLOCK, GROUP_CLOCK, DOPS, VELOCITY, CHI2, RATE_CHI2, COV, RATE_COV = 0, 3, 4, 9, 14, 18, 19, 20, 36
N_EPOCH = 52

# Columns of `count`.
STATUS, RATE_STATUS, N_USED, N_REJECTED, DOF, N_RATE_USED = range(6)
N_COUNTS = 6

_MIN_RADIUS_M, _MAX_RADIUS_M = 6.2e6, 4.5e7
"""Distances from the Earth's centre between which a position is taken for real."""
_MAX_ITERATIONS = 80
_STEP_M = 1e-4
"""Convergence: a step this small leaves less than a micrometre, the problem being nearly linear."""
_MOVED_M = 1e-3
"""The atmosphere is computed again after a move larger than this; it changes by 3e-4 of the move."""
_MASK_STEP_M = 1e4
"""Elevations decide only once the position is known better than this."""
_MASK_ITERATIONS = 10
"""After so many iterations the set of satellites above the mask is frozen, lest it toggle for ever."""
_LOST_VAR_M2 = 100.0**2
"""Variance of a code while the place is not yet on the Earth, so that gross errors can be found."""
_MIN_OUTLIER = 4.0
"""Normalised residuals up to this remove nothing: when many are somewhat large the weights are
wrong, not one satellite."""
_MIN_SINE = 0.05
"""Noise grows with 1/sin(elevation) down to 3 degrees."""


@kernel
def adjust(design, y, weight, m, n, inverse, step):
    """Weighted least squares: solve for ``step[:n]`` and turn ``y`` into the residuals.

    Rows of weight 0 take no part but get a residual. The covariance of the unknowns goes to
    ``inverse``. Returns the square sum of the weighted residuals (NaN when singular) and the row with
    the largest normalised residual (-1: none above `_MIN_OUTLIER`).
    """
    for i in range(n):
        for j in range(n):
            inverse[i, j] = 0.0
    for r in range(m):
        if weight[r] > 0.0:
            for i in range(n):
                wa = weight[r] * design[r, i]
                for j in range(n):
                    inverse[i, j] += wa * design[r, j]
    # Gauss-Jordan inversion in place; no pivoting, the matrix being positive definite.
    for i in range(n):
        step[i] = inverse[i, i]
    for k in range(n):
        pivot = inverse[k, k]
        # 1e-11 of the diagonal is what rounding leaves of a singular matrix.
        if not pivot > 1e-11 * step[k]:
            return np.nan, -1
        inverse[k, k] = 1.0
        for j in range(n):
            inverse[k, j] /= pivot
        for i in range(n):
            if i != k:
                factor = inverse[i, k]
                inverse[i, k] = 0.0
                for j in range(n):
                    inverse[i, j] -= factor * inverse[k, j]
    for i in range(n):
        step[i] = 0.0
    for r in range(m):
        if weight[r] > 0.0:
            for i in range(n):
                gain = 0.0
                for j in range(n):
                    gain += inverse[i, j] * design[r, j]
                step[i] += gain * weight[r] * y[r]
    chi2 = 0.0
    worst = -1
    largest = _MIN_OUTLIER**2
    for r in range(m):
        explained = 0.0
        for i in range(n):
            y[r] -= design[r, i] * step[i]
            for j in range(n):
                explained += design[r, i] * inverse[i, j] * design[r, j]
        if weight[r] > 0.0:
            square = weight[r] * y[r] * y[r]
            chi2 += square
            # Redundancy number: share of an error that its own residual shows.
            redundancy = 1.0 - weight[r] * explained
            if redundancy > 1e-3 and square > largest * redundancy:
                largest = square / redundancy
                worst = r
    return chi2, worst


@kernel
def local_directions(lo, hi, x, given, day_s, klobuchar, settings, row, up_ecef):
    """Azimuth, elevation, delay of the atmosphere and code variance of every row of an epoch."""
    # Geodetic position by Bowring's form, iterated twice: exact to a nanometre near the surface.
    p = np.sqrt(x[0] * x[0] + x[1] * x[1])
    flat = np.sqrt(1.0 - WGS84_E2)
    beta = np.arctan2(x[2], flat * p)
    lat = 0.0
    for _ in range(2):
        s, c = np.sin(beta), np.cos(beta)
        lat = np.arctan2(x[2] + WGS84_E2 / flat * WGS84_A_M * s * s * s, p - WGS84_E2 * WGS84_A_M * c * c * c)
        beta = np.arctan2(flat * np.sin(lat), np.cos(lat))
    lon = np.arctan2(x[1], x[0])
    sp, cp, sl, cl = np.sin(lat), np.cos(lat), np.sin(lon), np.cos(lon)
    height = p * cp + x[2] * sp - WGS84_A_M * np.sqrt(1.0 - WGS84_E2 * sp * sp)

    up_ecef[0], up_ecef[1], up_ecef[2] = cp * cl, cp * sl, sp
    zenith_m = saastamoinen_zenith(lat, height, settings[HUMIDITY])
    for k in range(lo, hi):
        ex, ey, ez = row[k, LOS], row[k, LOS + 1], row[k, LOS + 2]
        outward = cl * ex + sl * ey
        east = cl * ey - sl * ex
        north = cp * ez - sp * outward
        up = cp * outward + sp * ez
        azimuth = np.arctan2(east, north)
        elevation = np.arctan2(up, np.sqrt(east * east + north * north))
        row[k, AZIMUTH] = azimuth if azimuth >= 0.0 else azimuth + 2.0 * np.pi
        row[k, ELEVATION] = elevation
        iono_m = given[k, IONO_SCALE]
        if iono_m != 0.0:
            iono_m *= klobuchar_delay(klobuchar, lat, lon, azimuth, max(elevation, 0.0), day_s)
        mapping = troposphere_mapping(up)
        row[k, DELAY] = settings[IONO_APPLIED] * iono_m + zenith_m * mapping
        sine = max(up, _MIN_SINE)
        row[k, VARIANCE] = (
            (settings[CODE_VAR] + settings[CODE_VAR_EL] / (sine * sine)) * given[k, NOISE_SCALE]
            + given[k, SIGNAL_VAR]
            + (settings[IONO_SHARE] * iono_m) ** 2
            + (settings[TROPO_SD] * mapping) ** 2
        )


@kernel
def solve_positions(
    epoch_start, day_s, start, given, group, klobuchar, settings, chi2_limit, flag, row, epoch, count
):
    """Position, clocks and DOPs of all epochs.

    Parameters
    ----------
    epoch_start : int64 (n + 1,)
        Row offsets of the epochs.
    day_s : float64 (n,)
        Seconds of the GPS day.
    start : float64 (3,)
        First guess of the position; anything off the Earth means none.
    given : float64 (m, N_GIVEN)
    group : int64 (m,)
        Clock group.
    klobuchar : float64 (8,)
    settings : float64 (N_SETTINGS,)
    chi2_limit : float64 (most satellites of an epoch + 1,)
        By degrees of freedom.
    flag : uint8 (m, N_FLAGS)
        STATE `CANDIDATE` or `UNUSABLE`, and 0, on entry.
    row : float64 (m, N_ROW); epoch : float64 (n, N_EPOCH)
        Results, NaN on entry.
    count : int64 (n, N_COUNTS)
        Results, 0 on entry.
    """
    most = chi2_limit.shape[0]
    x = np.zeros(N_UNKNOWNS)
    column = np.zeros(N_GROUPS, np.int64)
    up_ecef = np.zeros(3)
    design = np.zeros((most, N_UNKNOWNS))
    y = np.zeros(most)
    weight = np.zeros(most)
    inverse = np.zeros((N_UNKNOWNS, N_UNKNOWNS))
    step = np.zeros(N_UNKNOWNS)
    guess = start.copy()
    for t in range(day_s.shape[0]):
        lo, hi = epoch_start[t], epoch_start[t + 1]
        m = hi - lo
        status = NOT_CONVERGED
        # First from the guess, if it lies on the Earth; if that fails, from the Earth's centre.
        is_warm = guess[0] * guess[0] + guess[1] * guess[1] + guess[2] * guess[2] > _MIN_RADIUS_M**2
        is_solved = False
        for attempt in range(2):
            if attempt == 0 and not is_warm:
                continue
            for i in range(N_UNKNOWNS):
                x[i] = guess[i] if i < 3 and attempt == 0 else 0.0
            for k in range(lo, hi):
                if flag[k, STATE] == REJECTED:
                    flag[k, STATE] = CANDIDATE
            count[t, N_REJECTED] = 0
            moved = np.inf
            last_step = 0.0 if attempt == 0 else np.inf
            since = 0
            status = NOT_CONVERGED
            for _ in range(_MAX_ITERATIONS):
                # Satellites, turned with the Earth while the signal travelled.
                for k in range(lo, hi):
                    theta, distance, dx, dy, dz = 0.0, 0.0, 0.0, 0.0, given[k, 2] - x[2]
                    for _ in range(3):
                        # cos and sin to third order; the angle is 10 microradians at most.
                        c = 1.0 - 0.5 * theta * theta
                        dx = c * given[k, 0] + theta * given[k, 1] - x[0]
                        dy = c * given[k, 1] - theta * given[k, 0] - x[1]
                        distance = np.sqrt(dx * dx + dy * dy + dz * dz)
                        theta = EARTH_RATE_RADPS / SPEED_OF_LIGHT_MPS * distance
                    row[k, LOS] = dx / distance
                    row[k, LOS + 1] = dy / distance
                    row[k, LOS + 2] = dz / distance
                    row[k, DISTANCE] = distance
                radius2 = x[0] * x[0] + x[1] * x[1] + x[2] * x[2]
                on_earth = _MIN_RADIUS_M**2 < radius2 < _MAX_RADIUS_M**2
                is_masked = on_earth and last_step < _MASK_STEP_M
                if on_earth and moved > _MOVED_M:
                    local_directions(lo, hi, x, given, day_s[t], klobuchar, settings, row, up_ecef)
                    moved = 0.0

                # One column for each clock group that is present.
                n_used = 0
                for g in range(N_GROUPS):
                    column[g] = -1
                for k in range(lo, hi):
                    if since < _MASK_ITERATIONS or not is_masked:
                        is_low = is_masked and row[k, ELEVATION] < settings[MASK]
                        flag[k, USED] = flag[k, STATE] == CANDIDATE and not is_low
                    if flag[k, USED]:
                        n_used += 1
                        column[group[k]] = 0
                n = np.int64(3)
                for g in range(N_GROUPS):
                    if column[g] == 0:
                        column[g] = n
                        n += 1
                count[t, N_USED] = n_used
                if n_used < n or n == 3:
                    status = TOO_FEW
                    break

                for r in range(m):
                    k = lo + r
                    for i in range(n):
                        design[r, i] = -row[k, LOS + i] if i < 3 else 0.0
                    if not on_earth:
                        moved = np.inf
                        row[k, DELAY] = 0.0
                        row[k, VARIANCE] = _LOST_VAR_M2
                    y[r] = np.nan
                    if column[group[k]] >= 0:
                        design[r, column[group[k]]] = 1.0
                        y[r] = given[k, RANGE] - row[k, DISTANCE] - row[k, DELAY] - x[3 + group[k]]
                    weight[r] = 1.0 / row[k, VARIANCE] if flag[k, USED] else 0.0
                chi2, worst = adjust(design, y, weight, m, n, inverse, step)
                if not chi2 < np.inf:
                    status = WEAK_GEOMETRY
                    break
                for i in range(3):
                    x[i] += step[i]
                for g in range(N_GROUPS):
                    if column[g] >= 0:
                        x[3 + g] += step[column[g]]
                last_step = np.sqrt(step[0] * step[0] + step[1] * step[1] + step[2] * step[2])
                moved += last_step
                since += 1
                if last_step > _STEP_M or (on_earth and not is_masked):
                    continue

                dof = n_used - n
                is_good = dof < 1 or chi2 <= chi2_limit[dof]
                # With one redundant satellite all normalised residuals are alike: detected, not located.
                if is_good or dof < 2 or count[t, N_REJECTED] >= settings[MAX_REJECTED] or worst < 0:
                    if on_earth:
                        is_solved = True
                        status = OK if is_good else INCONSISTENT
                        count[t, DOF] = dof
                        epoch[t, CHI2] = chi2
                        for r in range(m):
                            row[lo + r, RESIDUAL] = y[r]
                        for i in range(4):
                            for j in range(4):
                                epoch[t, COV + 4 * i + j] = inverse[i, j]
                    break
                flag[lo + worst, STATE] = REJECTED
                flag[lo + worst, USED] = 0
                count[t, N_REJECTED] += 1
                since = 0
            if status == OK:
                break

        if is_solved:
            # DOPs: the same design with unit weights.
            for r in range(m):
                weight[r] = 1.0 if weight[r] > 0.0 else 0.0
            adjust(design, y, weight, m, n, inverse, step)
            total = inverse[0, 0] + inverse[1, 1] + inverse[2, 2]
            vertical = 0.0
            for i in range(3):
                for j in range(3):
                    vertical += up_ecef[i] * inverse[i, j] * up_ecef[j]
            epoch[t, DOPS] = np.sqrt(total + inverse[3, 3])
            epoch[t, DOPS + 1] = np.sqrt(total)
            epoch[t, DOPS + 2] = np.sqrt(total - vertical)
            epoch[t, DOPS + 3] = np.sqrt(vertical)
            epoch[t, DOPS + 4] = np.sqrt(inverse[3, 3])
            if not epoch[t, DOPS + 1] <= settings[MAX_PDOP]:
                is_solved = False
                status = WEAK_GEOMETRY
        count[t, STATUS] = status
        if is_solved:
            for i in range(3):
                epoch[t, POSITION + i] = x[i]
                guess[i] = x[i]
            for g in range(N_GROUPS - 1, -1, -1):
                if column[g] >= 0:
                    epoch[t, GROUP_CLOCK + g] = x[3 + g]
                    epoch[t, CLOCK] = x[3 + g]
        else:
            for k in range(lo, hi):
                flag[k, USED] = 0
                for i in range(N_ROW):
                    row[k, i] = np.nan


@kernel
def solve_rates(epoch_start, given, settings, chi2_limit, flag, row, epoch, count):
    """Velocity and clock drift of all epochs at the positions of `solve_positions`, same arrays."""
    most = chi2_limit.shape[0]
    design = np.zeros((most, N_UNKNOWNS))
    y = np.zeros(most)
    weight = np.zeros(most)
    inverse = np.zeros((N_UNKNOWNS, N_UNKNOWNS))
    step = np.zeros(N_UNKNOWNS)
    n = np.int64(4)
    for t in range(count.shape[0]):
        count[t, RATE_STATUS] = count[t, STATUS]
        if np.isnan(epoch[t, POSITION]):
            continue
        lo, m = epoch_start[t], epoch_start[t + 1] - epoch_start[t]
        n_used = 0
        for r in range(m):
            k = lo + r
            ratio = given[k, RATE]
            # The satellite in the Earth's axes at reception; how fast it recedes in inertial space.
            theta = EARTH_RATE_RADPS / SPEED_OF_LIGHT_MPS * row[k, DISTANCE]
            ex, ey = row[k, LOS], row[k, LOS + 1]
            recede = (
                ex * (given[k, 3] + theta * given[k, 4])
                + ey * (given[k, 4] - theta * given[k, 3])
                + row[k, LOS + 2] * given[k, 5]
            )
            turn = ey * (given[k, 0] + theta * given[k, 1]) - ex * (given[k, 1] - theta * given[k, 0])
            shrink = 1.0 + (recede + EARTH_RATE_RADPS * turn) / SPEED_OF_LIGHT_MPS
            for i in range(3):
                design[r, i] = -row[k, LOS + i] / shrink
            design[r, 3] = ratio
            y[r] = SPEED_OF_LIGHT_MPS * (1.0 - ratio) - recede / shrink
            weight[r] = 0.0
            if flag[k, STATE] != UNUSABLE and ratio == ratio and row[k, ELEVATION] >= settings[MASK]:
                sine = max(np.sin(row[k, ELEVATION]), _MIN_SINE)
                variance = settings[RATE_VAR] + settings[RATE_VAR_EL] / (sine * sine)
                weight[r] = 1.0 / (variance * given[k, NOISE_SCALE])
                n_used += 1
        count[t, RATE_STATUS] = NO_DOPPLER if n_used == 0 else TOO_FEW
        for i in range(4):
            epoch[t, VELOCITY + i] = 0.0
        n_removed = 0
        while n_used >= n:
            chi2, worst = adjust(design, y, weight, m, n, inverse, step)
            if not chi2 < np.inf:
                count[t, RATE_STATUS] = WEAK_GEOMETRY
                break
            for i in range(4):
                epoch[t, VELOCITY + i] += step[i]
            dof = n_used - n
            is_good = dof < 1 or chi2 <= chi2_limit[dof]
            if is_good or dof < 2 or n_removed >= settings[MAX_REJECTED] or worst < 0:
                count[t, RATE_STATUS] = OK if is_good else INCONSISTENT
                count[t, N_RATE_USED] = n_used
                epoch[t, RATE_CHI2] = chi2
                for i in range(4):
                    for j in range(4):
                        epoch[t, RATE_COV + 4 * i + j] = inverse[i, j]
                for r in range(m):
                    row[lo + r, RATE_RESIDUAL] = y[r]
                    flag[lo + r, RATE_USED] = weight[r] > 0.0
                break
            # The residuals are the observations of the next adjustment, which adds to the velocity.
            weight[worst] = 0.0
            n_used -= 1
            n_removed += 1
        if np.isnan(epoch[t, RATE_CHI2]):
            for i in range(4):
                epoch[t, VELOCITY + i] = np.nan
