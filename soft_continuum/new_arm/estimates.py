# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What of an arm can be estimated before anything of it is measured: stiffnesses and masses."""

from dataclasses import dataclass
from math import pi

from soft_continuum.mechanics.stiffness import second_moment_of_area

DISC_DENSITY = 1180.0  # kg/m^3, printed resin
POWDER_DENSITY = 450.0  # kg/m^3, ground coffee
SKIN_THICKNESS, SKIN_DENSITY = 0.25e-3, 930.0  # m, kg/m^3, latex
SPACER_THICKNESS = 1e-3  # m
ROPE_MODULUS = 70e9  # Pa, E A over the area of the circle around a braided steel rope


@dataclass(frozen=True)
class Material:
    """
    What backbones are made of: typical values of the material.

    youngs_modulus: Pa.  poisson: Poisson's ratio.  density: kg/m^3.
    """

    name: str
    youngs_modulus: float
    poisson: float
    density: float


MATERIALS = {
    'steel': Material('spring steel', 200e9, 0.30, 7850.0),
    'nitinol': Material('superelastic NiTi (austenite)', 60e9, 0.33, 6450.0),
    'glass': Material('glass fibre in resin', 40e9, 0.28, 1900.0),
    'carbon': Material('carbon fibre in resin', 120e9, 0.30, 1600.0),
}


def rod_stiffness(diameter: float, youngs_modulus: float) -> float:
    """Return E I = E pi d^4 / 64 of a round rod, N m^2, for m and Pa."""
    return youngs_modulus * pi * diameter**4 / 64.0


def leaf_stiffness(width: float, thickness: float, youngs_modulus: float) -> float:
    """Return E I of a leaf spring, N m^2, for m and Pa."""
    return youngs_modulus * second_moment_of_area(width, thickness)


def torsional_stiffness(bending_stiffness: float, poisson: float) -> float:
    """Return G J = E I / (1 + nu) of a round rod, N m^2, for its E I."""
    return bending_stiffness / (1.0 + poisson)


def rod_mass(diameter: float, length: float, density: float) -> float:
    """Return the mass of a round rod, or of a full disc, kg, for m and kg/m^3."""
    return density * pi / 4.0 * diameter**2 * length


def jamming_mass(diameter: float, length: float) -> float:
    """Return the mass of a segment full of ground coffee in a latex skin, kg, for m."""
    return (rod_mass(diameter, length, POWDER_DENSITY)
            + SKIN_DENSITY * SKIN_THICKNESS * pi * diameter * length)


def rope_stiffness(diameter: float) -> float:
    """Return E A of a braided steel rope, N, for its diameter in m."""
    return ROPE_MODULUS * pi / 4.0 * diameter**2
