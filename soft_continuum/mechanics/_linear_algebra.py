# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Linear algebra of the solver: tridiagonal, band and small dense systems, in compiled scalar code.

Loops instead of whole arrays: numba compiles them in a fraction of the time.
"""

from soft_continuum.mechanics._compile import borrowing, compiled, inlined

ZERO = 1e-12  # of the largest entry: a smaller eigenvalue is a zero
PIVOT_TOLERANCE = 1e-12  # of the largest entry of a column: a smaller pivot is a zero
NO_TENSION = 1e-7  # N: rounding of a tension of zero


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


@borrowing
def negative_eigenvalues(matrix, size):  # type: ignore[no-untyped-def]
    """
    Count the negative eigenvalues of a small symmetric matrix, spoilt; tiny ones count as zero.

    By Sylvester's law of inertia: elimination with pivots of one row, or two, chosen among all
    that are left (Bunch and Parlett 1971, SIAM J. Numer. Anal. 8).
    """
    negatives, k, largest = 0, 0, 0.0
    while k < size:
        p, r, s = k, k, k
        for i in range(k, size):
            if abs(matrix[i, i]) > abs(matrix[p, p]):
                p = i
            for j in range(k, i):
                if abs(matrix[i, j]) > abs(matrix[r, s]) or r == s:
                    r, s = i, j
        beside = abs(matrix[r, s]) if r != s else 0.0
        if k == 0:
            largest = max(abs(matrix[p, p]), beside)
        if max(abs(matrix[p, p]), beside) <= ZERO * largest:
            break
        if abs(matrix[p, p]) >= 0.64 * beside:
            exchange(matrix, k, p, size)
            negatives += 1 if matrix[k, k] < 0.0 else 0
            for i in range(k + 1, size):
                factor = matrix[i, k] / matrix[k, k]
                for j in range(k + 1, size):
                    matrix[i, j] -= factor * matrix[k, j]
            k += 1
            continue
        exchange(matrix, k, s, size)  # s < r: it does not move r
        exchange(matrix, k + 1, r, size)
        negatives += 1  # one of two: the determinant is negative
        a, b, c = matrix[k, k], matrix[k, k + 1], matrix[k + 1, k + 1]
        determinant = a * c - b * b
        for i in range(k + 2, size):
            one = (c * matrix[i, k] - b * matrix[i, k + 1]) / determinant
            other = (a * matrix[i, k + 1] - b * matrix[i, k]) / determinant
            for j in range(k + 2, size):
                matrix[i, j] -= one * matrix[k, j] + other * matrix[k + 1, j]
        k += 2
    return negatives


@inlined
def exchange(matrix, one, other, size):  # type: ignore[no-untyped-def]
    """Exchange two rows of a matrix, and the same columns."""
    for k in range(size):
        matrix[one, k], matrix[other, k] = matrix[other, k], matrix[one, k]
    for k in range(size):
        matrix[k, one], matrix[k, other] = matrix[k, other], matrix[k, one]


@borrowing
def condense(band, columns, used, products):  # type: ignore[no-untyped-def]
    """
    Factor a symmetric band matrix A = L D L' in place; return its negative eigenvalues.

    band (rows, half + 1): entry (c + i, c) of A at [c, i]; becomes 1 / D, and L.  columns (rows,
    used), U, becomes L^-1 U; products (used, used): U' A^-1 U (Golub and Van Loan, 4.3.5).
    """
    rows, half, negatives = band.shape[0], band.shape[1] - 1, 0
    for a in range(used):
        for c in range(used):
            products[a, c] = 0.0
    for p in range(rows):
        pivot = band[p, 0] if band[p, 0] != 0.0 else 1e-300
        negatives += 1 if pivot < 0.0 else 0
        inverse, reach = 1.0 / pivot, min(half, rows - 1 - p)
        for j in range(1, reach + 1):
            factor = band[p, j] * inverse
            for i in range(j, reach + 1):
                band[p + j, i - j] -= factor * band[p, i]
            for c in range(used):
                columns[p + j, c] -= factor * columns[p, c]
        band[p, 0] = inverse
        for j in range(1, reach + 1):
            band[p, j] *= inverse
        for a in range(used):
            value = columns[p, a] * inverse
            if value != 0.0:
                for c in range(a, used):
                    products[a, c] += value * columns[p, c]
    for a in range(used):
        for c in range(a):
            products[a, c] = products[c, a]
    return negatives


@borrowing
def back_substitute(band, columns, c):  # type: ignore[no-untyped-def]
    """Solve D L' x = y for the column c, (rows,), in place; band as ``condense`` left it."""
    rows, half = band.shape[0], band.shape[1] - 1
    for p in range(rows - 1, -1, -1):
        value = columns[p, c] * band[p, 0]
        for i in range(min(half, rows - 1 - p), 0, -1):
            value -= band[p, i] * columns[p + i, c]
        columns[p, c] = value
