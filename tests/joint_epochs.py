"""Epochs of rigid arrays, and the joint objective of integers by plain least squares.

Nothing here shares a line with the search: constants of satellites and clocks are columns of a design matrix,
the attitude is adjusted by damped Gauss-Newton steps from many starts, and candidates come from
rounding the phases at attitudes spread over the whole rotation group.
"""

import numpy as np
from scipy.spatial.transform import Rotation

from truenorth.ambiguity.array_model import ArrayEpoch

WAVELENGTHS_M = (0.190293673, 0.244210213)


def draw_sky(rng, n):
    """Directions in north, east, down, above 10 degrees."""
    azimuth, up = rng.uniform(0.0, 2.0 * np.pi, n), rng.uniform(0.2, 1.0, n)
    level = np.sqrt(1.0 - up**2)
    return np.column_stack([level * np.cos(azimuth), level * np.sin(azimuth), -up])


def draw_epoch(
    rng,
    body,
    n_satellites,
    *,
    n_groups=1,
    phase_sd_m=0.003,
    code_sd_m=0.3,
    missing=0.0,
    position_sd_m=0.0,
    is_weighted=True,
    rot=None,
    sky=None,
):
    """One epoch, its true integers and attitude; `missing` is the share of rows taken away."""
    body = np.asarray(body, dtype=float)
    m = len(body)
    sky = draw_sky(rng, n_satellites) if sky is None else sky
    rot = spread_rotations(1, rng.integers(2**31))[0] if rot is None else rot
    antenna = np.tile(np.arange(m), n_satellites * n_groups)
    satellite = np.repeat(np.arange(n_satellites * n_groups), m)
    group = satellite // n_satellites
    n = len(antenna)
    design = -sky[satellite % n_satellites]
    wavelength = np.array(WAVELENGTHS_M)[group]
    factor = rng.uniform(0.6, 1.7, n) if is_weighted else np.ones(n)
    sd, code_sd = phase_sd_m * factor, code_sd_m * factor
    place = (body + position_sd_m * rng.standard_normal((m, 3))) @ rot.T
    common = rng.uniform(-300.0, 300.0, n_satellites * n_groups)[satellite]
    clock = rng.uniform(-90.0, 90.0, (2, m, n_groups))
    integers = rng.integers(-50, 50, n)
    ideal = np.sum(design * place[antenna], axis=1) + common
    phase = ideal + clock[0][antenna, group] + wavelength * integers + sd * rng.standard_normal(n)
    code = ideal + clock[1][antenna, group] + code_sd * rng.standard_normal(n)
    kept = rng.random(n) >= missing
    code[rng.random(n) < missing] = np.nan
    rows = [a[kept] for a in (antenna, satellite, group, phase, code, design, wavelength, sd**2, code_sd**2)]
    rows[1] = np.unique(rows[1], return_inverse=True)[1]
    rows[2] = np.unique(rows[2], return_inverse=True)[1]
    return ArrayEpoch(*rows, body, position_sd_m), integers[kept], rot


def constants(epoch, used):
    """Columns of the satellite constants and of the clocks."""
    n = len(epoch.antenna)
    satellite = np.zeros((n, epoch.satellite.max() + 1))
    satellite[np.arange(n), epoch.satellite] = 1.0
    clock = np.zeros((n, epoch.n_antennas * (epoch.group.max() + 1)))
    clock[np.arange(n), epoch.antenna + epoch.n_antennas * epoch.group] = 1.0
    return np.hstack([satellite, clock])[used]


