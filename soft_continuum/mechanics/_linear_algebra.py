# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Linear algebra of the solver: tridiagonal and small dense systems, in compiled scalar code.

Loops instead of whole arrays: numba compiles them in a fraction of the time.
"""

from math import sqrt

from soft_continuum.mechanics._compile import compiled

MAX_SWEEPS = 30  # of Jacobi's rotations; they converge within ten
PIVOT_TOLERANCE = 1e-12  # of the largest entry of a column: a smaller pivot is a zero


@compiled
def tridiagonal_solve(diagonal, off, columns, used):  # type: ignore[no-untyped-def]
    """
    Solve for all columns at once, in place; return the number of negative pivots.

    ``diagonal`` is left with the inverse pivots.
    """
    groups = diagonal.shape[0]
    negatives = 0
    inverse = 0.0
    for k in range(groups):
        if k > 0:
            factor = off[k - 1] * inverse
            diagonal[k] -= factor * off[k - 1]
            for c in range(used):
                columns[k, c] -= factor * columns[k - 1, c]
        pivot = diagonal[k] if diagonal[k] != 0.0 else 1e-30
        if pivot < 0.0:
            negatives += 1
        inverse = 1.0 / pivot
        diagonal[k] = inverse
    for c in range(used):
        columns[groups - 1, c] *= inverse
    for k in range(groups - 2, -1, -1):
        for c in range(used):
            columns[k, c] = (columns[k, c] - off[k] * columns[k + 1, c]) * diagonal[k]
    return negatives


@compiled
def small_solve(matrix, rhs, size):  # type: ignore[no-untyped-def]
    """
    Solve a small dense system in place by elimination with partial pivoting.

    Returns False where it is singular to rounding: two tendons that impose the same constraint.
    """
    for column in range(size):
        least = 0.0
        for row in range(size):
            least = max(least, PIVOT_TOLERANCE * abs(matrix[row, column]))
        pivot = column
        for row in range(column + 1, size):
            if abs(matrix[row, column]) > abs(matrix[pivot, column]):
                pivot = row
        if not abs(matrix[pivot, column]) > least:
            return False
        if pivot != column:
            for k in range(size):
                matrix[column, k], matrix[pivot, k] = matrix[pivot, k], matrix[column, k]
            rhs[column], rhs[pivot] = rhs[pivot], rhs[column]
        for row in range(column + 1, size):
            factor = matrix[row, column] / matrix[column, column]
            for k in range(column, size):
                matrix[row, k] -= factor * matrix[column, k]
            rhs[row] -= factor * rhs[column]
    for row in range(size - 1, -1, -1):
        total = rhs[row]
        for k in range(row + 1, size):
            total -= matrix[row, k] * rhs[k]
        rhs[row] = total / matrix[row, row]
    return True


@compiled
def negative_eigenvalues(matrix):  # type: ignore[no-untyped-def]
    """
    Count the negative eigenvalues of a small symmetric matrix; tiny ones count as zero.

    By Jacobi's rotations, in place (Golub and Van Loan, Matrix Computations, section 8.5).
    """
    size = matrix.shape[0]
    for _ in range(MAX_SWEEPS):
        off = 0.0
        largest = 0.0
        for p in range(size):
            largest = max(largest, abs(matrix[p, p]))
            for q in range(p):
                off = max(off, abs(matrix[p, q]))
        if off <= 1e-15 * max(largest, off):
            break
        for p in range(size):
            for q in range(p):
                if matrix[p, q] == 0.0:
                    continue
                slope = (matrix[q, q] - matrix[p, p]) / (2.0 * matrix[p, q])
                tangent = 1.0 / (abs(slope) + sqrt(1.0 + slope * slope))
                if slope < 0.0:
                    tangent = -tangent
                cosine = 1.0 / sqrt(1.0 + tangent * tangent)
                sine = tangent * cosine
                for k in range(size):
                    left, right = matrix[k, p], matrix[k, q]
                    matrix[k, p] = cosine * left - sine * right
                    matrix[k, q] = sine * left + cosine * right
                for k in range(size):
                    left, right = matrix[p, k], matrix[q, k]
                    matrix[p, k] = cosine * left - sine * right
                    matrix[q, k] = sine * left + cosine * right
    largest = 0.0
    for p in range(size):
        largest = max(largest, abs(matrix[p, p]))
    negatives = 0
    for p in range(size):
        if matrix[p, p] < -1e-12 * largest:
            negatives += 1
    return negatives
