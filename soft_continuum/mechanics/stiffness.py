# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Bending stiffness of a segment: from its leaf spring, and from a measurement (paper, eqs. 1-8).

Symbols of the paper: E Young's modulus, I second moment of area, b width, t thickness, l bending
length, c_phi rotational stiffness, n rigid bodies, l_k lever arm, k slope of force over
displacement.
"""


def second_moment_of_area(width: float, thickness: float) -> float:
    """Return I = b t^3 / 12 in m^4 of a leaf spring of width b and thickness t in m (eq. 2)."""
    return width * thickness**3 / 12.0


def rotational_stiffness(bending_stiffness: float, length: float) -> float:
    """Return c_phi = E I / l in N m/rad for E I in N m^2 and l in m (eqs. 1 and 3)."""
    return bending_stiffness / length


def joint_stiffness(bending_stiffness: float, length: float, bodies: int) -> float:
    """
    Return c_phi_i = (n + 1) E I / l, the stiffness of each of n + 1 equal springs (eqs. 4 and 5).

    The springs are in series between n rigid bodies and the two discs.  E I in N m^2, l in m;
    the result is in N m/rad.
    """
    return rotational_stiffness(bending_stiffness, length) * (bodies + 1)


def bending_stiffness_from_slope(slope: float, length: float, lever_arm: float) -> float:
    """
    Return E I in N m^2 of a clamped segment from the slope k = F / u at its free end (eq. 8).

    The force (slope in N/m) acts ``lever_arm`` (l_k, m) beyond the end of the spring of length l
    (m), on a rigid end: E I = k (l_k^2 l + l_k l^2 + l^3 / 3).

    The paper's values k = 72 N/m, l = 70 mm, l_k = 30 mm and E I = 0.0202 N m^2 are inconsistent:
    with l_k = 30 mm the equation gives 0.02335 N m^2, and 0.0202 follows from l_k = 25.0 mm.  The
    lever arm therefore has no default here; see docs/explanation/mechanics.md.
    """
    return slope * (lever_arm**2 * length + lever_arm * length**2 + length**3 / 3.0)
