# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Rotations as matrices and rotation vectors, in compiled scalar code.

Vectors are tuples of three numbers and matrices tuples of nine, row after row: compiled code
keeps them in registers, where small arrays would cost more than what is done with them.

J is the right Jacobian of a rotation vector phi: exp(phi + d) = exp(phi) exp(J d), to first order
(Chirikjian, Stochastic Models, Information Theory, and Lie Groups, volume 2, 10.86).  Its inverse
is 1 + [phi] / 2 + f [phi]^2.
"""

from math import atan2, cos, sin, sqrt

from soft_continuum.mechanics._compile import borrowing, inlined

SMALL = 1e-4  # rad: below, series of two terms are exact to rounding
SERIES = 0.04  # rad^2: below 0.2 rad the series of f are


@inlined
def matrix_at(matrices, k):  # type: ignore[no-untyped-def]
    """Return the matrix k of an array (n, 3, 3)."""
    return (matrices[k, 0, 0], matrices[k, 0, 1], matrices[k, 0, 2],
            matrices[k, 1, 0], matrices[k, 1, 1], matrices[k, 1, 2],
            matrices[k, 2, 0], matrices[k, 2, 1], matrices[k, 2, 2])


@inlined
def write(matrix, matrices, k):  # type: ignore[no-untyped-def]
    """Write a matrix into the place k of an array (n, 3, 3)."""
    for i in range(3):
        matrices[k, i, 0], matrices[k, i, 1], matrices[k, i, 2] = (
            matrix[3 * i], matrix[3 * i + 1], matrix[3 * i + 2])


@inlined
def transposed(m):  # type: ignore[no-untyped-def]
    """Return the transpose of a matrix."""
    return m[0], m[3], m[6], m[1], m[4], m[7], m[2], m[5], m[8]


@inlined
def multiply(a, b):  # type: ignore[no-untyped-def]
    """Return the product of two matrices."""
    return (a[0] * b[0] + a[1] * b[3] + a[2] * b[6], a[0] * b[1] + a[1] * b[4] + a[2] * b[7],
            a[0] * b[2] + a[1] * b[5] + a[2] * b[8], a[3] * b[0] + a[4] * b[3] + a[5] * b[6],
            a[3] * b[1] + a[4] * b[4] + a[5] * b[7], a[3] * b[2] + a[4] * b[5] + a[5] * b[8],
            a[6] * b[0] + a[7] * b[3] + a[8] * b[6], a[6] * b[1] + a[7] * b[4] + a[8] * b[7],
            a[6] * b[2] + a[7] * b[5] + a[8] * b[8])


@inlined
def apply(m, v):  # type: ignore[no-untyped-def]
    """Return the product of a matrix and a vector."""
    return (m[0] * v[0] + m[1] * v[1] + m[2] * v[2], m[3] * v[0] + m[4] * v[1] + m[5] * v[2],
            m[6] * v[0] + m[7] * v[1] + m[8] * v[2])


@inlined
def cross(a, b):  # type: ignore[no-untyped-def]
    """Return the cross product of two vectors."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@borrowing
def rotate(matrix, x, y, z):  # type: ignore[no-untyped-def]
    """Turn an array (3, 3) on by a rotation vector (x, y, z) in its own frame, in place."""
    square = x * x + y * y + z * z
    angle = sqrt(square)
    if angle < SMALL:
        a, b = 1.0 - square / 6.0, 0.5 - square / 24.0
    else:
        a, b = sin(angle) / angle, (1.0 - cos(angle)) / square
    c = 1.0 - b * square
    xx, xy, xz = c + b * x * x, b * x * y - a * z, b * x * z + a * y
    yx, yy, yz = b * x * y + a * z, c + b * y * y, b * y * z - a * x
    zx, zy, zz = b * x * z - a * y, b * y * z + a * x, c + b * z * z
    for i in range(3):
        p, q, r = matrix[i, 0], matrix[i, 1], matrix[i, 2]
        matrix[i, 0] = p * xx + q * yx + r * zx
        matrix[i, 1] = p * xy + q * yy + r * zy
        matrix[i, 2] = p * xz + q * yz + r * zz


@inlined
def rotation_vector(m):  # type: ignore[no-untyped-def]
    """Return the rotation vector of a matrix that turns by less than pi."""
    x, y, z = 0.5 * (m[7] - m[5]), 0.5 * (m[2] - m[6]), 0.5 * (m[3] - m[1])
    sine = sqrt(x * x + y * y + z * z)
    cosine = 0.5 * (m[0] + m[4] + m[8] - 1.0)
    if sine < SMALL and cosine > 0.0:
        factor = 1.0 + sine * sine / 6.0
    else:
        factor = atan2(sine, cosine) / max(sine, 1e-12)
    return factor * x, factor * y, factor * z


@inlined
def jacobian_terms(v):  # type: ignore[no-untyped-def]
    """Return f of a rotation vector, and its derivative over the angle: f' / |v|."""
    s = v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
    if s < SERIES:
        return (1.0 / 12.0 + s * (1.0 / 720.0 + s * (1.0 / 30240.0 + s * (
                    1.0 / 1209600.0 + s * (1.0 / 47900160.0)))),
                1.0 / 360.0 + s * (1.0 / 7560.0 + s * (1.0 / 201600.0 + s * (1.0 / 5987520.0))))
    angle = sqrt(s)
    half = 0.5 * angle
    cotangent = cos(half) / sin(half)
    return (1.0 / s - 0.5 * cotangent / angle,
            (0.25 / sin(half)**2 + 0.5 * cotangent / angle - 2.0 / s) / s)


@inlined
def inverse_jacobian(v, f):  # type: ignore[no-untyped-def]
    """Return J^-1 of a rotation vector, with its term f."""
    x, y, z = v
    d = 1.0 - f * (x * x + y * y + z * z)
    return (d + f * x * x, f * x * y - 0.5 * z, f * x * z + 0.5 * y,
            f * x * y + 0.5 * z, d + f * y * y, f * y * z - 0.5 * x,
            f * x * z - 0.5 * y, f * y * z + 0.5 * x, d + f * z * z)


@inlined
def turned_moment_slope(v, m, f, slope):  # type: ignore[no-untyped-def]
    """
    Return how J^-T times a moment m that stays changes with the rotation vector v, a matrix.

    f, slope: of jacobian_terms.
    """
    # [m] / 2 - f ([v x m] + [v] [m]) + f' / |v| (v x (v x m)) v^T
    u = cross(v, m)
    w = cross(v, u)
    d = f * (v[0] * m[0] + v[1] * m[1] + v[2] * m[2])
    p, q, r = f * u[0] - 0.5 * m[0], f * u[1] - 0.5 * m[1], f * u[2] - 0.5 * m[2]
    a, b, c = (slope * w[0] - f * m[0], slope * w[1] - f * m[1], slope * w[2] - f * m[2])
    return (a * v[0] + d, a * v[1] + r, a * v[2] - q,
            b * v[0] - r, b * v[1] + d, b * v[2] + p,
            c * v[0] + q, c * v[1] - p, c * v[2] + d)
