# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The solver's own numerics against NumPy's."""

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from soft_continuum.mechanics._linear_algebra import (
    back_substitute,
    condense,
    negative_eigenvalues,
)
from soft_continuum.mechanics.plane._assembly import turn


@given(st.integers(1, 20), st.integers(0, 2**32 - 1), st.floats(-8, 8), st.integers(0, 3))
def test_negative_eigenvalues_are_counted_as_lapack_finds_them(size, seed, decades, zeros):
    random = np.random.default_rng(seed)
    vectors, _ = np.linalg.qr(random.normal(size=(size, size)))
    values = random.normal(size=size)
    values[np.abs(values) < 1e-6] = 1.0
    values[:min(zeros, size - 1)] = 0.0
    matrix = 10.0**decades * (vectors * values) @ vectors.T
    matrix = (matrix + matrix.T) / 2.0
    assert negative_eigenvalues(matrix.copy(), size) == np.count_nonzero(values < 0.0)


@pytest.mark.parametrize(('matrix', 'count'), [
    ([[0.0]], 0), ([[-1.0]], 1), (np.zeros((3, 3)), 0), (np.diag([1e-30, -1e-30]), 1),
    ([[0.0, 1.0], [1.0, 0.0]], 1), (np.ones((4, 4)), 0), (-np.ones((4, 4)), 1),
    (np.diag([1.0, -1e-13]), 0), ([[1.0, 1e-300], [1e-300, -1.0]], 1),
])
def test_special_matrices(matrix, count):
    assert negative_eigenvalues(np.array(matrix, dtype=float), len(matrix)) == count


@pytest.mark.parametrize('half', [0, 1, 5, 20])
def test_a_band_is_solved_as_lapack_does(half):
    random = np.random.default_rng(half)
    matrix = random.normal(size=(12, 12))
    matrix = np.triu(np.tril(matrix + matrix.T, half), -half)
    matrix += np.diag(5.0 * (-1.0)**np.arange(12))
    band = np.array([[matrix[c + i, c] if c + i < 12 else 0.0 for i in range(half + 1)]
                     for c in range(12)])
    given_ = random.normal(size=(12, 3))
    columns, products = given_.copy(), np.empty((3, 3))
    negatives = condense(band, columns, 3, products)
    assert negatives == np.count_nonzero(np.linalg.eigvalsh(matrix) < 0.0)
    expected = np.linalg.solve(matrix, given_)
    assert products == pytest.approx(given_.T @ expected, rel=1e-9)
    back_substitute(band, columns, 2)
    assert columns[:, 2] == pytest.approx(expected[:, 2], rel=1e-9)


@given(st.floats(-1e5, 1e5) | st.integers(-40, 40).map(lambda k: k * np.pi / 4.0))
def test_cosines_and_sines_are_those_of_the_library_to_rounding(angle):
    cosine, sine = np.empty(1), np.empty(1)
    turn(np.array([angle]), cosine, sine)
    assert abs(cosine[0] - np.cos(angle)) < 2.3e-16
    assert abs(sine[0] - np.sin(angle)) < 2.3e-16


@pytest.mark.parametrize('angle', [np.nan, np.inf, -np.inf])
@pytest.mark.filterwarnings('ignore:invalid value')
def test_an_angle_that_is_not_finite_has_no_cosine(angle):
    cosine, sine = np.empty(1), np.empty(1)
    turn(np.array([angle]), cosine, sine)
    assert np.isnan([cosine, sine]).all()
