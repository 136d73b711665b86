"""Which double difference of this epoch is which of the last: integers carried across changes.

A row is the difference of a satellite and its group's reference satellite,

    N(sat, ref) = N(sat) - N(ref),      N(sat, new ref) = N(sat, ref) - N(new ref, ref),

so integers survive a change of the reference exactly as long as both satellites were there before.
"""

import numpy as np

__all__ = ["carry_matrix"]


def carry_matrix(old_key, old_reference, new_key, new_reference):
    """Matrix that carries double-difference ambiguities from one set of rows to another.

    Parameters
    ----------
    old_key : ndarray of int, shape (m,)
        Identity of each old row's satellite and signal.
    old_reference : ndarray of int, shape (m,), or None
        The same identity for the row's reference satellite. Without references a key stands for the
        whole double difference, and only rows with equal keys are carried.
    new_key, new_reference : ndarray of int, shape (n,), or None
        The same for the new rows.

    Returns
    -------
    matrix : ndarray of float64, shape (n, m)
        ``new = matrix @ old`` for the known rows; rows of zeros for the others.
    known : ndarray of bool, shape (n,)
        Rows that could be carried.
    """
    old_key = np.asarray(old_key)
    new_key = np.asarray(new_key)
    m, n = len(old_key), len(new_key)
    referenced = old_reference is not None and new_reference is not None
    same = m == n and np.array_equal(old_key, new_key)
    if same and (not referenced or np.array_equal(old_reference, new_reference)):
        return np.eye(n), np.ones(n, dtype=bool)
    matrix = np.zeros((n, m))
    known = np.zeros(n, dtype=bool)
    place = {int(key): i for i, key in enumerate(old_key)}
    if not referenced:
        for i, key in enumerate(new_key):
            j = place.get(int(key))
            if j is not None:
                matrix[i, j] = 1.0
                known[i] = True
        return matrix, known
    # Rows of the old set against each satellite's reference; the reference itself stands for zero.
    home = {int(key): int(ref) for key, ref in zip(old_key, old_reference, strict=True)}
    for ref in old_reference:
        home.setdefault(int(ref), int(ref))
    for i, (key, ref) in enumerate(zip(new_key, new_reference, strict=True)):
        key, ref = int(key), int(ref)
        if key not in home or ref not in home or home[key] != home[ref]:
            continue
        known[i] = True
        if key in place:
            matrix[i, place[key]] += 1.0
        if ref in place:
            matrix[i, place[ref]] -= 1.0
    return matrix, known