class Reference:
    """The adjustment of one epoch with the integers known."""

    def __init__(self, epoch, use_code=True, prior_rot=None, prior_weight=None):
        self.epoch = epoch
        self.has_phase = np.isfinite(epoch.phase_m)
        parts = [(self.has_phase, epoch.phase_m, epoch.phase_variance_m2)]
        if use_code and np.isfinite(epoch.code_m).any():
            parts.append((np.isfinite(epoch.code_m), epoch.code_m, epoch.code_variance_m2))
        self.y, self.project, self.rows = [], [], []
        for used, value, variance in parts:
            root = 1.0 / np.sqrt(variance[used])
            basis, singular, _ = np.linalg.svd(root[:, None] * constants(epoch, used), full_matrices=False)
            basis = basis[:, singular > 1e-9 * singular[0]]
            projector = (np.eye(len(root)) - basis @ basis.T) * root
            self.y.append(value[used])
            self.project.append(projector)
            self.rows.append(used)
        self.design = [p @ _by_antenna(epoch, used) for p, used in zip(self.project, self.rows, strict=True)]
        self.code_least = 0.0
        if len(parts) > 1:
            self.code_least = _rest(self.design[1], self.project[1] @ self.y[1])
        # Rows of everything, as functions of the nine elements of the attitude.
        self.by_place = np.vstack(self.design)
        if epoch.position_sd_m > 0.0:
            # Places deviate from R l by what the coordinates are off, turned: the same covariance.
            n, m = self.by_place.shape
            root = np.vstack([self.by_place, np.eye(m) / epoch.position_sd_m])
            basis = np.linalg.qr(root)[0]
            self.no_deviation = (np.eye(n + m) - basis @ basis.T)[:, :n]
        else:
            self.no_deviation = np.eye(len(self.by_place))
        by_place = self.by_place.reshape(len(self.by_place), -1, 3)
        by_rot = np.einsum("nar,ac->nrc", by_place, epoch.positions_body_m).reshape(len(by_place), 9)
        self.by_rot = self.no_deviation @ by_rot
        self.prior = np.zeros((0, 9))
        self.prior_y = np.zeros(0)
        if prior_rot is not None:
            values, axes = np.linalg.eigh(prior_weight)
            self.prior = np.kron((axes * np.sqrt(np.maximum(values, 0.0))).T, np.eye(3))
            self.prior_y = self.prior @ prior_rot.ravel()

    def whitened(self, integers):
        """Whitened observations less the integers, without the deviations of the places."""
        y = [self.project[0] @ (self.y[0] - (self.epoch.wavelength_m * integers)[self.rows[0]])]
        y += [p @ v for p, v in zip(self.project[1:], self.y[1:], strict=True)]
        return self.no_deviation @ np.concatenate(y)

    def free_cost(self, integers):
        """Least cost with the places free."""
        return _rest(self.no_deviation @ self.by_place, self.whitened(integers)) - self.code_least

    def costs(self, integers, starts):
        """Least costs of many sets of integers over all the starts, and their attitudes."""
        a = np.vstack([self.by_rot, self.prior])
        normal = a.T @ a
        y = np.array([np.concatenate([self.whitened(row), self.prior_y]) for row in integers])
        rhs = y @ a
        square = np.sum(y * y, axis=1) - self.code_least
        n, m = len(y), len(starts)
        rot = np.broadcast_to(starts, (n, m, 3, 3)).reshape(-1, 3, 3)
        rhs, square = np.repeat(rhs, m, axis=0), np.repeat(square, m)

        def evaluate(rot):
            x = rot.reshape(-1, 9)
            return square + np.sum((x @ normal - 2.0 * rhs) * x, axis=1)

        cost, damping = evaluate(rot), np.full(n * m, 1e-3)
        for _ in range(60):
            x = rot.reshape(-1, 9)
            # Columns: the change of the elements with a small rotation about each axis.
            jacobian = np.stack(
                [np.cross(np.eye(3)[k], rot, axisb=1, axisc=1).reshape(-1, 9) for k in range(3)], 2
            )
            weighted = np.einsum("ij,bjk->bik", normal, jacobian)
            h = np.einsum("bik,bil->bkl", jacobian, weighted)
            g = np.einsum("bik,bi->bk", jacobian, x @ normal - rhs)
            h = h + (damping * np.trace(h, axis1=1, axis2=2))[:, None, None] * np.eye(3)
            step = -np.linalg.solve(h, g[..., None])[..., 0]
            trial = Rotation.from_rotvec(step).as_matrix() @ rot
            reached = evaluate(trial)
            is_better = reached <= cost
            rot = np.where(is_better[:, None, None], trial, rot)
            done = np.abs(cost - reached).max() < 1e-11
            cost = np.where(is_better, reached, cost)
            damping = np.where(is_better, 0.1 * damping, 10.0 * damping).clip(1e-12, 1e3)
            if done:
                break
        best = cost.reshape(n, m).argmin(axis=1)
        return cost.reshape(n, m)[np.arange(n), best], rot.reshape(n, m, 3, 3)[np.arange(n), best]


def _rest(design, y):
    """Square sum of y that the design leaves."""
    return float(np.sum((y - design @ np.linalg.lstsq(design, y, rcond=1e-10)[0]) ** 2))


def _by_antenna(epoch, used):
    """Design of the places of all antennas, (rows, 3 antennas)."""
    n = len(epoch.antenna)
    design = np.zeros((n, epoch.n_antennas, 3))
    design[np.arange(n), epoch.antenna] = epoch.design_ned
    return design.reshape(n, -1)[used]


def spread_rotations(n, seed=0):
    """Rotations spread evenly at random over the group."""
    return Rotation.random(n, random_state=np.random.RandomState(seed)).as_matrix()


def closed_differences(epoch):
    """Rows outside a spanning tree, and the combination of phases (k, n) free of all constants for each."""
    combinations, rows = [], []
    n = len(epoch.antenna)
    of_satellite, of_clock = {}, {}
    todo = [i for i in range(n) if np.isfinite(epoch.phase_m[i])]
    while todo:
        for i in todo:
            s, t = epoch.satellite[i], (epoch.antenna[i], epoch.group[i])
            unit = np.eye(n)[i]
            if s in of_satellite and t in of_clock:
                rows.append(i)
                combinations.append(unit - of_satellite[s] - of_clock[t])
            elif s in of_satellite:
                of_clock[t] = unit - of_satellite[s]
            elif t in of_clock:
                of_satellite[s] = unit - of_clock[t]
            else:
                continue
            todo.remove(i)
            break
        else:
            of_clock[epoch.antenna[todo[0]], epoch.group[todo[0]]] = np.zeros(n)
    return np.array(rows), np.array(combinations).reshape(-1, n)


def reachable_integers(epoch, rotations, rows, combinations):
    """Distinct integers of the closed differences that rounding at any of the attitudes gives."""
    found = []
    wavelength = epoch.wavelength_m[rows]
    fixed = combinations @ np.nan_to_num(epoch.phase_m)
    for block in np.array_split(rotations, max(len(rotations) // 20_000, 1)):
        place = epoch.positions_body_m @ np.swapaxes(block, -1, -2)
        modelled = np.einsum("nk,bnk->bn", epoch.design_ned, place[:, epoch.antenna])
        found.append(np.unique(np.rint((fixed - modelled @ combinations.T) / wavelength), axis=0))
    return np.unique(np.concatenate(found), axis=0).astype(np.int64)


def same_integers(epoch, first, second):
    """Whether two sets of integers differ by constants of satellites and clocks only."""
    used = np.isfinite(epoch.phase_m)
    columns = constants(epoch, used)
    off = (first - second)[used].astype(float)
    return bool(np.abs(off - columns @ np.linalg.lstsq(columns, off)[0]).max(initial=0.0) < 1e-6)
