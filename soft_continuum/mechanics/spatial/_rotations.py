# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Rotations as matrices and rotation vectors, in compiled scalar code.

J is the right Jacobian of a rotation vector phi: exp(phi + d) = exp(phi) exp(J d), to first order
(Chirikjian, Stochastic Models, Information Theory, and Lie Groups, volume 2, 10.86).
"""

from math import atan2, cos, sin, sqrt

from soft_continuum.mechanics._compile import compiled

SMALL = 1e-4  # rad: below, series of two terms are exact to rounding


@compiled
def multiply(one, other, product):  # type: ignore[no-untyped-def]
    """Write a product of (3, 3) matrices."""
    for i in range(3):
        for j in range(3):
            product[i, j] = (one[i, 0] * other[0, j] + one[i, 1] * other[1, j]
                             + one[i, 2] * other[2, j])


@compiled
def transposed_multiply(one, other, product):  # type: ignore[no-untyped-def]
    """Write the product of the transpose of a (3, 3) matrix and another."""
    for i in range(3):
        for j in range(3):
            product[i, j] = (one[0, i] * other[0, j] + one[1, i] * other[1, j]
                             + one[2, i] * other[2, j])


@compiled
def apply(matrix, vector, product):  # type: ignore[no-untyped-def]
    """Write the product of a (3, 3) matrix and a vector (3,)."""
    for i in range(3):
        product[i] = matrix[i, 0] * vector[0] + matrix[i, 1] * vector[1] + matrix[i, 2] * vector[2]


@compiled
def rotate(matrix, vector):  # type: ignore[no-untyped-def]
    """Turn a rotation matrix (3, 3) on by a rotation vector (3,) in its own frame, in place."""
    x, y, z = vector[0], vector[1], vector[2]
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


@compiled
def rotation_vector(matrix, vector):  # type: ignore[no-untyped-def]
    """Write the rotation vector of a matrix (3, 3) that turns by less than pi."""
    x = 0.5 * (matrix[2, 1] - matrix[1, 2])
    y = 0.5 * (matrix[0, 2] - matrix[2, 0])
    z = 0.5 * (matrix[1, 0] - matrix[0, 1])
    sine = sqrt(x * x + y * y + z * z)
    cosine = 0.5 * (matrix[0, 0] + matrix[1, 1] + matrix[2, 2] - 1.0)
    if sine < SMALL and cosine > 0.0:
        factor = 1.0 + sine * sine / 6.0
    else:
        factor = atan2(sine, cosine) / max(sine, 1e-12)
    vector[0], vector[1], vector[2] = factor * x, factor * y, factor * z


@compiled
def inverse_jacobian(vector, matrix):  # type: ignore[no-untyped-def]
    """Write J^-1 of a rotation vector (3,) into a matrix (3, 3)."""
    x, y, z = vector[0], vector[1], vector[2]
    square = x * x + y * y + z * z
    if square < SMALL:
        factor = 1.0 / 12.0 + square / 720.0
    else:
        angle = sqrt(square)
        factor = 1.0 / square - (1.0 + cos(angle)) / (2.0 * angle * sin(angle))
    diagonal = 1.0 - factor * square
    matrix[0, 0] = diagonal + factor * x * x
    matrix[1, 1] = diagonal + factor * y * y
    matrix[2, 2] = diagonal + factor * z * z
    matrix[0, 1], matrix[1, 0] = factor * x * y - 0.5 * z, factor * x * y + 0.5 * z
    matrix[0, 2], matrix[2, 0] = factor * x * z + 0.5 * y, factor * x * z - 0.5 * y
    matrix[1, 2], matrix[2, 1] = factor * y * z - 0.5 * x, factor * y * z + 0.5 * x


@compiled
def turned_moment_slope(vector, moment, matrix):  # type: ignore[no-untyped-def]
    """Write how J^-T times a moment (3,) that stays changes with the rotation vector, (3, 3)."""
    x, y, z = vector[0], vector[1], vector[2]
    square = x * x + y * y + z * z
    if square < 0.04:  # below 0.2 rad the terms left out are 1e-8 of it
        factor = 1.0 / 12.0 + square / 720.0 + square * square / 30240.0
        slope = 1.0 / 360.0 + square / 7560.0 + square * square / 201600.0
    else:
        angle = sqrt(square)
        half = 0.5 * angle
        cotangent = cos(half) / sin(half)
        factor = 1.0 / square - 0.5 * cotangent / angle
        slope = (0.25 / sin(half)**2 + 0.5 * cotangent / angle - 2.0 / square) / square
    a, b, c = moment[0], moment[1], moment[2]
    u, v, w = y * c - z * b, z * a - x * c, x * b - y * a  # vector x moment
    dot = x * a + y * b + z * c
    # [m]x / 2 - f ([v x m]x + [v]x [m]x) + f' / |v| (v x (v x m)) v^T
    cross = y * w - z * v, z * u - x * w, x * v - y * u
    for i in range(3):
        for j in range(3):
            matrix[i, j] = (slope * cross[i] * vector[j] - factor * moment[i] * vector[j]
                            + (factor * dot if i == j else 0.0))
    matrix[0, 1] += factor * w - 0.5 * c
    matrix[1, 0] += 0.5 * c - factor * w
    matrix[0, 2] += 0.5 * b - factor * v
    matrix[2, 0] += factor * v - 0.5 * b
    matrix[1, 2] += factor * u - 0.5 * a
    matrix[2, 1] += 0.5 * a - factor * u
