"""LAMBDA against published numbers.

The three-dimensional example is that of de Jonge & Tiberius 1996 (LGR-Series 12); the six and
ten-dimensional ones are the vectors of RTKLIB's unit test (tomojitakasu/RTKLIB, test/utest/t_lambda.c).
"""

import itertools

import numpy as np
import pytest

from truenorth.ambiguity.lambda_ import decorrelate, integer_least_squares

FLOAT_3 = np.array([5.450, 3.100, 2.970])
COV_3 = np.array([[6.290, 5.978, 0.544], [5.978, 6.292, 2.340], [0.544, 2.340, 6.288]])

FLOAT_6 = np.array([1585184.171, -6716599.430, 3915742.905, 7627233.455, 9565990.879, 989457273.200])
COV_6 = np.full((6, 6), 0.112202)
np.fill_diagonal(COV_6, 0.227134)
COV_6[5, :] = COV_6[:, 5] = 0.103473
COV_6[5, 5] = 0.434339
BEST_6 = [
    [1585184, -6716599, 3915743, 7627234, 9565991, 989457273],
    [1585184, -6716600, 3915743, 7627233, 9565991, 989457273],
]

FLOAT_10 = np.array(
    [
        -13324172.755747,
        -10668894.713608,
        -7157225.010770,
        -6149367.974367,
        -7454133.571066,
        -5969200.494550,
        8336734.058423,
        6186974.084502,
        -17549093.883655,
        -13970158.922370,
    ]
)
_SHARED = np.eye(5) + np.ones((5, 5))
# Two frequencies of five double differences each: the same pattern three times, with the factors of
# L1, of both together and of L2. RTKLIB prints every element to 1e-6.
COV_10 = np.block(
    [
        [np.where(_SHARED == 2, 0.446320, 0.223160), np.where(_SHARED == 2, 0.572775, 0.286388)],
        [np.where(_SHARED == 2, 0.572775, 0.286388), np.where(_SHARED == 2, 0.735063, 0.367531)],
    ]
)
BEST_10 = [
    [-13324188, -10668901, -7157236, -6149379, -7454143, -5969220, 8336726, 6186960, -17549108, -13970171],
    [-13324188, -10668908, -7157236, -6149379, -7454143, -5969220, 8336717, 6186960, -17549108, -13970171],
]


def test_three_dimensional_example():
    found = integer_least_squares(FLOAT_3, COV_3)
    assert found.is_complete
    assert found.integers_cyc.tolist() == [[5, 3, 4], [6, 4, 4]]
    # Published to four decimals.
    assert found.cost == pytest.approx([0.2183, 0.3073], abs=5e-5)


def test_three_dimensional_example_by_brute_force():
    integers = np.array(list(itertools.product(range(-15, 26), range(-15, 26), range(-10, 16))))
    error = integers - FLOAT_3
    cost = np.einsum("ij,jk,ik->i", error, np.linalg.inv(COV_3), error)
    order = np.argsort(cost)[:10]
    found = integer_least_squares(FLOAT_3, COV_3, 10)
    assert found.integers_cyc.tolist() == integers[order].tolist()
    assert found.cost == pytest.approx(cost[order], rel=1e-9)


def test_three_dimensional_example_is_decorrelated():
    # De Jonge & Tiberius 1996: the decorrelated variances are 4.476, 1.146 and 0.626 in some order.
    variances = np.sort(np.diag(decorrelate(COV_3).cov_z_cyc2()))
    assert variances == pytest.approx([0.626, 1.146, 4.476], abs=5e-4)


@pytest.mark.parametrize(
    ("floats", "cov", "integers", "cost"),
    [
        (FLOAT_6, COV_6, BEST_6, [3.507984, 3.708456]),
        (FLOAT_10, COV_10, BEST_10, [1506.435789, 1612.811795]),
    ],
    ids=["6", "10"],
)
def test_vectors_of_rtklib(floats, cov, integers, cost):
    found = integer_least_squares(floats, cov)
    assert found.is_complete
    assert found.integers_cyc.tolist() == integers
    # RTKLIB's own test asks for 1e-4.
    assert found.cost == pytest.approx(cost, abs=1e-4)
